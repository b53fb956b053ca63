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


@wp.func
def sign_of(x: wp.float64):
    if x > wp.float64(0.0):
        return 1
    if x < wp.float64(0.0):
        return -1
    return 0


@wp.func
def difference(a: wp.float64, b: wp.float64):
    """a − b exactly, in two parts."""
    return two_sum(a, -b)


@wp.func
def exact_sum_sign(terms: Expansion, count: int):
    """Sign of the exact sum of the first ``count`` terms.

    ``parts[0:kept]`` is the sum so far: parts that do not overlap, in order of magnitude, none of them zero.
    """
    parts = Expansion()
    kept = int(0)
    for k in range(count):
        q = terms[k]
        n = int(0)
        for i in range(kept):
            s = two_sum(q, parts[i])
            q = s[0]
            if s[1] != wp.float64(0.0):
                parts[n] = s[1]
                n += 1
        if q != wp.float64(0.0):
            parts[n] = q
            n += 1
        kept = n
    if kept == 0:
        return 0
    return sign_of(parts[kept - 1])


@wp.func
def exact_side(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, d: wp.vec3d):
    """Sign of the determinant of (a − d, b − d, c − d), summed exactly.

    One loop over its 6 products of 2 × 2 × 2 parts, with bounds that are no constants: unrolled it would compile for
    minutes.
    """
    terms = Expansion()
    count = int(0)
    products = int(48)
    for k in range(products):
        p = k / 8
        n = k % 8
        step = int(1)
        sign = wp.float64(1.0)
        if p > 2:
            step = 2
            sign = wp.float64(-1.0)
        i = p % 3
        j = (i + step) % 3
        m = (j + step) % 3
        u = difference(a[i], d[i])
        v = difference(b[j], d[j])
        w = difference(c[m], d[m])
        x = u[n & 1]
        y = v[(n >> 1) & 1]
        z = sign * w[n >> 2]
        if x != wp.float64(0.0) and y != wp.float64(0.0) and z != wp.float64(0.0):
            xy = two_product(x, y)
            high = two_product(xy[0], z)
            low = two_product(xy[1], z)
            terms[count] = low[1]
            terms[count + 1] = low[0]
            terms[count + 2] = high[1]
            terms[count + 3] = high[0]
            count += 4
    return exact_sum_sign(terms, count)


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
    if magnitude == wp.float64(0.0):  # each product has a factor that is zero, as in level cloth
        return 0
    return exact_side(a, b, c, d)


@wp.func
def exact_turn(a: wp.vec2d, b: wp.vec2d, c: wp.vec2d):
    """Sign of the determinant of (a − c, b − c), summed exactly; a loop as in :func:`exact_side`."""
    terms = Expansion()
    count = int(0)
    products = int(8)
    for k in range(products):
        i = k / 4
        n = k % 4
        sign = wp.float64(1.0)
        if i == 1:
            sign = wp.float64(-1.0)
        u = difference(a[i], c[i])
        v = difference(b[1 - i], c[1 - i])
        q = two_product(u[n & 1], sign * v[n >> 1])
        terms[count] = q[1]
        terms[count + 1] = q[0]
        count += 2
    return exact_sum_sign(terms, count)


@wp.func
def turn(a: wp.vec2d, b: wp.vec2d, c: wp.vec2d):
    """Which way a, b, c turn in the plane: −1, 0 or 1; exactly."""
    left = (a[0] - c[0]) * (b[1] - c[1])
    right = (a[1] - c[1]) * (b[0] - c[0])
    area = left - right
    if wp.abs(area) > AREA_BOUND * (wp.abs(left) + wp.abs(right)):
        return sign_of(area)
    return exact_turn(a, b, c)
