"""The exact check of intersections against two independent libraries, and against integers where all is touching."""

import itertools
from fractions import Fraction

import igl
import ipctk
import numpy as np
import pytest
import warp as wp
from hypothesis import example, given, settings
from hypothesis import strategies as st
from warpcloth.kernels import KernelSet

import warpcloth as wc
from warpcloth.errors import BadStartError
from warpcloth.intersections import count_intersections, intersections

PAIR = np.array([[0, 1, 2], [3, 4, 5]])


def ours(points: np.ndarray) -> np.ndarray:
    """Verdict for each of many pairs of triangles; points have shape [n, 6, 3]. One world each."""
    n = len(points)
    device = wp.get_device("cpu")
    kernels = KernelSet("float64").intersections
    tri = wp.array((PAIR[None] + 6 * np.arange(n)[:, None, None]).reshape(-1, 3), dtype=wp.int32, device=device)
    q = wp.array(points.reshape(-1, 3), dtype=wp.vec3d, device=device)
    lower, upper = (wp.zeros(2 * n, dtype=wp.vec3, device=device) for _ in range(2))
    wp.launch(kernels.triangle_bounds, dim=2 * n, inputs=[tri, q], outputs=[lower, upper], device=device)
    count = wp.zeros((n, 2), dtype=wp.int32, device=device)
    world = wp.array(np.repeat(np.arange(n), 6), dtype=wp.int32, device=device)
    bvh = wp.Bvh(lower, upper, groups=wp.array(np.repeat(np.arange(n), 2), dtype=wp.int32, device=device))
    inputs = [tri, world, 2 * n, q, lower, upper, bvh.id]
    wp.launch(kernels.count_intersections, dim=2 * n, inputs=inputs, outputs=[count], device=device)
    assert not count.numpy()[:, 1].any()
    return count.numpy()[:, 0] > 0


def by_igl(points: np.ndarray) -> bool:
    return bool(igl.tri_tri_intersection_test_3d(*points[:, None])[0])


def test_random_pairs_agree_with_libigl():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(4000, 6, 3)) * rng.choice([1e-3, 1.0, 50.0], size=(4000, 1, 1))
    points[:, :3] += rng.normal(size=(4000, 1, 3)) * 0.3 * np.abs(points).max(axis=(1, 2), keepdims=True)
    expected = np.array([by_igl(p) for p in points])
    assert 400 < expected.sum() < 3600
    assert np.array_equal(ours(points), expected)


def exactly(points: np.ndarray) -> bool:
    """Whether two closed triangles with whole coordinates meet: by linear programming's vertices, in fractions.

    They meet if and only if an edge of one meets the other, and a segment meets a triangle in a vertex of the set of
    their common points, which is found by trying all ways to solve for it.
    """
    s, t = points[:3], points[3:]
    return any(_meets(a[i], a[(i + 1) % 3], b) for a, b in ((s, t), (t, s)) for i in range(3))


def _meets(p, q, tri) -> bool:
    """Unknowns (λ, β, γ) with p + λ(q − p) = a + β(b − a) + γ(c − a) in the box and simplex."""
    a, b, c = ([Fraction(int(x)) for x in v] for v in tri)
    p, q = ([Fraction(int(x)) for x in v] for v in (p, q))
    rows = [([q[k] - p[k], a[k] - b[k], a[k] - c[k]], a[k] - p[k]) for k in range(3)]
    # λ ≥ 0, λ ≤ 1, β ≥ 0, γ ≥ 0, β + γ ≤ 1; any point of the feasible set implies a basic one
    bounds = [([1, 0, 0], 0), ([1, 0, 0], 1), ([0, 1, 0], 0), ([0, 0, 1], 0), ([0, 1, 1], 1)]
    planes = rows + [([Fraction(x) for x in n], Fraction(v)) for n, v in bounds]
    for chosen in itertools.combinations(planes, 3):
        x = _solve(chosen)
        if x is not None and all(sum(n * y for n, y in zip(row, x, strict=True)) == v for row, v in rows):
            lam, beta, gamma = x
            if 0 <= lam <= 1 and beta >= 0 and gamma >= 0 and beta + gamma <= 1:
                return True
    return False


def _solve(system):
    """The solution of three equations in fractions, by Cramer's rule; None where there is not exactly one."""

    def det(m):
        return (
            m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1])
            - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
            + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0])
        )

    matrix = [list(n) for n, _ in system]
    whole = det(matrix)
    if whole == 0:
        return None
    replaced = [[[v if j == k else n[j] for j in range(3)] for n, v in system] for k in range(3)]
    return [det(m) / whole for m in replaced]


@settings(max_examples=150)
@given(st.lists(st.integers(-2, 2), min_size=18, max_size=18), st.sampled_from([1.0, 2.0**-20, 1024.0]))
@example([0, 0, 0, 1, 1, 1, 2, 2, 2, -2, -2, -2, -1, -1, -1, 2, 1, 2], 1.0)  # without area, and ahead of an edge
def test_touching_coplanar_and_degenerate_pairs_are_exact(values, scale):
    """On so small a grid nearly all pairs touch, share a plane, or have no area."""
    points = np.array(values, float).reshape(6, 3)
    assert ours(scale * points[None])[0] == exactly(points)


@settings(max_examples=200)
@given(seed=st.integers(0, 10**6), lift=st.integers(-3, 3))
def test_nearly_touching_pairs_are_told_apart_by_the_last_bit(seed, lift):
    """A vertex on another triangle's plane, lifted by single units of the last place."""
    rng = np.random.default_rng(seed)
    plane = rng.integers(1, 2**20, size=(3, 3)).astype(float)
    plane[:, 2] = 2.0**20  # parallel to the ground, so that height above it is exact
    above = plane.mean(axis=0).round() + np.array([[0, 0, 0], [2, 0, 9], [0, 2, 9.0]])
    above[0, 2] = 2.0**20
    for _ in range(abs(lift)):
        above[0, 2] = np.nextafter(above[0, 2], np.inf if lift > 0 else -np.inf)
    turn = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0.0]])  # exact
    points = np.vstack([plane, above]) @ turn
    if abs(np.cross(plane[1] - plane[0], plane[2] - plane[0])[2]) > 1e8:
        assert ours(points[None])[0] == (lift <= 0)


@pytest.mark.parametrize("seed", range(12))
def test_crumpled_meshes_agree_with_ipctk(seed):
    """Also pairs with a common vertex, which libigl's test of single pairs does not know."""
    rng = np.random.default_rng(seed)
    cloth = wc.Cloth.grid(size=(1, 1), resolution=(13, 13))
    points = cloth.points * [1, 1, 1] + rng.normal(scale=[0.01, 0.03, 0.06][seed % 3], size=cloth.points.shape)
    edges = ipctk.edges(cloth.triangles)
    mesh = ipctk.CollisionMesh(points, edges, cloth.triangles)
    count, _ = count_intersections(points, cloth.triangles)
    assert (count > 0) == ipctk.has_intersections(mesh, points)


def test_counts_agree_with_libigl_over_a_mesh():
    rng = np.random.default_rng(5)
    cloth = wc.Cloth.grid(size=(1, 1), resolution=(10, 10))
    points = cloth.points + rng.normal(scale=0.06, size=cloth.points.shape)
    pairs = [
        (s, t) for i, s in enumerate(cloth.triangles.tolist()) for t in cloth.triangles[:i].tolist() if not {*s} & {*t}
    ]
    expected = sum(by_igl(points[[*s, *t]]) for s, t in pairs)
    assert expected > 20
    alone = count_intersections(points[np.array(pairs).reshape(-1, 6)].reshape(-1, 3)[:0], np.zeros((0, 3), int))
    assert alone == (0, 0)
    separate = points[np.array([[*s, *t] for s, t in pairs])]
    assert int(ours(separate).sum()) == expected


def test_obstacles_are_counted_apart_and_where_they_are():
    """A box that comes up through the cloth between its particles."""
    up = wc.Motion([0.0, 1.0], [[0, 0, 0], [0, 0, 0.5]], np.zeros((2, 3)))
    box = wc.Box((0.05, 0.05, -0.3), (0.02, 0.02, 0.5), motion=up)
    model = wc.Model.build(wc.Cloth.grid(size=(1, 1), resolution=(6, 6)), box)
    sim = wc.Simulation(model, gravity=(0, 0, 0), contact="none", substeps=1, integrator="xpbd")
    assert intersections(model, sim.state).tolist() == [[0, 0]]
    sim.step(1.0)
    cloth, solid = intersections(model, sim.state)[0]
    assert cloth == 0
    assert solid >= 8  # four walls of two triangles
    metrics = sim.metrics()
    assert (metrics["intersections"], metrics["obstacle_intersections"]) == (0, solid)


def test_a_start_in_an_obstacle_is_refused_by_its_edges():
    box = wc.Box((0.05, 0.05, 0.0), (0.02, 0.02, 0.5))
    model = wc.Model.build(wc.Cloth.grid(size=(1, 1), resolution=(6, 6)), box)
    with pytest.raises(BadStartError, match=r"'cloth', [0-9]+ with triangles of obstacles"):
        wc.Simulation(model, contact="all")
