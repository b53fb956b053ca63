"""A picture of a batch: its drapes in rows, drawn together in one go."""

import contextlib
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..obstacles import Plane
from ..render.solids import SolidShape, ball_surface, rod_surface
from ..render.surface import Surface
from ..scenes.usd.playback import Playback, PlayedNetwork
from ..scenes.usd.surface import vertex_normals
from .assembly import drape_file
from .extra import needed
from .folder import BatchFolder

SHEET = "contact_sheet.png"
MOST = 100  # drapes in a picture; of more, evenly chosen ones
PIXELS = 200  # of a drape, along the row
GAP = 1.15
ELEVATION = 50.0  # [°] of the camera

Part = tuple[np.ndarray, np.ndarray, Any]  # points [m], shape [n, 3]; triangles, shape [m, 3]; linear colour


def write_sheet(folder: BatchFolder) -> Path | None:
    """Draws up to 100 drapes, evenly chosen, each at its end; None if there are none.

    Raises:
        MissingExtraError: pyvista is not installed.
    """
    drapes = [(index, file) for index in folder.finished() if (file := drape_file(folder, index)) is not None]
    if not drapes:
        (folder.path / SHEET).unlink(missing_ok=True)  # it would show what is there no more
        return None
    chosen = np.unique(np.linspace(0, len(drapes) - 1, min(MOST, len(drapes))).round().astype(int))
    needed("PIL.Image", "render")
    from ..render.files import write_still
    from ..render.paint import pyvista

    library = pyvista()
    tiles = [_Tile(*drapes[number]) for number in chosen]
    columns = math.ceil(math.sqrt(len(tiles)))
    rows = math.ceil(len(tiles) / columns)
    step = GAP * max(tile.size for tile in tiles)
    bottom, top = _seen(step, rows)
    size = (max(600, PIXELS * columns), max(400, int(PIXELS * (top - bottom) / step)))
    with contextlib.closing(library.Plotter(off_screen=True, window_size=size, lighting="light kit")) as plotter:
        plotter.set_background("#f4f2ee")
        plotter.enable_anti_aliasing("ssaa")
        for number, tile in enumerate(tiles):
            tile.draw(plotter, library, np.array([step * (number % columns), -step * (number // columns), 0.0]), step)
        _look(plotter, step, columns, rows, size)
        image = plotter.screenshot(return_img=True)
    write_still(folder.path / SHEET, np.ascontiguousarray(image[..., :3]))
    return folder.path / SHEET


class _Tile:
    """One drape at its end: cloth, networks and solids as triangles, to be drawn on a plate at height 0."""

    def __init__(self, index: int, file: Path):
        self.index = index
        playback = Playback(file)
        end = playback.frames - 1
        cloths = [(playback.points(cloth, end), cloth.triangles, cloth.color) for cloth in playback.cloths]
        cloths += [_as_part(piece) for network in playback.networks for piece in _pieces(playback, network, end)]
        shapes = [SolidShape(item) for item in playback.obstacles if not isinstance(item, Plane)]
        solids = [_as_part(shape.place(playback.time(end))) for shape in shapes]
        self.parts: list[Part] = [*cloths, *solids]
        low, high = _bounds(cloths)
        middle, extent = 0.5 * (low + high), float((high - low).max())
        for solid in solids:  # what is much larger, such as a table, reaches out of its place
            ends = _bounds([solid])
            if max(np.abs(end - middle).max() for end in ends) <= 2.0 * extent:
                low, high = np.minimum(low, ends[0]), np.maximum(high, ends[1])
        self.origin = np.array([middle[0], middle[1], low[2]])
        self.size = max(2.0 * float(np.abs([low - middle, high - middle])[:, :2].max()), float(high[2] - low[2]))

    def draw(self, plotter: Any, library: Any, place: np.ndarray, step: float) -> None:
        """Adds it at ``place``, on a plate of its own with its number."""
        for points, triangles, color in self.parts:
            faces = np.column_stack([np.full(len(triangles), 3), triangles])
            mesh = library.PolyData(points - self.origin + place, faces)
            mesh.point_data["Normals"] = vertex_normals(points, triangles)
            display = np.clip(np.asarray(color, float), 0.0, 1.0) ** (1.0 / 2.2)
            plotter.add_mesh(mesh, color=display, smooth_shading=True, specular=0.1, ambient=0.15)
        floor = place - np.array([0.0, 0.0, 2e-3 * step])
        plate = library.Plane(center=floor, direction=(0, 0, 1), i_size=0.97 * step, j_size=0.97 * step)
        plotter.add_mesh(plate, color="#e3e0da", lighting=False)
        corner = place + step * np.array([-0.46, -0.46, 0.0])
        plotter.add_point_labels(
            [corner], [str(self.index)], font_size=13, text_color="#555555", shape=None, show_points=False,
            always_visible=True, justification_horizontal="left",
        )  # fmt: skip


def _as_part(surface: Surface) -> Part:
    return surface.points, surface.triangles, surface.albedo


def _pieces(playback: Playback, network: PlayedNetwork, frame: int) -> list[Surface]:
    """Balls and rods."""
    balls = zip(playback.points(network, frame), network.radii, strict=True)
    pieces = [ball_surface(*ball, network.ball_color) for ball in balls]
    ends = playback.segments(network, frame)
    return pieces + [rod_surface(a, b, 0.5 * network.width, network.spring_color) for a, b in ends]


def _bounds(parts: Sequence[Part]) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest coordinates of surfaces [m], shape [3]; about the origin if there are none."""
    points = np.concatenate([part[0] for part in parts] or [np.zeros((1, 3))])
    return points.min(axis=0), points.max(axis=0)


def _seen(step: float, rows: int) -> tuple[float, float]:
    """From where to where tiles reach in the picture [m], upwards from the middle of the first row's plates."""
    angle = math.radians(ELEVATION)
    return -step * (rows - 0.5) * math.sin(angle), step * (0.5 * math.sin(angle) + math.cos(angle) / GAP)


def _look(plotter: Any, step: float, columns: int, rows: int, size: tuple[int, int]) -> None:
    """The camera above the front row, so that all tiles just fill the picture."""
    angle = math.radians(ELEVATION)
    bottom, top = _seen(step, rows)
    middle = np.array([0.5 * step * (columns - 1), 0.5 * (bottom + top) / math.sin(angle), 0.0])
    away = 10.0 * step * max(columns, rows)
    plotter.camera_position = [
        tuple(middle + away * np.array([0.0, -math.cos(angle), math.sin(angle)])), tuple(middle), (0.0, 0.0, 1.0)
    ]  # fmt: skip
    plotter.enable_parallel_projection()
    wide = 0.5 * step * columns * size[1] / size[0]
    plotter.camera.parallel_scale = 1.03 * max(0.5 * (top - bottom), wide)
