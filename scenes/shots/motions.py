"""Motions of pins and obstacles as notes in a stage: in seconds from the start, in the moved prim's own frame."""

from collections.abc import Sequence

import numpy as np
from pxr import Sdf, Usd

from warpcloth.errors import InputError, UsdError
from warpcloth.motion import Motion
from warpcloth.transforms import apply

from .notes import double_vectors, doubles, note, noted

NEAR = 1e-5  # relative to how far things are moved, and in radians


def note_motion(prim: Usd.Prim, motion: Motion | None, matrix: np.ndarray) -> None:
    """Notes the keys of a motion on the prim that it moves: samples cannot say how it eases between two frames.

    Args:
        prim: of an obstacle, or a subset of points.
        motion: in metres and Z up; None: none.
        matrix: from the prim's frame to metres and Z up, 4 × 4.
    """
    if motion is None:
        return
    kinds, to_local = Sdf.ValueTypeNames, np.linalg.inv(matrix)
    note(prim, "motion:times", doubles(motion.times), kinds.DoubleArray)
    note(prim, "motion:positions", double_vectors(motion.positions @ to_local[:3, :3].T), kinds.Double3Array)
    note(prim, "motion:rotations", double_vectors(motion.rotations @ _turn(to_local).T), kinds.Double3Array)
    note(prim, "motion:interpolation", motion.interpolation, kinds.Token)
    note(prim, "motion:loop", bool(motion.loop), kinds.Bool)
    if motion.pivot is not None:
        note(prim, "motion:pivot", doubles(apply(to_local, motion.pivot)), kinds.DoubleArray)


def noted_motion(prim: Usd.Prim, matrix: np.ndarray) -> Motion | None:
    """The motion noted on a prim, or None; ``matrix`` as for :func:`note_motion`.

    Raises:
        UsdError: its keys are not usable.
    """
    times = noted(prim, "motion:times")
    if times is None:
        return None
    keys = (noted(prim, f"motion:{name}") for name in ("positions", "rotations"))
    positions, rotations = (np.zeros((0, 3)) if key is None else np.array(key, float) for key in keys)
    pivot = noted(prim, "motion:pivot")
    try:
        return Motion(
            np.array(times, float), positions @ matrix[:3, :3].T, rotations @ _turn(matrix).T,
            interpolation=noted(prim, "motion:interpolation") or "linear",
            loop=bool(noted(prim, "motion:loop")),
            pivot=None if pivot is None else apply(matrix, np.array(pivot, float)),
        )  # fmt: skip
    except InputError as error:
        raise UsdError(f"The motion noted on {prim.GetPath()} cannot be used: {error}") from error


def _turn(matrix: np.ndarray) -> np.ndarray:
    """What a 4 × 4 matrix does to rotation vectors: they turn with it, and the other way round where it mirrors."""
    scales = np.linalg.norm(matrix[:3, :3], axis=0)
    return matrix[:3, :3] / np.where(scales > 0.0, scales, 1.0) * np.sign(np.linalg.det(matrix[:3, :3]))


def same_motion(
    motion: Motion, centre: np.ndarray, rest: np.ndarray, seconds: Sequence[float], matrices: Sequence[np.ndarray]
) -> bool:
    """Whether a motion takes placement ``rest`` (4 × 4) through ``matrices`` at ``seconds``, but for rounding."""
    turn = max((np.abs(m[:3, :3] - rest[:3, :3]).max() for m in matrices), default=0.0)
    move = max((np.abs(m[:3, 3] - rest[:3, 3]).max() for m in matrices), default=0.0)
    size = np.abs(rest[:3, 3] - centre).max() + move + turn + 1e-3
    moved = [motion.matrix(t, centre) @ rest for t in seconds]
    return all(np.abs(m - n).max() <= NEAR * size for m, n in zip(moved, matrices, strict=True))
