"""What is measured, and how often."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import warpcloth as wc
from warpcloth import validate

PARTS = ("hang", "drape", "throughput", "output", "profile", "scaling", "startup")
SLOW_PARTS = ("scaling", "startup")  # minutes each; measured when asked for
PEERS = ("newton_semi_implicit", "newton_style3d", "blender")
FEWEST, MOST = 4, 1024  # vertices along an edge
REPEATS, QUICK_REPEATS = 5, 2
QUICK_FRAMES = 12
SCALING_SIZES = {"explicit": (16, 32, 64, 128, 256, 512), "hang": (16, 32, 64, 128, 256, 512), "drape": (32, 64, 128)}


@dataclass(frozen=True)
class Effort:
    """A selection; made by :func:`effort`.

    Attributes:
        parts: of :data:`PARTS`. rows: integrators, and peers, of ``hang`` and ``drape``; None: XPBD and those peers
            that run the scene.
        resolutions: vertices along an edge in ``hang`` and ``drape``; the first one in ``output`` and ``profile``.
        networks: the same in ``throughput``. sizes: the same in ``scaling``, by problem.
        frames: of each scene; None: as many as it has.
        repeats: timed runs of each row, of which the median counts.
    """

    parts: tuple[str, ...]
    rows: tuple[str, ...] | None
    resolutions: tuple[int, ...]
    networks: tuple[int, ...]
    sizes: dict[str, tuple[int, ...]]
    frames: int | None
    repeats: int


def effort(
    parts: Sequence[str] | None = None,
    rows: Sequence[str] | None = None,
    resolution: Any = None,
    frames: Any = None,
    quick: bool = False,
) -> Effort:
    """What a run is to measure.

    Args:
        parts: of :data:`PARTS`; None: all but the slow ones.
        rows: integrators, or of :data:`PEERS`; None: XPBD and, unless ``quick``, the peers.
        resolution: vertices along an edge; None: 64 and 128, of the explicit step alone 128 and 256.
        frames: of each scene; None: all. quick: smaller, shorter, fewer repeats.

    Raises:
        InputError: an unknown part or row, a number out of range.
    """
    usual = tuple(part for part in PARTS if part not in SLOW_PARTS)
    chosen = usual if parts is None else tuple(validate.choice(part, PARTS, "part") for part in parts)
    if rows is not None:
        names = (*wc.integrators(), *PEERS)
        rows = tuple(dict.fromkeys(validate.choice(name, names, "integrator") for name in rows))
    elif quick:
        rows = ("xpbd",)
    if frames is not None:
        frames = validate.integer(frames, "frames", minimum=2, maximum=10_000)
    resolutions, networks, sizes = _sizes(resolution, quick)
    return Effort(
        tuple(dict.fromkeys(chosen)),
        rows,
        resolutions,
        networks,
        sizes,
        QUICK_FRAMES if quick and frames is None else frames,
        QUICK_REPEATS if quick else REPEATS,
    )


def _sizes(resolution: Any, quick: bool) -> tuple[tuple[int, ...], tuple[int, ...], dict[str, tuple[int, ...]]]:
    if resolution is not None:
        n = validate.integer(resolution, "resolution", minimum=FEWEST, maximum=MOST)
        pair = tuple(dict.fromkeys((max(FEWEST, n // 2), n)))
        return (n,), (n,), dict.fromkeys(SCALING_SIZES, pair)
    if quick:
        return (32,), (64,), dict.fromkeys(SCALING_SIZES, (16, 32))
    return (64, 128), (128, 256), SCALING_SIZES
