"""Springs and bending of triangle meshes: all moduli of the fabric in every direction, and what a mesh cannot have."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import Delaunay

import warpcloth as wc
from warpcloth.cloth.springs import SHEAR
from warpcloth.errors import FabricWarning, InputError
from warpcloth.meshes.trianglemesh import TriangleMesh
from warpcloth.stability import bending_rates

RESOLUTIONS = [6, 9, 13]


def irregular(cells: int, seed: int = 0, size: tuple[float, float] = (1.0, 0.6)) -> trimesh.Trimesh:
    """A rectangle of triangles of random shapes; its border is even."""
    rng, (width, height) = np.random.default_rng(seed), size
    x, y = np.linspace(0.0, width, cells + 1), np.linspace(0.0, height, round(cells * height / width) + 1)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    inner = np.all((points > 1e-9) & (points < np.array(size) - 1e-9), axis=1)
    points[inner] += rng.uniform(-0.3, 0.3, (inner.sum(), 2)) * width / cells
    return trimesh.Trimesh(np.column_stack([points, np.zeros(len(points))]), Delaunay(points).simplices, process=False)


def responses(cloth: wc.Cloth) -> tuple[float, float, float]:
    """Young's moduli along x and y and the shear modulus [N/m] that linear tests of the network measure."""
    p, net = cloth.points[:, :2], cloth.springs
    n, d = len(p), p[net.indices[:, 1]] - p[net.indices[:, 0]]
    rows = np.zeros((len(d), n, 2))
    unit = d / np.linalg.norm(d, axis=1)[:, None]
    for end, sign in ((0, -1.0), (1, 1.0)):
        rows[np.arange(len(d)), net.indices[:, end]] += sign * unit
    rows = rows.reshape(len(d), -1)
    k = rows.T @ ((net.stiffness / net.rest_lengths)[:, None] * rows)
    width, height = np.ptp(p, axis=0)

    def work(held: np.ndarray, u: np.ndarray) -> float:
        free = np.setdiff1d(np.arange(2 * n), held)
        full = np.zeros(2 * n)
        full[held] = u
        full[free] = -np.linalg.lstsq(k[np.ix_(free, free)], k[np.ix_(free, held)] @ u, rcond=1e-12)[0]
        return float(full @ k @ full)

    moduli = []
    for axis, (length, across) in enumerate(((width, height), (height, width))):
        low, high = (np.flatnonzero(np.abs(p[:, axis] - v) < 1e-9) for v in (p[:, axis].min(), p[:, axis].max()))
        held = np.concatenate([2 * low + axis, 2 * high + axis, [2 * low[0] + 1 - axis]])
        u = np.concatenate([np.zeros(len(low)), np.full(len(high), length), [0.0]])
        moduli.append(work(held, u) / (length * across))
    border = np.flatnonzero(np.any((p < p.min(axis=0) + 1e-9) | (p > p.max(axis=0) - 1e-9), axis=1))
    u = np.stack([p[border, 1], np.zeros(len(border))], axis=1).ravel()
    held = np.stack([2 * border, 2 * border + 1], axis=1).ravel()
    return moduli[0], moduli[1], work(held, u) / (width * height)


@pytest.mark.parametrize("cells", RESOLUTIONS)
@pytest.mark.parametrize("moduli", [(400.0, 400.0, 150.0), (400.0, 400.0, 80.0), (500.0, 300.0, 120.0)])
def test_fitted_springs_have_the_moduli_at_any_resolution_of_an_irregular_mesh(cells, moduli):
    fabric = wc.Fabric(
        stretch_stiffness=moduli[0], stretch_stiffness_weft=moduli[1], shear_stiffness=moduli[2], bend_stiffness=0.0
    )
    cloth = wc.Cloth.from_mesh(irregular(cells), fabric, springs="fitted")
    np.testing.assert_allclose(responses(cloth), moduli, rtol=0.02)
    assert cloth.springs.stiffness.min() > 0.0
    assert len(cloth.springs) < 10 * len(cloth.points)


def test_fit_does_not_depend_on_the_place_of_the_mesh_nor_on_its_size():
    fabric = wc.Fabric(bend_stiffness=0.0)
    mesh = irregular(6)
    plain = wc.Cloth.from_mesh(mesh, fabric, springs="fitted").springs
    turn = np.diag([10.0, 10.0, 10.0, 1.0])
    turn[:3, 3] = (5.0, -3.0, 2.0)
    large = wc.Cloth.from_mesh(mesh, fabric, transform=turn, springs="fitted").springs
    np.testing.assert_allclose(large.stiffness, 10.0 * plain.stiffness, rtol=1e-6)


def test_fitted_springs_follow_a_curved_surface():
    ball = trimesh.creation.icosphere(3, 0.3)
    cloth = wc.Cloth.from_mesh(ball, wc.Fabric(shear_stiffness=150.0, bend_stiffness=0.0), springs="fitted")
    d = cloth.points[cloth.springs.indices[:, 1]] - cloth.points[cloth.springs.indices[:, 0]]
    across = np.abs(np.sum(d * cloth.points[cloth.springs.indices[:, 0]], axis=1)) / np.linalg.norm(d, axis=1) / 0.3
    assert across.max() < 0.5
    grown = 0.5 * np.sum(cloth.springs.stiffness * cloth.springs.rest_lengths) * 0.01**2
    assert grown == pytest.approx(0.5 * (400.0 / (1.0 - 1.0 / 3.0)) * 2.0 * 0.01**2 * cloth.area, rel=0.02)


def test_edges_alone_have_one_modulus_and_the_other_follows():
    mesh = irregular(16, 3)
    stretch = wc.Cloth.from_mesh(mesh, wc.Fabric(bend_stiffness=0.0))
    shear = wc.Cloth.from_mesh(mesh, wc.Fabric(bend_stiffness=0.0), springs="shear")
    assert np.count_nonzero(stretch.springs.kinds == SHEAR) == 0
    np.testing.assert_allclose(shear.springs.stiffness * 400.0, stretch.springs.stiffness * 80.0 * 8.0 / 3.0)
    assert np.mean(responses(stretch)[:2]) == pytest.approx(400.0, rel=0.08)


def test_limits_of_springs_are_said():
    fabric = wc.library_fabric("cotton")
    with pytest.warns(FabricWarning, match=r"'cotton' should have .* shear stiffness of 56 N/m, but springs .* give"):
        wc.Cloth.from_mesh(irregular(8), fabric, springs="fitted")
    right = wc.Cloth.grid((1, 1), (9, 9), diagonals="same")
    mesh = trimesh.Trimesh(right.points, right.triangles, process=False)
    with pytest.warns(FabricWarning, match=r"stretches [0-9.]+ times as easily in one direction of this mesh as"):
        wc.Cloth.from_mesh(mesh)
    with pytest.raises(InputError, match="springs must be one of 'stretch', 'shear', 'fitted', 'woven'"):
        wc.Cloth.disc(springs="fit")


@pytest.mark.parametrize("gap", [1e-3, 1e-4, 5e-5, 1e-6])
def test_a_crease_that_the_mesh_cannot_follow_is_no_stiffer_than_it_can(gap):
    """A hem: the cloth turns back within one cell, and lies over itself by ``gap``."""
    cloth = wc.Cloth.grid((0.3, 0.3), (31, 21))
    flat = cloth.points
    hem = flat.copy()
    over = flat[:, 0] > 1e-9
    hem[over, 0] *= -1.0
    hem[over, 2] += gap
    fabric = wc.Fabric(bending_rigidity=1e-5, bend_stiffness=0.0)
    rates = []
    for points in (flat, hem):
        mesh = TriangleMesh(points, cloth.triangles)
        model = wc.Model.build([wc.Cloth.from_mesh(mesh, fabric=fabric, springs="woven")], device="cpu")
        rates.append(bending_rates(model)[0, 0])
    assert rates[0] > 0.0
    assert rates[1] < 3.0 * rates[0]
