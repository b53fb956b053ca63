"""How fabrics look: sheen, light that comes through, and patterns on their texture coordinates."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

PIXELS = 256  # of one repeat of a pattern
WHITE = 0.8  # reflectance of undyed thread


@dataclass(frozen=True)
class Look:
    """Sheen and translucency, see :class:`warpcloth.render.surface.Surface`."""

    sheen: float
    translucency: float


LOOKS = {
    "silk": Look(0.50, 0.16),
    "satin": Look(0.55, 0.10),
    "velvet": Look(0.80, 0.02),
    "chiffon": Look(0.25, 0.40),
    "leather": Look(0.30, 0.0),
    "denim": Look(0.22, 0.03),
    "canvas": Look(0.15, 0.05),
    "wool": Look(0.35, 0.05),
}
COTTON = Look(0.22, 0.14)


def look_of(fabric: str) -> Look:
    """The look of a fabric by the words in its name; that of cotton for others."""
    return next((look for word, look in LOOKS.items() if word in fabric.lower()), COTTON)


Pattern = tuple[np.ndarray, np.ndarray]


def _weave(x: np.ndarray, y: np.ndarray) -> Pattern:
    """Plain weave, 4 threads each way, alternately on top."""
    on_top = (np.floor(4 * x) + np.floor(4 * y)) % 2 == 0
    across, along = np.sin(np.pi * (4 * y % 1.0)), np.sin(np.pi * (4 * x % 1.0))
    return np.ones_like(x), 0.84 + 0.16 * np.sqrt(np.where(on_top, across, along))


def _gingham(x: np.ndarray, y: np.ndarray) -> Pattern:
    """Woven checks: stripes each way, of full colour where two cross."""
    return 0.5 * ((x < 0.5).astype(float) + (y < 0.5)), np.ones_like(x)


def _stripes(x: np.ndarray, y: np.ndarray) -> Pattern:
    return (x < 0.5).astype(float), np.ones_like(x)


def _dots(x: np.ndarray, y: np.ndarray) -> Pattern:
    dots = np.minimum(np.hypot(x - 0.25, y - 0.25), np.hypot(x - 0.75, y - 0.75)) < 0.12
    return 1.0 - dots, np.ones_like(x)


def _windowpane(x: np.ndarray, y: np.ndarray) -> Pattern:
    lines = np.minimum(np.abs(x - 0.5), np.abs(y - 0.5)) < 0.035
    return 1.0 - 0.8 * lines, np.ones_like(x)


# name: (share of dyed thread and shade over one repeat, size of the repeat [m])
PATTERNS: dict[str, tuple[Callable[[np.ndarray, np.ndarray], Pattern], float]] = {
    "weave": (_weave, 0.012),
    "gingham": (_gingham, 0.05),
    "stripes": (_stripes, 0.06),
    "dots": (_dots, 0.08),
    "windowpane": (_windowpane, 0.08),
}
PATTERN_NAMES = ("plain", *PATTERNS)


def pattern_image(name: str, color: Sequence[float] | np.ndarray) -> np.ndarray:
    """One repeat of a pattern in a linear colour, relative to :data:`WHITE`; sRGB, uint8, shape [PIXELS, PIXELS, 3]."""
    steps = (np.arange(PIXELS) + 0.5) / PIXELS
    dyed, shade = PATTERNS[name][0](*np.meshgrid(steps, steps))
    mixed = dyed[..., None] * np.array(color) + (1.0 - dyed[..., None]) * WHITE
    encoded = np.clip(mixed * shade[..., None] / WHITE, 0.0, 1.0) ** (1.0 / 2.2)
    return np.round(255.0 * encoded).astype(np.uint8)


def pattern_uvs(name: str, rest: np.ndarray, triangles: np.ndarray, uvs: np.ndarray) -> np.ndarray:
    """Texture coordinates (m, 3, 2) scaled so that a repeat of the pattern has its size on the cloth at rest [m]."""
    edges = rest[triangles[:, 1:]] - rest[triangles[:, :1]]
    spans = uvs[:, 1:] - uvs[:, :1]
    usable = np.abs(np.linalg.det(spans)) > 1e-12
    if not usable.any():
        return uvs
    along = np.linalg.solve(spans[usable], edges[usable])  # metres along u and along v, per triangle
    meters = np.median(np.linalg.norm(along, axis=2), axis=0)
    return uvs * np.maximum(1.0, np.round(meters / PATTERNS[name][1]))
