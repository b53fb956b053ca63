"""Woven triangles: springs along the yarns inside each triangle of a mesh.

Whatever the mesh, they are the same sheet in every direction: triangles of constant strain with the elastic tensor of
the fabric, made of the four springs that square grids have. Springs along ±45° of C = 2 G per width each give
C_xyxy = C_xxyy = G and G to C_xx and C_yy; warp and weft have the rest, C_xx − G and C_yy − G, which is positive for
all fabrics. The law is in ``kernels/woven.py``.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .. import validate
from ..errors import InputError
from ..fabric import Fabric
from ..validate import Array, ReadOnly
from .sheet import sheet_tensor

WARP = np.array([1.0, 0.0, 0.0])
LEAST_PART = 0.1  # of the warp that must lie in a triangle to give it its direction


@dataclass(frozen=True, eq=False)
class WovenTriangles(ReadOnly):
    """Triangles with springs along warp, weft and ±45° between them.

    Args:
        corners: particles, shape [m, 3], int32.
        slopes: of the second and third corner's linear shape functions [1/m], along warp (row 0) and weft (row 1) of
            the triangle at rest, shape [m, 2, 2].
        stiffness: force per width and strain times area, C A [J], of the springs along warp, weft and each of ±45°,
            shape [m, 3], >= 0.
        law: damping time k_d/k_s [s], strain limit of warp and weft [-], and k_L/k_s beyond it [-], shape [m, 3], >= 0.

    Raises:
        InputError: on unequal lengths or values out of range.
    """

    corners: Array
    slopes: Array
    stiffness: Array
    law: Array

    def __post_init__(self):
        corners = validate.array(self.corners, "woven: corners", (None, 3), np.int32)
        count = len(corners)
        values = {
            "corners": corners,
            "slopes": validate.array(self.slopes, "woven: slopes", (count, 2, 2)),
            "stiffness": validate.array(self.stiffness, "woven: stiffness", (count, 3)),
            "law": validate.array(self.law, "woven: law", (count, 3)),
        }
        if np.any(corners < 0):
            raise InputError("Woven: corners must not be negative.")
        for name in ("stiffness", "law"):
            if np.any(values[name] < 0.0):
                raise InputError(f"Woven: {name} must not be negative.")
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.corners)

    @staticmethod
    def none() -> "WovenTriangles":
        """No triangles."""
        return WovenTriangles(np.zeros((0, 3), np.int32), np.zeros((0, 2, 2)), np.zeros((0, 3)), np.zeros((0, 3)))

    @staticmethod
    def joined(parts: Sequence["WovenTriangles"], first: Sequence[int]) -> "WovenTriangles":
        """All triangles of several cloths; ``first`` is added to the particle numbers of each."""
        corners = np.concatenate([part.corners + n for part, n in zip(parts, first, strict=True)])
        rest = (np.concatenate([getattr(part, name) for part in parts]) for name in ("slopes", "stiffness", "law"))
        return WovenTriangles(corners, *rest)


def woven_triangles(points: np.ndarray, triangles: np.ndarray, fabric: Fabric) -> WovenTriangles:
    """Springs for a fabric in every triangle of a mesh at rest.

    Args:
        points: [m], shape [n, 3].
        triangles: shape [m, 3], each with an area.
        fabric: its warp is x, projected onto each triangle; where that is next to nothing, y.
    """
    a, b, c = (points[triangles[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    double = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = normal / double
    along = _in_plane(normal)
    frame = np.stack([along, np.cross(normal, along)], axis=1)
    gradients = np.stack([np.cross(normal, a - c), np.cross(normal, b - a)], axis=1) / double[:, None]
    c_x, c_y = sheet_tensor(fabric.stretch, fabric.shear_stiffness)
    shear = fabric.shear_stiffness
    per_area = np.array([c_x - shear, c_y - shear, 2.0 * shear])
    share = fabric.beyond_limit / per_area[0]
    return WovenTriangles(
        corners=triangles,
        slopes=np.einsum("mad,mcd->mac", frame, gradients),
        stiffness=0.5 * double * per_area,
        law=np.tile([fabric.damping_time, fabric.strain_limit or 0.0, share], (len(triangles), 1)),
    )


def _in_plane(normal: np.ndarray) -> np.ndarray:
    """Unit vector of the warp in each plane."""
    flat, other = (v - (normal @ v)[:, None] * normal for v in (WARP, np.roll(WARP, 1)))
    chosen = np.where(np.linalg.norm(flat, axis=1, keepdims=True) > LEAST_PART, flat, other)
    return np.asarray(chosen / np.linalg.norm(chosen, axis=1, keepdims=True))
