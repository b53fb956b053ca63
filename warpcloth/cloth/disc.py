"""Round cloth: a hexagon of equilateral triangles rounded to concentric rings, in the local xy plane."""

import numpy as np


def disc_points(radius: float, rings: int) -> np.ndarray:
    """The centre, then ring i = 1…rings with 6 i vertices each [m], shape [1 + 3 rings (rings + 1), 3]."""
    parts = [np.zeros((1, 3))]
    for ring in range(1, rings + 1):
        angle = 2.0 * np.pi * np.arange(6 * ring) / (6 * ring)
        r = radius * ring / rings
        parts.append(np.column_stack([r * np.cos(angle), r * np.sin(angle), np.zeros(6 * ring)]))
    return np.concatenate(parts)


def disc_triangles(rings: int) -> np.ndarray:
    """Counter-clockwise triangles, 6 (2 i − 1) between ring i − 1 and ring i, shape [6 rings², 3]."""
    return np.concatenate([_band(ring) for ring in range(1, rings + 1)]).astype(np.int32)


def rim(rings: int) -> np.ndarray:
    """Indices of the outermost ring, shape [6 rings]."""
    return np.arange(_first(rings), _first(rings + 1))


def _band(ring: int) -> np.ndarray:
    """Each of six sectors has ``ring`` triangles standing on the outer ring and ``ring − 1`` on the inner one."""
    sector, step = np.divmod(np.arange(6 * ring), ring)
    outer = np.arange(6 * ring)
    inner = sector * (ring - 1) + step
    standing = np.stack([_on(ring - 1, inner), _on(ring, outer), _on(ring, outer + 1)], axis=1)
    hanging_from = step < ring - 1
    inner, outer = inner[hanging_from], outer[hanging_from]
    hanging = np.stack([_on(ring - 1, inner), _on(ring, outer + 1), _on(ring - 1, inner + 1)], axis=1)
    return np.concatenate([standing, hanging])


def _on(ring: int, position: np.ndarray) -> np.ndarray:
    """Vertex index of a position counted along a ring; positions wrap."""
    return _first(ring) + position % max(1, 6 * ring)


def _first(ring: int) -> int:
    return 0 if ring == 0 else 1 + 3 * ring * (ring - 1)
