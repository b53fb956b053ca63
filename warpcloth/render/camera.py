"""Where the picture is taken from."""

import re
from dataclasses import dataclass

import numpy as np

from ..errors import InputError

VIEW_ANGLE = 28.0  # [°], of the smaller side of the picture
MARGIN = 1.12
PRESETS = {
    "auto": (-58.0, 17.0),
    "front": (-90.0, 8.0),
    "back": (90.0, 8.0),
    "left": (180.0, 8.0),
    "right": (0.0, 8.0),
    "top": (-90.0, 89.0),
    "low": (-58.0, 3.0),
    "high": (-58.0, 38.0),
}
NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)"


@dataclass(frozen=True, eq=False)
class Camera:
    """Eye and target [m], shape [3] each; ``angle`` of the view from bottom to top [°]."""

    eye: np.ndarray
    target: np.ndarray
    angle: float

    @property
    def azimuth(self) -> float:
        """Where the camera stands about the target [rad]."""
        x, y, _ = self.eye - self.target
        return float(np.arctan2(y, x))

    @property
    def distance(self) -> float:
        """From eye to target [m]."""
        return float(np.linalg.norm(self.eye - self.target))

    def turned(self, angle: float) -> "Camera":
        """The camera moved about the vertical through its target by an angle [rad]."""
        c, s = np.cos(angle), np.sin(angle)
        arm = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ (self.eye - self.target)
        return Camera(self.target + arm, self.target, self.angle)


def make_camera(text: str, points: np.ndarray, size: tuple[int, int]) -> Camera:
    """A camera that sees all points.

    Args:
        text: a name of :data:`PRESETS`; ``azimuth,elevation`` [°] or ``azimuth,elevation,zoom``; or
            ``x,y,z,tx,ty,tz``, eye and target [m].
        points: what must be in the picture [m], shape [n, 3].
        size: of the picture, pixels.

    Raises:
        InputError: the text is none of these.
    """
    angles, zoom = PRESETS.get(text), 1.0
    if angles is None:
        if not re.fullmatch(rf"\s*{NUMBER}(\s*,\s*{NUMBER})*\s*", text):
            raise _bad(text)
        values = [float(part) for part in text.split(",")]
        if len(values) == 6 and values[:3] != values[3:]:
            return Camera(np.array(values[:3]), np.array(values[3:]), VIEW_ANGLE)
        if len(values) not in (2, 3) or abs(values[1]) > 90.0 or min(values[2:], default=1.0) <= 0.0:
            raise _bad(text)
        angles, zoom = (values[0], values[1]), (values[2:] or [1.0])[0]
    return _fitted(np.radians(angles[0]), np.radians(angles[1]), zoom, points, size)


def _bad(text: str) -> InputError:
    return InputError(
        f"The camera {text!r} must be one of {', '.join(PRESETS)}, or azimuth,elevation[,zoom] in degrees with an "
        "elevation from -90 to 90, or x,y,z,tx,ty,tz in metres."
    )


def _fitted(azimuth: float, elevation: float, zoom: float, points: np.ndarray, size: tuple[int, int]) -> Camera:
    """Looks at the middle of the points from as near as shows them all."""
    elevation = float(np.clip(elevation, np.radians(-89.0), np.radians(89.0)))
    aspect = size[0] / size[1]
    vertical = np.tan(np.radians(0.5 * VIEW_ANGLE)) * (1.0 if aspect >= 1.0 else 1.0 / aspect)
    back = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    up = np.cross(back, right)
    target = 0.5 * (points.min(axis=0) + points.max(axis=0))
    for _ in range(4):  # the perspective makes what is near larger, so the middle of the picture is found in rounds
        local = (points - target) @ np.stack([right, up, back]).T
        tangents = np.array([aspect * vertical, vertical])
        distance = float(np.max(local[:, 2:] + np.abs(local[:, :2]) / tangents))
        distance = MARGIN * max(distance, 1e-6)
        seen = local[:, :2] / (distance - local[:, 2:])
        shift = 0.5 * (seen.min(axis=0) + seen.max(axis=0)) * distance
        target = target + shift[0] * right + shift[1] * up
    return Camera(target + distance / zoom * back, target, float(np.degrees(2.0 * np.arctan(vertical))))
