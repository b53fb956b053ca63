"""From light to colour: what a surface of a look sends to the eye, and how a picture shows it.

Everything is linear until :func:`display`, which compresses bright light like film and encodes for sRGB.
"""

from dataclasses import dataclass

import numpy as np

from .surface import Surface

SOFTNESS = 3.0  # exponent of the sheen: how far it reaches in from the outline
KNEE = 0.6  # light above which highlights are compressed


@dataclass(frozen=True)
class Studio:
    """Lights and floor of a photographer's studio; colours are linear.

    Attributes:
        sun_angle: radius of the key light as seen from the scene [rad].
        azimuth, elevation: of the key light, relative to the camera, and above the horizon [rad].
        key, sky, ground, bounce: light of the key, of the sky above, of the lit ground below, and of what is near.
        floor: colour of the floor.
        exposure: factor on everything.
    """

    sun_angle: float = 0.11
    azimuth: float = np.radians(-66.0)
    elevation: float = np.radians(46.0)
    key: tuple[float, float, float] = (1.14, 1.07, 0.97)
    sky: tuple[float, float, float] = (0.37, 0.40, 0.44)
    ground: tuple[float, float, float] = (0.20, 0.19, 0.17)
    bounce: tuple[float, float, float] = (0.05, 0.047, 0.043)
    floor: tuple[float, float, float] = (0.72, 0.70, 0.67)
    exposure: float = 1.0

    def sun(self, camera_azimuth: float) -> np.ndarray:
        """Direction to the key light for a camera that stands at this azimuth [rad], shape [3]."""
        a = camera_azimuth + self.azimuth
        e = self.elevation
        return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def radiance(surface: Surface, studio: Studio, sun: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """Light that each vertex sends to the eye, linear, shape [n, 3].

    Diffuse reflection, plus light that comes through from the other side, a sheen towards the outline as fibres give
    it, and a highlight on what is glossy.
    """
    arriving = irradiance(surface, studio, sun)
    diffuse = arriving
    if surface.twin is not None:
        through = surface.translucency * arriving[surface.twin]
        diffuse = (1.0 - surface.translucency) * arriving + through * np.sqrt(surface.albedo)
    seen = eye - surface.points
    seen = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    facing = np.clip(np.sum(seen * surface.normals, axis=1), 0.0, 1.0)[:, None]
    result = surface.albedo * diffuse
    if surface.sheen:
        tint = 0.5 + 0.5 * surface.albedo / np.max(surface.albedo, axis=-1, keepdims=True).clip(1e-3)
        result = result + surface.sheen * tint * (1.0 - facing) ** SOFTNESS * diffuse
    if surface.gloss:
        half = sun + seen
        half = half / np.linalg.norm(half, axis=1, keepdims=True)
        peak = np.clip(np.sum(half * surface.normals, axis=1), 0.0, 1.0)[:, None] ** 40.0
        rim = 0.04 + 0.96 * (1.0 - facing) ** 5
        visible, above = surface.light[:, :1], surface.light[:, 1:2]
        result = result + surface.gloss * (peak * visible * studio.key + 0.35 * rim * above * studio.sky)
    return result


def irradiance(surface: Surface, studio: Studio, sun: np.ndarray) -> np.ndarray:
    """What arrives at each vertex, as a factor on its colour, shape [n, 3]."""
    visible, above, below = surface.light[:, :1], surface.light[:, 1:2], surface.light[:, 2:3]
    cosine = np.clip(surface.normals @ sun, 0.0, None)[:, None]
    near = np.clip(1.0 - above - below, 0.0, 1.0)
    return cosine * visible * studio.key + above * studio.sky + below * studio.ground + near * studio.bounce


def display(linear: np.ndarray, exposure: float = 1.0) -> np.ndarray:
    """Linear light as sRGB values 0 to 1; highlights bend softly into white instead of being cut off."""
    light = exposure * linear
    over = np.clip(light - KNEE, 0.0, None)
    soft = np.where(light < KNEE, light, KNEE + (1.0 - KNEE) * (1.0 - np.exp(-over / (1.0 - KNEE))))
    soft = np.clip(soft, 0.0, 1.0)
    return np.where(soft <= 0.0031308, 12.92 * soft, 1.055 * soft ** (1.0 / 2.4) - 0.055)
