"""A cache as a photographer sees it: surfaces at each frame, lit."""

import functools
from dataclasses import replace

import numpy as np

from ..obstacles import Plane
from ..scenes.usd.playback import Playback, PlayedCloth, PlayedNetwork
from .bake import LightGatherer
from .camera import Camera
from .coloring import Coloring
from .looks import WHITE, look_of, pattern_image, pattern_uvs
from .paint import Painter
from .shade import Studio, display, irradiance, radiance
from .solids import Floor, SolidShape, ball_surface, floor_plane, rod_surface
from .surface import ClothShell, Sides, Surface

SAMPLED_FRAMES = 13  # of a shot, that show where things go
TRAIL = 1.0  # [s]
# Smooth cloth cuts corners, so what it lies on is drawn smaller and further away, by these shares of the scene's size.
INSET, BEHIND = 0.004, 0.006


class Shot:
    """Everything in a cache that can be seen.

    Args:
        playback: the open cache.
        coloring: how cloth is coloured.
        pattern: name of a pattern on the cloth, see :mod:`warpcloth.render.looks`.
        studio: lights and floor.
        camera_azimuth: where the camera stands [rad]; the key light comes from its left.
        rays: (sun, sky) rays per point; more are smoother.
    """

    def __init__(
        self,
        playback: Playback,
        coloring: Coloring,
        pattern: str = "plain",
        studio: Studio | None = None,
        camera_azimuth: float = 0.0,
        rays: tuple[int, int] = (16, 32),
    ):
        self.playback, self.coloring = playback, coloring
        self.pattern = "plain" if coloring.measured else pattern
        self.studio = studio or Studio()
        layered = len(playback.cloths) > 1
        self.shells = [ClothShell(c.rest, c.triangles, self._uvs(c), c.thickness, layered) for c in playback.cloths]
        self.looks = [look_of(cloth.fabric) for cloth in playback.cloths]
        self.solids = [SolidShape(item) for item in playback.obstacles if not isinstance(item, Plane)]
        self.split = 4 if rays[1] > 64 else 2
        self.extent = self._extent()
        self.size = float(np.linalg.norm(np.ptp(self.extent, axis=0)))
        self.floor = self._floor()
        self.sun = self.studio.sun(camera_azimuth)
        self._gatherer = LightGatherer(self.sun, self.studio.sun_angle, *rays)

    def surfaces(self, frame: int) -> list[Surface]:
        """What is seen at a frame, and what light it sees; the floor comes last."""
        time = self.playback.time(frame)
        shells = [
            s.place(self.playback.points(c, frame)) for s, c in zip(self.shells, self.playback.cloths, strict=True)
        ]
        solids = [solid.place(time, INSET * self.size) for solid in self.solids]
        solids += [piece for network in self.playback.networks for piece in self._pieces(network, frame)]
        baked = self._gather([coarse for coarse, _ in shells], solids)
        drawn = [self._cloth(k, frame, fine) for k, (_, fine) in enumerate(shells)]
        for surface, shell, light in zip(drawn, self.shells, baked, strict=True):
            surface.light = shell.refined_light(light)
        return [*drawn, *solids, self.floor.surface]

    def picture(self, surfaces: list[Surface], painter: Painter, camera: Camera) -> np.ndarray:
        """A picture of what :meth:`surfaces` found, uint8, shape [height, width, 3]."""
        colors = [display(radiance(item, self.studio, self.sun, camera.eye)) for item in surfaces]
        back = BEHIND * self.size
        placed = [item if item.twin is not None else moved_back(item, camera.eye, back) for item in surfaces]
        return painter.paint(placed, colors, display(self.backdrop()), camera)

    def backdrop(self) -> np.ndarray:
        """Linear colour of the floor where nothing is near, shape [3]."""
        floor = self.floor.surface
        open_air = Surface(np.zeros((1, 3)), floor.normals[:1], floor.triangles[:0], floor.albedo)
        open_air.light = np.array([[1.0, 1.0, 0.0]])
        return irradiance(open_air, self.studio, self.sun)[0] * floor.albedo

    def _gather(self, shells: list[Sides], solids: list[Surface]) -> list[np.ndarray]:
        """Gathers light: for solids and floor, which keep it, and at both sides of each cloth, which is returned."""
        items: list[Sides | Surface] = [*shells, *solids]
        self._gatherer.load([(item.points, item.triangles) for item in items], self.size)
        points, normals = (np.concatenate([getattr(item, name) for item in items]) for name in ("points", "normals"))
        light = self._gatherer.gather(points, normals)
        parts = np.split(light, np.cumsum([len(item.points) for item in items])[:-1])
        for item, part in zip(solids, parts[len(shells) :], strict=True):
            item.light = part
        on_floor = functools.partial(self._gatherer.gather, lift=0.0)
        self.floor.surface.light = self.floor.light(on_floor)
        return parts[: len(shells)]

    def _cloth(self, k: int, frame: int, sides: Sides) -> Surface:
        shell, look = self.shells[k], self.looks[k]
        surface = Surface(sides.points, sides.normals, sides.triangles, self.coloring.albedo(self.playback, k, frame))
        surface.sheen, surface.translucency, surface.twin = look.sheen, look.translucency, sides.twin
        if surface.albedo.ndim == 2:
            surface.albedo = np.tile(shell.refined(surface.albedo), (2, 1))
        if shell.texture is not None:
            surface.texture, surface.pattern = shell.texture, pattern_image(self.pattern, surface.albedo)
            surface.albedo = np.full(3, WHITE)
        return surface

    def _uvs(self, cloth: PlayedCloth) -> np.ndarray | None:
        """Texture coordinates for the pattern, where there is one and the cloth has them."""
        if self.pattern == "plain" or cloth.uvs is None:
            return None
        return pattern_uvs(self.pattern, cloth.rest, cloth.triangles, cloth.uvs)

    def _pieces(self, network: PlayedNetwork, frame: int) -> list[Surface]:
        """Balls and rods, and the way that the balls have come in the last second."""
        play, thin = self.playback, 0.35 * network.width
        now = play.points(network, frame)
        pieces = [ball_surface(*item, network.ball_color) for item in zip(now, network.radii, strict=True)]
        pieces += [
            rod_surface(a, b, 0.5 * network.width, network.spring_color) for a, b in play.segments(network, frame)
        ]
        first = self._trail_start(frame)
        for earlier in range(first, frame):
            ends = zip(play.points(network, earlier), play.points(network, earlier + 1), strict=True)
            radius = thin * (earlier + 1 - first) / (frame - first)
            pieces += [rod_surface(a, b, radius, network.ball_color, 6, 2) for a, b in ends if not np.array_equal(a, b)]
        return pieces

    def _trail_start(self, frame: int) -> int:
        return max(0, frame - round(TRAIL * self.playback.fps))

    def points_at(self, frame: int) -> np.ndarray:
        """What a picture of a frame should show [m], shape [n, 3]: cloth, networks' ways, and solids of their size."""
        play, trail = self.playback, range(self._trail_start(frame), frame + 1)
        found = [play.points(cloth, frame) for cloth in play.cloths]
        found += [play.points(network, earlier) for network in play.networks for earlier in trail]
        near = np.concatenate(found)
        room = 2.5 * float(np.linalg.norm(np.ptp(near, axis=0)))
        for solid in self.solids:
            points = solid.place(self.playback.time(frame)).points
            if np.linalg.norm(np.ptp(points, axis=0)) < room:
                found.append(points)
        return np.concatenate(found)

    def framing(self, frame: int | None = None) -> np.ndarray:
        """What a picture of a frame, or of all frames, should show [m]; below what hangs, some floor of the studio."""
        points = self.extent if frame is None else self.points_at(frame)
        if floor_plane(self.playback.obstacles) is not None:
            return points
        foot = 0.5 * (points.min(axis=0) + points.max(axis=0))
        foot[2] = self.floor.surface.points[0, 2]
        return np.concatenate([points, foot[None]])

    def _extent(self) -> np.ndarray:
        """Corners of the box around the whole shot, shape [8, 3]."""
        frames = np.unique(np.linspace(0, self.playback.frames - 1, SAMPLED_FRAMES).astype(int))
        return box_corners(np.concatenate([self.points_at(frame) for frame in frames]))

    def _floor(self) -> Floor:
        """The plane that things stand on, or a floor of the studio below everything."""
        lower, upper = self.extent.min(axis=0), self.extent.max(axis=0)
        center = 0.5 * (lower + upper)
        radius = 0.5 * float(np.linalg.norm((upper - lower)[:2])) + 0.7 * float(upper[2] - lower[2])
        plane = floor_plane(self.playback.obstacles)
        if plane is None:
            center[2] = lower[2] - 0.12 * float(upper[2] - lower[2])
            return Floor(center, radius, np.array([0.0, 0.0, 1.0]), np.array(self.studio.floor), self.split)
        foot = center - np.dot(center - plane.point, plane.normal) * plane.normal
        return Floor(foot, radius, plane.normal, np.array(self.studio.floor), self.split)


def moved_back(surface: Surface, eye: np.ndarray, way: float) -> Surface:
    """A surface that looks the same from ``eye`` but is ``way`` [m] further away, so that cloth on it covers it."""
    rays = surface.points - eye
    return replace(surface, points=surface.points + way * rays / np.linalg.norm(rays, axis=1, keepdims=True))


def box_corners(points: np.ndarray) -> np.ndarray:
    """Corners of the box around points (n, 3), shape [8, 3]."""
    lower, upper = points.min(axis=0), points.max(axis=0)
    choose = np.indices((2, 2, 2)).reshape(3, 8).T
    return np.where(choose == 1, upper, lower)
