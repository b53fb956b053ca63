"""From a cache to stills, films, turntables and contact sheets."""

import math
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .. import validate
from ..errors import InputError
from ..scenes.usd.playback import Playback
from .camera import Camera, make_camera
from .coloring import Coloring
from .files import FASTEST_GIF, FILMS, STILLS, check_output, film_rate, write_film, write_still
from .legend import color_bar_height, with_color_bar, with_label
from .looks import PATTERN_NAMES
from .paint import Painter
from .shot import Shot

SIZE = (1280, 800)
STILL_RAYS, FILM_RAYS = (64, 128), (16, 32)
TURNTABLE_SECONDS, TURNTABLE_FPS = 5.0, 24.0
OnPicture = Callable[[int, int], None]


@dataclass(frozen=True)
class RenderResult:
    """What was rendered: file, number of pictures, their size, pictures per second (0 for stills), wall time [s]."""

    output: Path
    pictures: int
    size: tuple[int, int]
    fps: float
    seconds: float

    def as_dict(self) -> dict[str, Any]:
        """The fields by name."""
        return asdict(self)


def render(
    cache: str | os.PathLike,
    output: str | os.PathLike | None = None,
    *,
    frame: int | None = None,
    turntable: bool = False,
    sheet: int | None = None,
    size: tuple[int, int] = SIZE,
    camera: str = "auto",
    fps: float | None = None,
    color: str = "fabric",
    pattern: str = "weave",
    on_picture: OnPicture | None = None,
) -> RenderResult:
    """Renders a USD cache.

    A still where the output is a picture or a ``frame`` is given, else a film.

    Args:
        cache: a cache of ours, or any stage in which points of meshes are sampled.
        output: ``.png``, ``.jpg``, ``.mp4`` or ``.gif``; by default the cache's name in its folder.
        frame: of a still or a turntable, counted from 0; negative numbers count from the end. By default the last.
        turntable: a film of one frame that the camera goes around.
        sheet: one picture of so many frames, evenly over time; at most as many as there are.
        size: width and height of the picture [pixels], even numbers.
        camera: see :func:`warpcloth.render.camera.make_camera`.
        fps: pictures per second of a film, for a ``.gif`` the nearest that it can have; by default the cache's, but no
            more than 60, or 25 in a ``.gif``; of a turntable 24.
        color: what colours show, see :data:`warpcloth.render.coloring.COLORINGS`.
        pattern: on the cloth, one of :data:`warpcloth.render.looks.PATTERN_NAMES`.
        on_picture: called after each picture with its number and the number of pictures.

    Raises:
        InputError: the cache, an option or the output is not valid; MissingExtraError: pyvista is not installed.
    """
    begun = time.perf_counter()
    playback = Playback(cache)
    path, still = _target(playback, output, frame, turntable, sheet)
    if still and fps is not None:
        raise InputError(f"The picture {path.name} does not move, so it has no fps; leave that out, or make a film.")
    if sheet is not None and validate.integer(sheet, "sheet", minimum=1, maximum=100) > playback.frames:
        what = f"{playback.frames} frame{'s' if playback.frames > 1 else ''}"
        raise InputError(
            f"A sheet of {sheet} frames asks for more than the {what} in {playback.path.name}; ask for fewer."
        )
    studio = _Renderer(playback, _size(size), camera, color, pattern, still)
    try:
        if sheet is not None:
            count, rate = sheet, 0.0
            write_still(path, studio.sheet(count, on_picture))
        elif still:
            count, rate = 1, 0.0
            write_still(path, studio.still(_frame(playback, frame)))
        else:
            count, rate, images = studio.film(_frame(playback, frame), turntable, _rate(fps, path, turntable, playback))
            write_film(path, _reported(images, count, on_picture), rate)
    finally:
        studio.close()
    return RenderResult(path, count, studio.size, rate, time.perf_counter() - begun)


class _Renderer:
    """A shot and what it is painted with."""

    def __init__(self, playback: Playback, size: tuple[int, int], camera: str, color: str, pattern: str, still: bool):
        validate.choice(pattern, PATTERN_NAMES, "pattern")
        make_camera(camera, np.zeros((1, 3)), size)
        self.playback, self.size, self.camera = playback, size, camera
        self.coloring = Coloring(color, playback)
        if self.coloring.measured and not playback.cloths:
            what = f"{playback.path.name} has no cloth whose colours could show its {color}"
            raise InputError(f"{what}; render it with the color 'fabric'.")
        azimuth = make_camera(camera, np.eye(3), size).azimuth
        rays = STILL_RAYS if still else FILM_RAYS
        self.shot = Shot(playback, self.coloring, pattern, camera_azimuth=azimuth, rays=rays)
        self.painter: Painter | None = None

    def still(self, frame: int) -> np.ndarray:
        """A picture of one frame, which fills it."""
        return with_color_bar(self._paint(frame, self._camera(frame), self.size, 3), self.coloring)

    def sheet(self, count: int, on_picture: OnPicture | None) -> np.ndarray:
        """Frames in rows, from the first to the last, each with its time; a colour bar below them."""
        width, height = self.size
        columns = math.ceil(math.sqrt(count))
        rows = math.ceil(count / columns)
        cell = (width // columns, (height - color_bar_height(height, self.coloring)) // rows)
        camera = make_camera(self.camera, self.shot.framing(), cell)
        canvas = np.full((height, width, 3), 255, np.uint8)
        for k, frame in enumerate(np.linspace(0, self.playback.frames - 1, count).round().astype(int)):
            picture = with_label(self._paint(int(frame), camera, cell, 2), f"{self.playback.time(int(frame)):.2f} s")
            top, left = k // columns * cell[1], k % columns * cell[0]
            canvas[top : top + cell[1], left : left + cell[0]] = picture
            if on_picture is not None:
                on_picture(k + 1, count)
        return with_color_bar(canvas, self.coloring)

    def film(self, frame: int, turntable: bool, rate: float) -> tuple[int, float, Iterator[np.ndarray]]:
        """Number of pictures, pictures per second, and the pictures: of all frames, or around one."""
        if turntable:
            count = max(1, round(TURNTABLE_SECONDS * rate))
            return count, rate, self._around(frame, count)
        own = np.array([self.playback.time(frame) for frame in range(self.playback.frames)])
        seconds = own[-1] - own[0] + 1.0 / self.playback.fps  # the last frame is seen as long as the others
        count = max(1, round(seconds * rate))
        frames = np.abs(own[:, None] - (own[0] + np.arange(count) / rate)).argmin(axis=0)
        camera = make_camera(self.camera, self.shot.framing(), self.size)
        return count, rate, (self._finished(int(frame), camera) for frame in frames)

    def close(self) -> None:
        """Gives the painter's window back."""
        if self.painter is not None:
            self.painter.close()

    def _around(self, frame: int, count: int) -> Iterator[np.ndarray]:
        """Light stays where it is, and need not be gathered again."""
        camera, surfaces = self._camera(frame, around=True), self.shot.surfaces(frame)
        for k in range(count):
            picture = self.shot.picture(surfaces, self._brush(self.size, 2), camera.turned(2.0 * np.pi * k / count))
            yield with_color_bar(picture, self.coloring)

    def _camera(self, frame: int, around: bool = False) -> Camera:
        points = self.shot.framing(frame)
        if around:  # room for every direction
            middle, reach = 0.5 * (points.min(axis=0) + points.max(axis=0)), points - points.mean(axis=0)
            radius, half = np.linalg.norm(reach[:, :2], axis=1).max(), 0.5 * np.ptp(points[:, 2])
            angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
            ring = radius * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(24)])
            points = np.concatenate([middle + ring + (0.0, 0.0, z) for z in (-half, half)])
        return make_camera(self.camera, points, self.size)

    def _finished(self, frame: int, camera: Camera) -> np.ndarray:
        return with_color_bar(self._paint(frame, camera, self.size, 2), self.coloring)

    def _paint(self, frame: int, camera: Camera, size: tuple[int, int], samples: int) -> np.ndarray:
        return self.shot.picture(self.shot.surfaces(frame), self._brush(size, samples), camera)

    def _brush(self, size: tuple[int, int], samples: int) -> Painter:
        if self.painter is None:
            self.painter = Painter(size, samples)
        return self.painter


def _target(
    playback: Playback, output: str | os.PathLike | None, frame: int | None, turntable: bool, sheet: int | None
) -> tuple[Path, bool]:
    """Where to, and whether it is one picture."""
    if turntable and sheet is not None:
        raise InputError("A render is either a turntable or a sheet; ask for one of them.")
    if frame is not None and sheet is not None:
        raise InputError("A render is either of one frame or a sheet of frames over time; ask for one of them.")
    one = sheet is not None or (frame is not None and not turntable)
    if output is None:
        return playback.path.with_suffix(".png" if one else ".mp4"), one
    path = Path(output)
    still = path.suffix.lower() in STILLS
    if turntable:
        check_output(path, FILMS, "the film")
    elif one:
        check_output(path, STILLS, "the picture")
    else:
        check_output(path, STILLS + FILMS, "the render")
    return path, still


def _frame(playback: Playback, frame: int | None) -> int:
    last = playback.frames - 1
    number = last if frame is None else validate.integer(frame, "frame", minimum=-last - 1, maximum=last)
    return number % (last + 1)


def _size(size: tuple[int, int]) -> tuple[int, int]:
    width, height = (validate.integer(side, "size", minimum=64, maximum=4096) for side in size)
    if width % 2 or height % 2:
        raise InputError(f"The size {width}x{height} must be of even numbers, as films need them.")
    return width, height


def _rate(fps: float | None, path: Path, turntable: bool, playback: Playback) -> float:
    rate = TURNTABLE_FPS if turntable else min(playback.fps, 60.0)
    if path.suffix.lower() == ".gif":
        rate = min(rate, FASTEST_GIF)
    return film_rate(path, rate if fps is None else validate.number(fps, "fps", minimum=0.1, maximum=240.0))


def _reported(images: Iterator[np.ndarray], count: int, on_picture: OnPicture | None) -> Iterator[np.ndarray]:
    for number, image in enumerate(images, 1):
        yield image
        if on_picture is not None:
            on_picture(number, count)
