"""Rigid and affine transforms of points, in column-vector convention: ``x' = A x + b``."""

from typing import Any

import numpy as np

from . import validate
from .errors import InputError


def rotation_matrix(rotation: np.ndarray) -> np.ndarray:
    """Rotation by |rotation| radians about the vector ``rotation``, shape (3, 3) (Rodrigues' formula)."""
    angle = float(np.linalg.norm(rotation))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = np.asarray(rotation) / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + 2.0 * np.sin(0.5 * angle) ** 2 * (cross @ cross)


def rotation_from_z(direction: np.ndarray) -> np.ndarray:
    """Rotation vector of the shortest turn that takes the z axis to ``direction``."""
    x, y, z = direction / np.linalg.norm(direction)
    sine = np.hypot(x, y)
    if sine == 0.0:
        return np.array([0.0 if z > 0.0 else np.pi, 0.0, 0.0])
    return np.arctan2(sine, z) / sine * np.array([-y, x, 0.0])


def as_matrix(transform: Any, what: str) -> np.ndarray:
    """A 4 × 4 affine matrix from None (identity), a translation of three numbers [m], or a 4 × 4 matrix.

    Raises:
        InputError: when it is none of these, not affine, or flattens space.
    """
    matrix = np.eye(4)
    if transform is None:
        return matrix
    if _shape(transform) == (3,):
        matrix[:3, 3] = validate.vector(transform, what)
        return matrix
    matrix = np.array(validate.array(transform, f"{what} (a translation of 3 numbers or a 4 × 4 matrix)", (4, 4)))
    if not np.allclose(matrix[3], (0.0, 0.0, 0.0, 1.0)):
        raise InputError(f"{validate.sentence(what)} must have (0, 0, 0, 1) as its last row, got {matrix[3]}.")
    if np.linalg.matrix_rank(matrix[:3, :3]) < 3:
        raise InputError(f"{validate.sentence(what)} flattens space: its upper-left 3 × 3 block is singular.")
    return matrix


def placement(position: Any = (0.0, 0.0, 0.0), rotation: Any = (0.0, 0.0, 0.0), scale: Any = 1.0) -> np.ndarray:
    """The 4 × 4 matrix that scales, then rotates (rotation vector [rad]), then moves [m]."""
    matrix = np.eye(4)
    turn = rotation_matrix(validate.vector(rotation, "rotation"))
    matrix[:3, :3] = turn * validate.number(scale, "scale", above=0.0)
    matrix[:3, 3] = validate.vector(position, "position")
    return matrix


def apply(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Transforms points (n, 3) by a 4 × 4 affine matrix."""
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def unturned(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Points (n, 3) that a 4 × 4 affine matrix has transformed, as if it had stretched and moved them only.

    It is A = R S with a rotation R and a symmetric S (polar decomposition), which is negative where A mirrors.
    """
    u, _, v = np.linalg.svd(matrix[:3, :3])
    turn = u @ v if np.linalg.det(u @ v) > 0.0 else -u @ v
    return points if np.allclose(turn, np.eye(3), atol=1e-12) else points @ turn


def _shape(value: Any) -> tuple[int, ...]:
    try:
        return np.shape(value)
    except (ValueError, RuntimeError):  # rows of unequal lengths, a list of Warp arrays
        return ()
