"""Gathering light: rays from every vertex to the sun's disc, the sky and the ground, traced by Warp."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import warp as wp

from ..kernels import KernelSet

LIFT = 1e-3  # of the scene's size: how far off their surface rays start
THREADS = 2  # Warp runs a launch on one core, launches of disjoint ranges on several


class LightGatherer:
    """Measures what light reaches points among things that cast shadows.

    Args:
        sun: direction to the middle of the sun's disc, shape [3].
        sun_angle: radius of the disc as seen from the scene [rad].
        sun_rays, sky_rays: rays per point; more cost time and give smoother shadows.
        device: Warp device.
    """

    def __init__(self, sun: np.ndarray, sun_angle: float, sun_rays: int, sky_rays: int, device: str = "cpu"):
        self.device = wp.get_device(device)
        self.kernels = KernelSet("float32")
        self.sun = self._array(sun_disc(sun, sun_angle, sun_rays))
        self.sky = self._array(cosine_hemisphere(sky_rays))

    def load(self, casters: Sequence[tuple[np.ndarray, np.ndarray]], size: float) -> None:
        """Takes the points and triangles of everything that casts shadows, in a scene of ``size`` [m]."""
        starts = np.cumsum([0] + [len(points) for points, _ in casters])
        triangles = [faces + start for (_, faces), start in zip(casters, starts, strict=False)]
        joined = np.concatenate(triangles).astype(np.int32).ravel()
        points = self._array(np.concatenate([points for points, _ in casters]))
        self.mesh = wp.Mesh(points, wp.array(joined, dtype=wp.int32, device=self.device))
        self.size = size

    def gather(self, points: np.ndarray, normals: np.ndarray, lift: float = LIFT) -> np.ndarray:
        """Per point: visible share of the sun, free share of sky, free share of ground; shape [n, 3], 0 to 1.

        Args:
            points, normals: where, shape [n, 3].
            lift: how far above the point rays start, as a share of the scene's size; 0 on what casts no shadow.
        """
        origins = self._array(points + lift * self.size * normals)
        facing = self._array(normals)
        out = wp.zeros(len(points), dtype=wp.vec3, device=self.device)

        def part(first: int, last: int) -> None:
            wp.launch(
                self.kernels.occlusion.gather_light,
                dim=last - first,
                inputs=[self.mesh.id, self.sun, self.sky, 100.0 * self.size, first, origins, facing],
                outputs=[out],
                device=self.device,
            )

        part(0, 1)  # loads the kernel before threads want it
        bounds = np.linspace(1, len(points), THREADS + 1).astype(int)
        with ThreadPoolExecutor(THREADS) as pool:
            list(pool.map(part, bounds[:-1], bounds[1:]))
        return out.numpy().astype(np.float64)

    def _array(self, vectors: np.ndarray) -> wp.array:
        return wp.array(np.ascontiguousarray(vectors, np.float32), dtype=wp.vec3, device=self.device)


def sun_disc(direction: np.ndarray, angle: float, count: int) -> np.ndarray:
    """Unit vectors spread evenly over a disc of radius ``angle`` [rad] about a direction, shape [count, 3]."""
    n = direction / np.linalg.norm(direction)
    t = np.cross(n, (0.0, 0.0, 1.0) if abs(n[2]) < 0.9 else (1.0, 0.0, 0.0))
    t /= np.linalg.norm(t)
    x, y = (np.tan(angle) * _disc(count)).T
    vectors = n + x[:, None] * t + y[:, None] * np.cross(n, t)
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def cosine_hemisphere(count: int) -> np.ndarray:
    """Unit vectors about +z whose density goes with the cosine, shape [count, 3]."""
    flat = _disc(count)
    return np.column_stack([flat, np.sqrt(1.0 - np.sum(flat**2, axis=1))])


def _disc(count: int) -> np.ndarray:
    """Points spread evenly over the unit disc: a sunflower's seeds (Vogel 1979), shape [count, 2]."""
    k = np.arange(count) + 0.5
    radius, angle = np.sqrt(k / count), np.pi * (3.0 - np.sqrt(5.0)) * k
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
