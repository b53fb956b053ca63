"""Closest points of a point and a triangle, and of two segments; always finite, whatever the degeneracy.

Both return how the distance vector is made from four points, as weights (w₀, w₁, w₂, w₃) with d = Σ wₖ xₖ: for a point
and a triangle (1, −α, −β, −γ), for two segments (1−s, s, −(1−t), −t). What comes after treats the two cases alike.
"""

import warp as wp

Four = wp.types.matrix(shape=(4, 3), dtype=wp.float64)  # the points of a pair, or their ways, one in each row [m]


@wp.func
def combine(w: wp.vec4d, x: Four):
    """Σ wₖ xₖ."""
    return w[0] * x[0] + w[1] * x[1] + w[2] * x[2] + w[3] * x[3]


@wp.func
def from_mean(u: Four):
    """Motions of four points relative to their mean."""
    mean = wp.float64(0.25) * (u[0] + u[1] + u[2] + u[3])
    return wp.matrix_from_rows(u[0] - mean, u[1] - mean, u[2] - mean, u[3] - mean)


@wp.func
def reach_of(kind: int, u: Four):
    """By how much the two features of a pair can come nearer to each other while their points move by u [m]."""
    first = wp.length(u[0])
    second = wp.max(wp.length(u[2]), wp.length(u[3]))
    if kind == 0:
        second = wp.max(second, wp.length(u[1]))
    else:
        first = wp.max(first, wp.length(u[1]))
    return first + second


@wp.func
def segment_parameter(p: wp.vec3d, a: wp.vec3d, b: wp.vec3d):
    """Parameter in [0, 1] of the point of segment a–b closest to p; 0 for a segment of no length."""
    ab = b - a
    squared = wp.dot(ab, ab)
    t = wp.float64(0.0)
    if squared > wp.float64(0.0):
        t = wp.clamp(wp.dot(p - a, ab) / squared, wp.float64(0.0), wp.float64(1.0))
    return t


@wp.func
def closer_edge(p: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d):
    """Weights of the point on the triangle's border closest to p."""
    one = wp.float64(1.0)
    zero = wp.float64(0.0)
    x = wp.matrix_from_rows(p, a, b, c)
    t = segment_parameter(p, a, b)
    weights = wp.vec4d(one, t - one, -t, zero)
    nearest = wp.length_sq(combine(weights, x))
    t = segment_parameter(p, b, c)
    other = wp.vec4d(one, zero, t - one, -t)
    squared = wp.length_sq(combine(other, x))
    if squared < nearest:
        nearest = squared
        weights = other
    t = segment_parameter(p, c, a)
    other = wp.vec4d(one, -t, zero, t - one)
    if wp.length_sq(combine(other, x)) < nearest:
        weights = other
    return weights


@wp.func
def point_triangle(p: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d):
    """Weights of p − (closest point of the triangle a, b, c)."""
    zero = wp.float64(0.0)
    u = b - a
    v = c - a
    n = wp.cross(u, v)
    area = wp.dot(n, n)
    if area > wp.float64(1.0e-24) * wp.dot(u, u) * wp.dot(v, v):
        beta = wp.dot(wp.cross(p - a, v), n) / area
        gamma = wp.dot(wp.cross(u, p - a), n) / area
        if beta >= zero and gamma >= zero and beta + gamma <= wp.float64(1.0):
            return wp.vec4d(wp.float64(1.0), beta + gamma - wp.float64(1.0), -beta, -gamma)
    return closer_edge(p, a, b, c)


@wp.func
def segment_segment(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, d: wp.vec3d):
    """Weights of (closest point of a–b) − (closest point of c–d) (Ericson 2005, section 5.1.9)."""
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    u = b - a
    v = d - c
    r = a - c
    uu = wp.dot(u, u)
    vv = wp.dot(v, v)
    uv = wp.dot(u, v)
    ur = wp.dot(u, r)
    vr = wp.dot(v, r)
    determinant = uu * vv - uv * uv
    s = zero
    if determinant > wp.float64(1.0e-12) * uu * vv:
        s = wp.clamp((uv * vr - ur * vv) / determinant, zero, one)
    t = zero
    if vv > zero:
        t = (uv * s + vr) / vv
    if t < zero or t > one or determinant <= wp.float64(1.0e-12) * uu * vv:
        t = wp.clamp(t, zero, one)
        s = segment_parameter(c + t * v, a, b)
        t = segment_parameter(a + s * u, c, d)
    return wp.vec4d(one - s, s, t - one, -t)


@wp.func
def pair_weights(kind: int, x: Four):
    """Weights of a pair: kind 0 is point–triangle, kind 1 segment–segment."""
    if kind == 0:
        return point_triangle(x[0], x[1], x[2], x[3])
    return segment_segment(x[0], x[1], x[2], x[3])


@wp.func
def time_of_impact(kind: int, x: Four, u: Four, separation: wp.float64):
    """Fraction of the straight motions x + t u that keeps the pair further than ``separation`` apart; 1 if all of it.

    Additive continuous collision detection (Li, Kaufman, Jiang 2021): only relative motion counts, each advance is by a
    distance that cannot be used up, so the answer is never late. Pairs that start closer keep half their distance.
    """
    way = from_mean(u)
    reach = reach_of(kind, way)
    d = wp.length(combine(pair_weights(kind, x), x))
    keep = wp.min(separation, wp.float64(0.5) * d)
    one = wp.float64(1.0)
    if reach <= d - keep or not wp.isfinite(reach):
        return one
    stop = wp.min(wp.float64(0.1) * (d - keep), wp.float64(10.0) * separation)
    t = wp.float64(0.0)
    advance = wp.float64(0.9) * (d - keep) / reach
    for _i in range(256):
        s = t + advance
        if s > one:
            return one
        y = x + s * way
        d = wp.length(combine(pair_weights(kind, y), y))
        if d - keep <= stop:
            return t
        t = s
        advance = wp.float64(0.9) * (d - keep) / reach
    return t
