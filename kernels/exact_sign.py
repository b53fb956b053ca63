"""Exact signs of volumes and areas: on which side of a plane or line a point lies, whatever the rounding.

A determinant in float64 is right when it is larger than its error bound. When it is not, it is summed again as an
expansion, a sum of float64 that do not overlap, which is exact (Shewchuk 1997, Adaptive Precision Floating-Point
Arithmetic and Fast Robust Geometric Predicates). Exact for coordinates whose products neither overflow nor underflow.
"""

import warp as wp

TERMS = 192  # 6 products of 3 factors of 2 parts, each in 4 parts
Expansion = wp.types.vector(TERMS, wp.float64)

VOLUME_BOUND = wp.constant(wp.float64(7.8e-16))  # (7 + 56 ε) ε, ε = 2⁻⁵³: relative to the sum of magnitudes
AREA_BOUND = wp.constant(wp.float64(3.4e-16))  # (3 + 16 ε) ε
LOW_BITS = wp.constant(wp.int64(0x7FFFFFF))
HALF_LOW = wp.constant(wp.int64(0x4000000))


@wp.func
def two_sum(a: wp.float64, b: wp.float64):
    """a + b as rounded, and what that leaves out."""
    s = a + b
    t = s - a
    return wp.vec2d(s, (a - (s - t)) + (b - t))


@wp.func
def upper_half(a: wp.float64):
    """a rounded to 26 bits; by its bits, as compilers may fuse the usual multiplication."""
    bits = wp.cast(a, wp.int64)
    return wp.cast((bits + HALF_LOW) & ~LOW_BITS, wp.float64)


@wp.func
def two_product(a: wp.float64, b: wp.float64):
    """a b as rounded, and what that leaves out."""
    p = a * b
    u = upper_half(a)
    v = upper_half(b)
    x = a - u
    y = b - v
    return wp.vec2d(p, (((u * v - p) + u * y) + x * v) + x * y)


@wp.struct
class Total:
    """An exact sum: ``parts[0:count]``, in order of magnitude, none zero."""

    parts: Expansion
    count: int


@wp.func
def added(total: Total, b: wp.float64):
    """The sum with b added."""
    q = b
    kept = int(0)
    for i in range(total.count):
        s = two_sum(q, total.parts[i])
        q = s[0]
        if s[1] != wp.float64(0.0):
            total.parts[kept] = s[1]
            kept += 1
    if q != wp.float64(0.0):
        total.parts[kept] = q
        kept += 1
    total.count = kept
    return total


@wp.func
def sign_of(x: wp.float64):
    if x > wp.float64(0.0):
        return 1
    if x < wp.float64(0.0):
        return -1
    return 0


@wp.func
def sign_of_total(total: Total):
    if total.count == 0:
        return 0
    return sign_of(total.parts[total.count - 1])


@wp.func
def difference(a: wp.float64, b: wp.float64):
    """a − b exactly, in two parts."""
    return two_sum(a, -b)


@wp.func
def exact_side(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, d: wp.vec3d):
    """Sign of the determinant of (a − d, b − d, c − d), summed exactly."""
    total = Total()
    for k in range(6):
        i = k % 3
        step = 1
        sign = wp.float64(1.0)
        if k > 2:
            step = 2
            sign = wp.float64(-1.0)
        j = (i + step) % 3
        m = (j + step) % 3
        u = difference(a[i], d[i])
        v = difference(b[j], d[j])
        w = difference(c[m], d[m])
        for n in range(8):
            x = u[n & 1]
            y = v[(n >> 1) & 1]
            z = w[n >> 2]
            if x != wp.float64(0.0) and y != wp.float64(0.0) and z != wp.float64(0.0):
                p = two_product(x, y)
                for h in range(2):
                    q = two_product(p[h], sign * z)
                    total = added(total, q[0])
                    total = added(total, q[1])
    return sign_of_total(total)


@wp.func
def side(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, d: wp.vec3d):
    """On which side of the plane a, b, c the point d lies: −1, 0 or 1; exactly."""
    u = a - d
    v = b - d
    w = c - d
    volume = wp.dot(u, wp.cross(v, w))
    magnitude = (
        wp.abs(u[0]) * (wp.abs(v[1] * w[2]) + wp.abs(v[2] * w[1]))
        + wp.abs(u[1]) * (wp.abs(v[2] * w[0]) + wp.abs(v[0] * w[2]))
        + wp.abs(u[2]) * (wp.abs(v[0] * w[1]) + wp.abs(v[1] * w[0]))
    )
    if wp.abs(volume) > VOLUME_BOUND * magnitude:
        return sign_of(volume)
    return exact_side(a, b, c, d)


@wp.func
def exact_turn(a: wp.vec2d, b: wp.vec2d, c: wp.vec2d):
    """Sign of the determinant of (a − c, b − c), summed exactly."""
    total = Total()
    for i in range(2):
        sign = wp.float64(1.0)
        if i == 1:
            sign = wp.float64(-1.0)
        u = difference(a[i], c[i])
        v = difference(b[1 - i], c[1 - i])
        for n in range(4):
            q = two_product(u[n & 1], sign * v[n >> 1])
            total = added(total, q[0])
            total = added(total, q[1])
    return sign_of_total(total)


@wp.func
def turn(a: wp.vec2d, b: wp.vec2d, c: wp.vec2d):
    """Which way a, b, c turn in the plane: −1, 0 or 1; exactly."""
    left = (a[0] - c[0]) * (b[1] - c[1])
    right = (a[1] - c[1]) * (b[0] - c[0])
    area = left - right
    if wp.abs(area) > AREA_BOUND * (wp.abs(left) + wp.abs(right)):
        return sign_of(area)
    return exact_turn(a, b, c)
