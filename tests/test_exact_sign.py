"""Signs of areas and volumes against fractions, where rounding alone would decide."""

from fractions import Fraction

import numpy as np
import warp as wp
from warpcloth.kernels import KernelSet

exact_sign = KernelSet("float64").exact_sign


@wp.kernel
def turns(points: wp.array2d(dtype=wp.vec2d), out: wp.array(dtype=wp.int32)):
    k = wp.tid()
    out[k] = exact_sign.turn(points[k, 0], points[k, 1], points[k, 2])


@wp.kernel
def sides(points: wp.array2d(dtype=wp.vec3d), out: wp.array(dtype=wp.int32)):
    k = wp.tid()
    out[k] = exact_sign.side(points[k, 0], points[k, 1], points[k, 2], points[k, 3])


def found(kernel: wp.Kernel, points: np.ndarray, dtype: type) -> list[int]:
    out = wp.zeros(len(points), dtype=wp.int32, device="cpu")
    wp.launch(kernel, len(points), [wp.array(points, dtype=dtype, device="cpu")], [out], device="cpu")
    return out.numpy().tolist()


def expected(points: np.ndarray) -> list[int]:
    """Sign of the determinant of the differences from the last point."""

    def sign(corners: np.ndarray) -> int:
        *rows, last = [[Fraction(x) for x in corner] for corner in corners.tolist()]
        m = [[x - y for x, y in zip(row, last, strict=True)] for row in rows]
        if len(m) == 2:
            d = m[0][0] * m[1][1] - m[0][1] * m[1][0]
        else:
            d = sum(m[0][i] * (m[1][i - 2] * m[2][i - 1] - m[1][i - 1] * m[2][i - 2]) for i in range(3))
        return (d > 0) - (d < 0)

    return [sign(corners) for corners in points]


def nearly_flat(size: int, dimension: int) -> np.ndarray:
    """Points of which the last is where float64 has it on the line or plane of the others, near them or far."""
    rng = np.random.default_rng(dimension)
    scales = 2.0 ** rng.integers(-20, 20, size=(size, dimension, 1))
    corners = scales * rng.normal(size=(size, dimension, dimension))
    shares = rng.dirichlet(np.ones(dimension), size=size) * rng.choice([1.0, 3.0], size=(size, 1))
    shares[:, 0] += 1.0 - shares.sum(axis=1)
    last = np.einsum("nk,nkd->nd", shares, corners)
    return np.concatenate([corners, last[:, None]], axis=1)


def test_areas_have_the_sign_of_their_fractions():
    points = nearly_flat(2000, 2)
    signs = expected(points)
    assert min(signs.count(1), signs.count(-1)) > 500
    assert found(turns, points, wp.vec2d) == signs


def test_volumes_have_the_sign_of_their_fractions():
    points = nearly_flat(2000, 3)
    signs = expected(points)
    assert min(signs.count(1), signs.count(-1)) > 500
    assert found(sides, points, wp.vec3d) == signs


def test_what_is_flat_has_no_side():
    """Multiples of one step along a line, and of two in a plane, with products far beyond 53 bits."""
    rng = np.random.default_rng(0)
    step, other = rng.integers(2**45, 2**46, size=(2, 200, 1, 3)).astype(float)
    times, shares = rng.integers(-30, 30, size=(2, 200, 4, 1))
    assert found(turns, (times * step)[:, :3, :2], wp.vec2d) == [0] * 200
    assert found(sides, times * step + shares * other, wp.vec3d) == [0] * 200
