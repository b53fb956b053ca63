"""The shadow of a draped specimen in vertical light: its area, its outline and the folds in it."""

from dataclasses import dataclass

import numpy as np

PIXEL = 2.5e-4  # [m]
RAYS = 720
HARMONICS = 24  # of the outline that are kept: finer ones are the mesh's
DEPTH = 2e-3  # [m] between a fold and the valleys beside it, above which it counts


@dataclass(frozen=True, eq=False)
class Shadow:
    """Area [m²], and the radius of the outline [m] at ``RAYS`` equal angles around the centre."""

    area: float
    radius: np.ndarray

    @property
    def angles(self) -> np.ndarray:
        """Of the rays [rad]."""
        return 2.0 * np.pi * np.arange(len(self.radius)) / len(self.radius)

    @property
    def folds(self) -> int:
        """Maxima of the outline that stand out by 2 mm on both sides, or 0 where it is nearly a circle."""
        spectrum = np.fft.rfft(self.radius)
        spectrum[HARMONICS + 1 :] = 0.0
        return _peaks(np.fft.irfft(spectrum, len(self.radius)), DEPTH)

    def outline(self) -> tuple[np.ndarray, np.ndarray]:
        """Points x, y [m], closed."""
        angle, radius = (np.append(values, values[0]) for values in (self.angles, self.radius))
        return radius * np.cos(angle), radius * np.sin(angle)


def shadow_of(points: np.ndarray, triangles: np.ndarray, disc_radius: float) -> Shadow:
    """The shadow of cloth around, and on, a disc about the z axis.

    Args:
        points: [m], shape [n, 3].
        triangles: shape [m, 3].
        disc_radius: [m].
    """
    half = int(np.ceil(np.abs(points[:, :2]).max() / PIXEL)) + 2
    centres = (np.arange(-half, half) + 0.5) * PIXEL
    dark = centres[:, None] ** 2 + centres[None, :] ** 2 < disc_radius**2
    for triangle in points[triangles][:, :, :2]:
        _fill(dark, triangle, centres, half)
    along = np.arange(0.0, half * PIXEL, 0.5 * PIXEL)
    angles = 2.0 * np.pi * np.arange(RAYS) / RAYS
    column = np.floor(np.outer(np.cos(angles), along) / PIXEL).astype(int) + half
    row = np.floor(np.outer(np.sin(angles), along) / PIXEL).astype(int) + half
    radius = np.where(dark[row, column], along[None, :], 0.0).max(axis=1)
    return Shadow(float(dark.sum()) * PIXEL**2, radius)


def _fill(dark: np.ndarray, corners: np.ndarray, centres: np.ndarray, half: int) -> None:
    """Darkens the pixels whose centres are in a triangle, in place."""
    low = np.maximum(np.floor(corners.min(axis=0) / PIXEL).astype(int) + half - 1, 0)
    high = np.floor(corners.max(axis=0) / PIXEL).astype(int) + half + 2
    x, y = centres[low[0] : high[0]][None, :], centres[low[1] : high[1]][:, None]
    sides = []
    for i in range(3):
        (ax, ay), (bx, by) = corners[i], corners[(i + 1) % 3]
        sides.append((bx - ax) * (y - ay) - (by - ay) * (x - ax))
    inside = np.all([s >= 0.0 for s in sides], axis=0) | np.all([s <= 0.0 for s in sides], axis=0)
    dark[low[1] : high[1], low[0] : high[0]] |= inside


def _peaks(values: np.ndarray, depth: float) -> int:
    """Maxima of a closed curve that stand out by ``depth`` from the minima on both sides."""
    start = int(np.argmin(values))
    low = high = values[start]
    rising, count = True, 0
    for value in np.roll(values, -start)[[*range(len(values)), 0]]:
        if not rising:
            low = min(low, value)
            rising, high = value >= low + depth, value
        elif value > high:
            high = value
        elif high >= max(low, value) + depth:
            rising, low, count = False, value, count + 1
        elif value < low:
            low = high = value
    return count
