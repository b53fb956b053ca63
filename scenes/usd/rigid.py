"""Sampled transforms as rigid motions."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from pxr import Gf

from ...motion import Motion

ROUND_OFF = 1e-5  # relative; many writers sample transforms in single precision


class Frame(NamedTuple):
    """Where a shape is: origin [m], shape [3], rotation matrix, shape [3, 3], and scale of each axis, shape [3].

    ``axes`` has the unit directions of the shape's own axes as columns; where the frame mirrors, they are no rotation.
    """

    origin: np.ndarray
    rotation: np.ndarray
    scales: np.ndarray
    axes: np.ndarray


def split(matrix: np.ndarray) -> Frame | None:
    """The frame that ``matrix`` (4 × 4) makes, or None if it shears or flattens.

    Its rotation is that of a matrix that does not mirror, as most shapes that this is for are their own mirror images.
    """
    scales = np.linalg.norm(matrix[:3, :3], axis=0)
    if scales.min() == 0.0:
        return None
    axes = matrix[:3, :3] / scales
    if np.abs(axes.T @ axes - np.eye(3)).max() > ROUND_OFF:
        return None
    rotation = axes * (-1.0, 1.0, 1.0) if np.linalg.det(axes) < 0.0 else axes
    return Frame(matrix[:3, 3], rotation, scales, axes)


def are_rigid(rest: np.ndarray, matrices: Sequence[np.ndarray]) -> bool:
    """Whether placement ``rest`` only has to be turned and moved to become any of ``matrices``, 4 × 4 each."""
    if np.linalg.det(rest[:3, :3]) == 0.0:
        return False
    turns = [matrix[:3, :3] @ np.linalg.inv(rest[:3, :3]) for matrix in matrices]
    return all(np.abs(turn.T @ turn - np.eye(3)).max() < ROUND_OFF and np.linalg.det(turn) > 0.0 for turn in turns)


def rigid_motion(rest: np.ndarray, seconds: np.ndarray, matrices: Sequence[np.ndarray]) -> Motion | None:
    """The motion that takes placement ``rest`` through ``matrices`` at ``seconds``, a key each; None if it stays.

    The matrices must be rigid, see :func:`are_rigid`.
    """
    if len(matrices) == 0:
        return None
    positions = np.array([matrix[:3, 3] - rest[:3, 3] for matrix in matrices])
    turns = [matrix[:3, :3] @ np.linalg.inv(rest[:3, :3]) for matrix in matrices]
    motion = Motion(seconds, positions, unwound(turns), pivot=rest[:3, 3])
    return motion if motion.moves else None


def unwound(turns: Sequence[np.ndarray]) -> np.ndarray:
    """Rotation vectors [rad], shape [k, 3], of rotation matrices, each the nearest to the one before.

    A rotation vector is only defined up to whole turns about its axis; this choice lets a wheel roll on.
    """
    vectors = np.zeros((len(turns), 3))
    before = np.zeros(3)
    for k, turn in enumerate(turns):
        rotation = Gf.Matrix3d(*turn.T.ravel().tolist()).GetOrthonormalized().ExtractRotation()
        axis, angle = np.array(rotation.axis), np.radians(rotation.angle)
        if angle < 1e-12:  # any axis will do; take the one it has been turning about
            length = np.linalg.norm(before)
            axis, angle = (before / length if length > 0.0 else axis), 0.0
        whole_turns = np.round((before @ axis - angle) / (2.0 * np.pi))
        vectors[k] = before = (angle + 2.0 * np.pi * whole_turns) * axis
    return vectors
