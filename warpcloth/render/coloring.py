"""What the colours of cloth show: the fabric, or a measure on a scale that the whole shot shares."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .. import validate
from ..scenes.usd.playback import Playback

SAMPLED_FRAMES = 13
HIGHEST = 99.0  # percentile of the measure that the scale ends at; single vertices may lie above


@dataclass(frozen=True)
class Measure:
    """A quantity at the vertices: title with unit for the colour bar, factor to that unit, values in SI."""

    title: str
    factor: float
    values: Callable[[Playback, int, int], np.ndarray]


def vertex_strain(rest: np.ndarray, points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Largest principal strain at each vertex [-], the mean of its triangles' weighted by area, shape [n].

    The strain of a triangle is the larger singular value of its deformation gradient, less one.
    """
    frames = _edges(rest, triangles)
    first = frames[:, 0] / np.linalg.norm(frames[:, 0], axis=1, keepdims=True).clip(1e-30)
    normal = np.cross(frames[:, 0], frames[:, 1])
    areas = np.linalg.norm(normal, axis=1)
    second = np.cross(normal / areas[:, None].clip(1e-30), first)
    flat = np.stack([np.sum(frames * first[:, None], axis=2), np.sum(frames * second[:, None], axis=2)], axis=1)
    usable = areas > 0.0
    stretch = np.zeros(len(triangles))
    gradient = np.swapaxes(_edges(points, triangles)[usable], 1, 2) @ np.linalg.inv(flat[usable])
    stretch[usable] = np.linalg.norm(gradient, ord=2, axis=(1, 2)) - 1.0
    corner = triangles.ravel()
    total = np.bincount(corner, np.repeat(stretch * areas, 3), minlength=len(rest))
    return total / np.bincount(corner, np.repeat(areas, 3), minlength=len(rest)).clip(1e-30)


def _edges(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    return points[triangles[:, 1:]] - points[triangles[:, :1]]


def _strain(playback: Playback, k: int, frame: int) -> np.ndarray:
    cloth = playback.cloths[k]
    return np.maximum(0.0, vertex_strain(cloth.rest, playback.points(cloth, frame), cloth.triangles))


def _speed(playback: Playback, k: int, frame: int) -> np.ndarray:
    return np.linalg.norm(playback.velocities(playback.cloths[k], frame), axis=1)


MEASURES = {"strain": Measure("largest strain [%]", 100.0, _strain), "speed": Measure("speed [m/s]", 1.0, _speed)}
COLORINGS = ("fabric", *MEASURES)


class Coloring:
    """Colours of cloth by name, one of :data:`COLORINGS`.

    Args:
        name: "fabric", "strain" or "speed".
        playback: the shot that the scale is for.
    """

    def __init__(self, name: str, playback: Playback):
        self.measured = MEASURES.get(validate.choice(name, COLORINGS, "color"))
        self.top = self._top(playback)

    def albedo(self, playback: Playback, k: int, frame: int) -> np.ndarray:
        """Linear colour of cloth ``k`` at a frame, shape [3], or of each vertex, [n, 3]."""
        if self.measured is None:
            return np.array(playback.cloths[k].color)
        return color_scale(self.measured.values(playback, k, frame) / self.top)

    def _top(self, playback: Playback) -> float:
        if self.measured is None:
            return 1.0
        frames = np.unique(np.linspace(0, playback.frames - 1, SAMPLED_FRAMES).astype(int))
        values = [self.measured.values(playback, k, f) for f in frames for k in range(len(playback.cloths))]
        return max(float(np.percentile(np.concatenate(values), HIGHEST)) if values else 0.0, 1e-9)


def color_scale(values: np.ndarray) -> np.ndarray:
    """Linear colours (n, 3) of values from 0 to 1, an even scale from dark to light."""
    import matplotlib

    encoded = matplotlib.colormaps["inferno"](0.12 + 0.83 * np.clip(values, 0.0, 1.0))[..., :3]
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
