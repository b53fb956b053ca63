"""Coulomb's law where it has closed forms: how a strip over a cylinder, or over a table's edge, starts."""

import math
from dataclasses import dataclass, replace

import numpy as np

import warpcloth as wc
from warpcloth.cloth.pins import Pin

MU, G = 0.3, 9.81
THICKNESS = 0.004
CAPSTAN_RADIUS, CAPSTAN_SPEED = 0.1, 0.05  # of the strip's middle layer [m], of the strip [m/s]
EDGE_RADIUS = 0.04  # of the strip around the table's edge [m]


@dataclass(frozen=True)
class Start:
    """A strip in its start pose, and the velocities of its particles [m/s]."""

    cloth: wc.Cloth
    velocities: np.ndarray


def strip(length: float, spacing: float, fabric: wc.Fabric) -> wc.Cloth:
    """Two rows of particles along x, flat and at rest."""
    return wc.Cloth.grid((length, spacing), (round(length / spacing) + 1, 2), fabric)


def capstan_start(*, moving: bool) -> Start:
    """A strip drawn over half a cylinder along y, with tensions as exp(μ angle), so that no waves run along it.

    Its ends are pins; they move by a motion if ``moving``, else they stand still and only have their velocities.
    """
    leg, spacing, strain, stiffness, speed = 0.2, 0.02, 0.05, 20.0, CAPSTAN_SPEED
    fabric = wc.Fabric(
        areal_density=0.8, thickness=THICKNESS, friction=MU, stretch_stiffness=stiffness, shear_stiffness=0.0,
        bend_stiffness=0.0, damping_time=2e-3,
    )  # fmt: skip
    flat, radius = strip(0.72, spacing, fabric), CAPSTAN_RADIUS
    s = flat.points[:, 0] - flat.points[:, 0].min()
    way = np.linspace(0.0, 1.0, 20001)
    stretch = 1.0 + strain * np.exp(MU * np.clip((way - leg) / radius, 0.0, math.pi))
    rest = np.concatenate([[0.0], np.cumsum(np.diff(way) / (0.5 * (stretch[1:] + stretch[:-1])))])
    way = np.interp(s, rest, way)
    turn = np.clip((way - leg) / radius, 0.0, math.pi)
    height = radius * np.sin(turn) + np.minimum(way - leg, 0.0) - np.maximum(way - leg - math.pi * radius, 0.0)
    points = np.stack([-radius * np.cos(turn), flat.points[:, 1], height], axis=1)
    up, down = (wc.Motion.keyframes([(0.0, (0, 0, 0)), (10.0, (0, 0, 10.0 * v))]) for v in (speed, -speed))
    ends = np.flatnonzero(s == s.min()), np.flatnonzero(s == s.max())
    pins = (Pin(ends[0], up), Pin(ends[1], down)) if moving else (Pin(np.concatenate(ends)),)
    velocities = speed * np.stack([np.sin(turn), 0.0 * turn, np.cos(turn)], axis=1)
    return Start(replace(flat, points=points, pins=pins), velocities)


def capstan_tension(x: np.ndarray, cloth: wc.Cloth, side: float) -> float:
    """Mean elastic force [N] of the springs along the strip at x [m] where it hangs free on one side of x = 0."""
    ends, rest = cloth.springs.indices, cloth.springs.rest_lengths
    middle, d = x[ends].mean(axis=1), x[ends[:, 1]] - x[ends[:, 0]]
    length = np.linalg.norm(d, axis=1)
    chosen = (np.abs(middle[:, 2] + 0.08) < 0.03) & (side * middle[:, 0] > 0.0) & (np.abs(d[:, 2]) > 0.5 * length)
    assert chosen.sum() >= 4
    return float((cloth.springs.stiffness * (length / rest - 1.0))[chosen].mean())


def table_start(share: float) -> Start:
    """A strip over the edge of a table whose top is at z = 0, half a thickness below it; ``share`` of it hangs.

    The edge is a quarter of a cylinder along y through (0, −radius): a depth of one radius on the length of a quarter
    circle. By what that is longer it neither pulls nor holds, so it is left out of the length. Tension is there from
    the start, as large as friction can hold, so that the strip does not fall into it.
    """
    length, spacing, radius, density, stiffness = 0.6, 0.01, EDGE_RADIUS, 0.5, 10.0
    fabric = wc.Fabric(
        areal_density=density, thickness=THICKNESS, friction=MU, stretch_stiffness=stiffness, shear_stiffness=0.0,
        bend_stiffness=0.0, damping_time=3e-4,
    )  # fmt: skip
    hanging = share * (length - (0.5 * math.pi - 1.0) * radius)
    lying = hanging * (1.0 - share) / share
    flat = strip(length, spacing, fabric)
    s = flat.points[:, 0] - flat.points[:, 0].min()
    at = np.linspace(0.0, length, 20001)
    weight = density * G * np.minimum(np.minimum(hanging * at / lying, hanging), length - at)
    way = np.concatenate([[0.0], np.cumsum(np.diff(at) * (1.0 + 0.5 * (weight[1:] + weight[:-1]) / stiffness))])
    way = np.interp(s, at, way) - np.interp(lying, at, way)
    turn = np.clip(way / radius, 0.0, 0.5 * math.pi)
    height = radius * (np.cos(turn) - 1.0) - np.maximum(way - 0.5 * math.pi * radius, 0.0)
    points = np.stack([np.minimum(way, 0.0) + radius * np.sin(turn), flat.points[:, 1], height], axis=1)
    return Start(replace(flat, points=points), np.zeros_like(points))
