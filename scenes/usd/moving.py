"""When the transform of a prim is sampled, and how often one has to look to see the way that it takes."""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np
from pxr import Usd, UsdGeom

from ...errors import UsdError
from .opening import frame_rate

TURN = 3.0  # [°]; a straight way across it leaves the circle by 1/2900 of the radius
PARABOLA = 24  # straight pieces that a parabola is cut into, if it lasts as many frames; they leave it by 1/576 of one
MOST_TURNS = 1e4  # between two samples; more is no motion that anybody has made
SAME = 1e-6  # of a frame, by which rounding may part two time codes that are one
LINEAR = 1e-6  # relative, how far the linear parts of two equal transforms may be apart


def transform_codes(prim: Usd.Prim) -> list[float]:
    """Time codes at which the prim or one of its parents has a sampled transform, sorted.

    A spline counts as sampled at its knots and once a frame between them.
    """
    codes: set[float] = set()
    for xformable in _chain(prim):
        codes.update(xformable.GetTimeSamples())
        for op in xformable.GetOrderedXformOps():
            if op.GetAttr().HasSpline():
                codes.update(frame_codes(prim.GetStage(), list(op.GetAttr().GetSpline().GetKnots().keys())))
    return sorted(codes)


def path_codes(prim: Usd.Prim, deforms: bool = False) -> list[float]:
    """The codes of :func:`transform_codes`, and as many between them that straight ways join them to the prim's path.

    Stages interpolate angles, not places: what turns by 90° from one sample to the next runs along an arc, and what
    turns by 360° comes back to where it was. What moves while it is scaled runs along a parabola.

    Args:
        prim: the prim.
        deforms: whether its points move in its own frame, too.

    Raises:
        UsdError: it turns more often than can be followed.
    """
    codes = transform_codes(prim)
    if not codes:
        return []
    ops = [op for xformable in _chain(prim) for op in xformable.GetOrderedXformOps() if op.MightBeTimeVarying()]
    turns = [op for op in ops if UsdGeom.XformOp.GetOpTypeToken(op.GetOpType()).startswith(("rotate", "orient"))]
    matrices = [op for op in ops if op.GetOpType() == UsdGeom.XformOp.TypeTransform]
    step = _frame(prim.GetStage())

    def pieces(before: float, after: float) -> int:
        angle = sum(_angle(op, before, after) for op in turns)
        if angle > 360.0 * MOST_TURNS:
            what = f"turns by {angle:g}° between time codes {before:g} and {after:g}"
            raise UsdError(f"Prim {prim.GetPath()} {what}, which is too fast to follow.")
        if any(_is_bent(op, before, after) for op in matrices):
            return 1
        changing = [op.GetName() for op in ops if op.Get(before) != op.Get(after)]
        parabola = (deforms or len(changing) > 1) and any("xformOp:scale" in name for name in changing)
        frames = math.ceil((after - before) / step - SAME)
        return max(math.ceil(angle / TURN), min(PARABOLA, frames) if parabola else 1)

    return _split(codes, pieces)


def _chain(prim: Usd.Prim) -> Iterator[UsdGeom.Xformable]:
    """The prim and its parents, those that have transforms."""
    while prim and not prim.IsPseudoRoot():
        if prim.IsA(UsdGeom.Xformable):
            yield UsdGeom.Xformable(prim)
        prim = prim.GetParent()


def frame_codes(stage: Usd.Stage, codes: Sequence[float]) -> list[float]:
    """Time codes in order, and between them as many that none is further than a frame from the next."""
    step = _frame(stage)
    return _split(codes, lambda before, after: math.ceil((after - before) / step - SAME))


def merged(stage: Usd.Stage, *codes: Iterable[float]) -> list[float]:
    """All the time codes, sorted, those that are the same but for rounding once."""
    every = sorted({code for some in codes for code in some})
    apart = SAME * _frame(stage)
    return every[:1] + [after for before, after in itertools.pairwise(every) if after - before > apart]


def _frame(stage: Usd.Stage) -> float:
    """Time codes of a frame; 1 where the stage has no frame rate that is one."""
    rate = frame_rate(stage)
    return stage.GetTimeCodesPerSecond() / rate if 0.0 < rate < math.inf else 1.0


def _split(codes: Sequence[float], pieces: Callable[[float, float], int]) -> list[float]:
    """Time codes in order, and between each two those that cut what is between into so many equal pieces."""
    result = list(codes[:1])
    for before, after in itertools.pairwise(codes):
        result.extend(np.linspace(before, after, max(1, pieces(before, after)) + 1)[1:].tolist())
    return result


def _angle(op: UsdGeom.XformOp, before: float, after: float) -> float:
    """How far a rotation goes from one time code to another [°], at most; 0 where it has no finite value."""
    start, end = op.Get(before), op.Get(after)
    if start is None or end is None:
        return 0.0
    if op.GetOpType() == UsdGeom.XformOp.TypeOrient:
        a, b = (np.array([value.GetReal(), *value.GetImaginary()], float) for value in (start, end))
        cosine = abs(float(a @ b)) / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-300)
        angle = 2.0 * math.degrees(math.acos(min(1.0, cosine))) if math.isfinite(cosine) else 0.0
    else:
        angle = float(np.abs(np.subtract(end, start, dtype=float)).sum())
    return angle if math.isfinite(angle) else 0.0


def _is_bent(op: UsdGeom.XformOp, before: float, after: float) -> bool:
    """Whether a matrix turns between two samples: a stage mixes the two, which squeezes what is between them."""
    values = op.Get(before), op.Get(after)
    if any(value is None for value in values):
        return False
    start, end = (np.array(value, float)[:3, :3] for value in values)
    return bool(np.abs(end - start).max() > LINEAR * np.abs(start).max())
