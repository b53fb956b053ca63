"""Surfaces of known colour as a picture. VTK does the drawing, in a window that is never shown."""

import os
import sys
from typing import Any

import numpy as np

from ..errors import MissingExtraError, SimulationError
from .camera import Camera
from .surface import Surface

VIGNETTE = 0.10  # by how much the corners are darker


def pyvista() -> Any:
    """The library, which comes with the extra ``render``.

    Raises:
        MissingExtraError: it is not installed.
    """
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):  # else VTK tries X first, and complains
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    try:
        import pyvista
    except ImportError as error:
        raise MissingExtraError(
            'Pictures need pyvista, which is not installed; install the extra with: pip install "warpcloth[render]".'
        ) from error
    return pyvista


class Painter:
    """Paints one picture after the other.

    Args:
        size: width and height [pixels].
        samples: pixels drawn per pixel kept, along each side; more make smoother outlines.
    """

    def __init__(self, size: tuple[int, int], samples: int = 2):
        self._library = pyvista()
        self.size, self.samples = size, samples
        window = [samples * side for side in size]
        self._plotter = self._library.Plotter(off_screen=True, window_size=window, lighting="none")
        self._plotter.disable_anti_aliasing()  # pixels are averaged instead

    def paint(
        self, surfaces: list[Surface], colors: list[np.ndarray], backdrop: np.ndarray, camera: Camera
    ) -> np.ndarray:
        """A picture of surfaces with sRGB colours 0 to 1 at their vertices; uint8, shape [height, width, 3]."""
        plotter = self._plotter
        plotter.clear_actors()
        plotter.set_background(backdrop.tolist())
        for surface, color in zip(surfaces, colors, strict=True):
            self._add(surface, np.round(255.0 * np.clip(color, 0.0, 1.0)).astype(np.uint8))
        view = plotter.camera
        view.position, view.focal_point, view.view_angle = camera.eye, camera.target, camera.angle
        view.up = (
            (0.0, 0.0, 1.0) if abs(camera.eye[2] - camera.target[2]) < 0.999 * camera.distance else (0.0, 1.0, 0.0)
        )
        plotter.reset_camera_clipping_range()
        plotter.render()
        image = plotter.screenshot(return_img=True)
        if image is None or image.shape[:2] != (self.samples * self.size[1], self.samples * self.size[0]):
            raise SimulationError("The picture could not be drawn: OpenGL gave no image of the size asked for.")
        return finish(np.asarray(image)[..., :3], self.samples)

    def close(self) -> None:
        """Gives the window back."""
        self._plotter.close()

    def _add(self, surface: Surface, color: np.ndarray) -> None:
        points, triangles, texture = surface.points, surface.triangles, None
        textured = surface.texture
        if textured is not None:
            points, triangles, color = points[textured.vertex], textured.triangles, color[textured.vertex]
            texture = self._library.Texture(surface.pattern)
            texture.repeat = texture.mipmap = texture.interpolate = True
        faces = np.column_stack([np.full(len(triangles), 3), triangles]).ravel()
        mesh = self._library.PolyData(points.astype(np.float32), faces)
        mesh.point_data["color"] = color
        if textured is not None:
            mesh.active_texture_coordinates = textured.uvs.astype(np.float32)
        self._plotter.add_mesh(
            mesh, scalars="color", rgb=True, lighting=False, texture=texture, show_scalar_bar=False, render=False,
            smooth_shading=False, copy_mesh=False,
        )  # fmt: skip


def finish(image: np.ndarray, samples: int) -> np.ndarray:
    """Pixels averaged down to the size of the picture, and the corners a little darker."""
    height, width = (side // samples for side in image.shape[:2])
    small = image.reshape(height, samples, width, samples, 3).mean(axis=(1, 3))
    y, x = np.meshgrid(np.linspace(-1.0, 1.0, height), np.linspace(-1.0, 1.0, width), indexing="ij")
    shade = 1.0 - VIGNETTE * np.clip(0.5 * (x**2 + y**2), 0.0, 1.0) ** 1.5
    return np.round(np.clip(small * shade[..., None], 0.0, 255.0)).astype(np.uint8)
