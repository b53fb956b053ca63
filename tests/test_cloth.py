"""Cloth: geometry, masses, springs that stand for the same fabric at any resolution, pins."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from warpcloth import Model, Simulation
from warpcloth.cloth import BEND, SHEAR, STRUCTURAL, Cloth
from warpcloth.errors import MeshError
from warpcloth.fabric import Fabric
from warpcloth.transforms import placement

pytestmark = pytest.mark.filterwarnings("ignore::warpcloth.errors.FabricWarning")  # long cells are made on purpose

Y, G = 400.0, 80.0
MEMBRANE = Fabric(stretch_stiffness=Y, shear_stiffness=G, bend_stiffness=0.0)
C = 0.5 * (Y + np.sqrt(Y * Y + 4 * G * G))  # tensor component along the threads, at Poisson's ratio G/C
SQUEEZE = np.diag([1.0, -G / C])  # what pulling along x does to a sheet that is free along y
RESOLUTIONS = [(2, 2), (3, 5), (5, 3), (9, 17), (33, 33)]


def energy(cloth: Cloth, strain: np.ndarray) -> float:
    """Second-order energy [J] of the flat cloth under a uniform small strain (2, 2), by the spring law."""
    net = cloth.springs
    along = cloth.points[net.indices[:, 1], :2] - cloth.points[net.indices[:, 0], :2]
    along /= np.linalg.norm(along, axis=1)[:, None]
    e = np.einsum("si,ij,sj->s", along, strain, along)
    return float(0.5 * np.sum(net.stiffness * net.rest_lengths * e**2))


# Resolution must not matter


@pytest.mark.parametrize("resolution", RESOLUTIONS)
@pytest.mark.parametrize("size", [(1.0, 1.0), (0.6, 1.1)])
def test_grid_has_the_moduli_of_its_fabric(resolution, size):
    dx, dy = size[0] / (resolution[0] - 1), size[1] / (resolution[1] - 1)
    cloth = Cloth.grid(size, resolution, MEMBRANE)
    area = size[0] * size[1]
    if max(dx / dy, dy / dx) < 2.0:  # longer cells cannot have all of G
        assert energy(cloth, SQUEEZE) == pytest.approx(0.5 * Y * area, rel=1e-12)
        assert energy(cloth, SQUEEZE[::-1, ::-1]) == pytest.approx(0.5 * Y * area, rel=1e-12)
        assert energy(cloth, np.array([[0, 0.5], [0.5, 0]])) == pytest.approx(0.5 * G * area, rel=1e-12)


@given(aspect=st.floats(1.0, 50.0), shear=st.floats(0.1, 400.0))
def test_young_modulus_holds_in_cells_of_any_shape(aspect, shear):
    cloth = Cloth.grid((1.0, 1.0 / aspect), (4, 4), replace(MEMBRANE, shear_stiffness=shear))
    exact = np.diag([1.0, 0.0])
    xx, yy = energy(cloth, exact), energy(cloth, np.diag([0.0, 1.0]))
    xy = 0.5 * (energy(cloth, np.diag([1.0, 1.0])) - xx - yy)
    area = 1.0 / aspect
    assert (xx - xy**2 / yy) * 2 / area == pytest.approx(Y, rel=1e-9)
    assert (yy - xy**2 / xx) * 2 / area == pytest.approx(Y, rel=1e-9)
    assert cloth.springs.stiffness.min() > 0.0


def test_square_cells_follow_the_closed_form():
    a = 0.1
    springs = Cloth.grid((0.4, 0.4), (5, 5), Fabric(stretch_stiffness=Y, shear_stiffness=G, bend_stiffness=7.0)).springs
    k = {kind: np.unique(springs.stiffness[springs.kinds == kind].round(9)) for kind in (STRUCTURAL, SHEAR, BEND)}
    k1 = a * (C - G)
    np.testing.assert_allclose(k[STRUCTURAL], [k1 / 2, k1])
    np.testing.assert_allclose(k[SHEAR], [np.sqrt(2) * a * G])
    np.testing.assert_allclose(k[BEND], [7.0 * a / 2, 7.0 * a])


@pytest.mark.parametrize("resolution", RESOLUTIONS)
@pytest.mark.parametrize("diagonals", ["alternate", "same"])
def test_mass_is_area_times_density(resolution, diagonals):
    cloth = Cloth.grid((0.7, 1.3), resolution, Fabric(areal_density=0.15), diagonals=diagonals)
    assert cloth.area == pytest.approx(0.7 * 1.3, rel=1e-13)
    assert cloth.mass == pytest.approx(0.7 * 1.3 * 0.15, rel=1e-13)


@pytest.mark.parametrize("rings", [1, 2, 5, 16])
def test_disc_mass_and_shape(rings):
    cloth = Cloth.disc(0.5, rings, Fabric(areal_density=0.15))
    sides = 6 * rings
    assert cloth.area == pytest.approx(0.5 * sides * 0.25 * np.sin(2 * np.pi / sides), rel=1e-12)
    assert cloth.mass == pytest.approx(0.15 * cloth.area, rel=1e-12)
    corners = cloth.points[cloth.triangles]
    assert np.all(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0.0)
    lengths = cloth.springs.rest_lengths[cloth.springs.kinds == STRUCTURAL] * rings / 0.5
    assert lengths.min() > 0.9
    assert lengths.max() < 1.5  # rounding a hexagon makes right triangles at its corners


@pytest.mark.parametrize("angle", np.linspace(0.0, np.pi / 2, 5))
def test_equilateral_mesh_is_isotropic_with_young_modulus_y_and_poisson_ratio_one_third(angle):
    i, j = np.meshgrid(np.arange(12), np.arange(12))
    points = 0.05 * np.column_stack([(i + 0.5 * j).ravel(), (np.sqrt(0.75) * j).ravel(), np.zeros(144)])
    a = (12 * j + i)[:-1, :-1].ravel()
    mesh = trimesh.Trimesh(
        points, np.concatenate([np.c_[a, a + 1, a + 12], np.c_[a + 1, a + 13, a + 12]]), process=False
    )
    cloth = Cloth.from_mesh(mesh, MEMBRANE)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    pulled = turn @ np.diag([1.0, -1.0 / 3.0]) @ turn.T
    assert energy(cloth, pulled) == pytest.approx(0.5 * Y * cloth.area, rel=1e-9)


@pytest.mark.parametrize("rings", [4, 8, 16])
def test_disc_has_nearly_young_modulus_y(rings):
    cloth = Cloth.disc(0.5, rings, MEMBRANE)
    assert energy(cloth, np.diag([1.0, -1.0 / 3.0])) == pytest.approx(0.5 * Y * cloth.area, rel=0.02)


def test_mesh_matches_young_modulus_on_average_over_directions():
    grid = Cloth.grid((1, 1), (9, 9), diagonals="same")  # right triangles, as anisotropic as meshes get
    cloth = Cloth.from_mesh(trimesh.Trimesh(grid.points, grid.triangles, process=False), MEMBRANE)
    energies = []
    for angle in np.linspace(0.0, np.pi, 24, endpoint=False):
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        energies.append(energy(cloth, turn @ np.diag([1.0, -1.0 / 3.0]) @ turn.T))
    assert np.mean(energies) == pytest.approx(0.5 * Y * cloth.area, rel=1e-9)


# Geometry


def test_grid_is_laid_out_as_documented():
    cloth = Cloth.grid((2.0, 1.0), (5, 3))
    np.testing.assert_allclose(cloth.points[0], (-1, -0.5, 0))
    np.testing.assert_allclose(cloth.points[2 * 5 + 4], (1, 0.5, 0))
    np.testing.assert_allclose(cloth.points[1] - cloth.points[0], (0.5, 0, 0))
    np.testing.assert_allclose(cloth.uvs[[0, 4, 10, 14]], [[0, 0], [1, 0], [0, 1], [1, 1]])
    corners = cloth.points[cloth.triangles]
    assert np.all(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0.0)


@pytest.mark.parametrize("mirror", [np.s_[:, ::-1], np.s_[::-1, :]])
def test_grid_is_symmetric(mirror):
    cloth = Cloth.grid((1.0, 1.0), (5, 5))
    image = np.arange(25).reshape(5, 5)[mirror].ravel()
    np.testing.assert_array_equal(cloth.masses[image], cloth.masses)
    springs = {
        tuple(sorted(pair)): k for pair, k in zip(cloth.springs.indices.tolist(), cloth.springs.stiffness, strict=True)
    }
    for (a, b), k in springs.items():
        assert springs[tuple(sorted((image[a], image[b])))] == k
    triangles = {frozenset(t) for t in cloth.triangles.tolist()}
    assert {frozenset(image[list(t)].tolist()) for t in triangles} == triangles


def test_every_spring_is_at_rest_however_the_cloth_is_placed():
    cloth = Cloth.grid((1, 2), (6, 9), transform=placement((3, 2, 1), (0.3, -1.0, 2.0)))
    ends = cloth.points[cloth.springs.indices]
    np.testing.assert_allclose(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), cloth.springs.rest_lengths, rtol=1e-13)
    np.testing.assert_allclose(cloth.springs.damping, cloth.fabric.damping_time * cloth.springs.stiffness)


def test_no_pair_is_sprung_twice():
    for cloth in (Cloth.grid((1, 1), (7, 6)), Cloth.disc(0.5, 6), Cloth.from_mesh(trimesh.creation.icosphere(2))):
        pairs = np.sort(cloth.springs.indices, axis=1)
        assert len(np.unique(pairs, axis=0)) == len(pairs)


def test_mesh_springs_of_a_tetrahedron_and_of_two_triangles():
    tetrahedron = Cloth.from_mesh(trimesh.creation.icosahedron())
    assert np.count_nonzero(tetrahedron.springs.kinds == STRUCTURAL) == 30
    assert np.count_nonzero(tetrahedron.springs.kinds == BEND) == 30
    kite = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 2, 0], [1, 2, 0]], [[0, 1, 2], [1, 3, 2]], process=False)
    springs = Cloth.from_mesh(kite, Fabric(stretch_stiffness=100.0, bend_stiffness=3.0)).springs
    found = {tuple(pair): k for pair, k in zip(springs.indices.tolist(), springs.stiffness, strict=True)}
    assert found[(0, 1)] == pytest.approx(100.0 * 1.0 / 1.0)
    assert found[(0, 2)] == pytest.approx(100.0 * 1.0 / 2.0)
    assert found[(1, 2)] == pytest.approx(100.0 * 2.0 / np.sqrt(5.0))
    assert found[(0, 3)] == pytest.approx(3.0 * 2.0 / np.sqrt(5.0))
    assert len(found) == 6


def test_bend_springs_do_not_depend_on_numbers():
    """Around vertices with four neighbours two edges ask for the same spring, which has what both ask for."""
    flat = Cloth.grid((1.0, 1.0), (5, 5))
    points = flat.points + np.random.default_rng(0).uniform(-0.05, 0.05, flat.points.shape) * (1.0, 1.0, 0.0)
    order, fabric, matrices = np.random.default_rng(1).permutation(25), Fabric(bend_stiffness=7.0), []
    for number in (np.arange(25), order):
        placed = np.empty_like(points)
        placed[number] = points
        net = Cloth.from_mesh(trimesh.Trimesh(placed, number[flat.triangles], process=False), fabric).springs
        matrix, bend = np.zeros((25, 25)), net.kinds == BEND
        matrix[net.indices[bend, 0], net.indices[bend, 1]] = net.stiffness[bend]
        matrices.append((matrix + matrix.T)[np.ix_(number, number)])
    np.testing.assert_allclose(*matrices, atol=1e-12)
    even = Cloth.from_mesh(trimesh.Trimesh(flat.points, flat.triangles, process=False), fabric).springs
    ends = (even.indices == (11, 13)).all(axis=1)
    assert even.stiffness[ends] == pytest.approx(7.0 * 0.25)  # as of a grid: times the width of a cell


def test_bending_does_not_depend_on_the_order_of_triangles():
    """Of cloth that is curved at rest: the slope at an edge is taken across both of its triangles."""
    points = Cloth.disc(0.3, 3).points + np.random.default_rng(0).uniform(-0.02, 0.02, (37, 3)) * (1.0, 1.0, 0.0)
    points[:, 2] = 2.0 * points[:, 0] ** 2 - points[:, 0] * points[:, 1]
    triangles, matrices = Cloth.disc(0.3, 3).triangles, []
    for order in (np.arange(54), np.random.default_rng(1).permutation(54)):
        mesh = trimesh.Trimesh(points, triangles[order], process=False)
        bending = Cloth.from_mesh(mesh, Fabric(bending_rigidity=1e-4)).bending
        rows = np.zeros((len(bending), 37))
        rows[bending.element, bending.particles] = bending.weights[:, 0]
        matrices.append(rows.T @ (bending.stiffness[:, None] * rows))
    assert np.abs(matrices[0]).max() > 1e-3
    np.testing.assert_allclose(*matrices, atol=1e-9 * np.abs(matrices[0]).max())


def test_stiffness_zero_means_no_springs():
    kinds = Cloth.grid((1, 1), (4, 4), Fabric(shear_stiffness=0.0, bend_stiffness=0.0)).springs.kinds
    assert set(kinds.tolist()) == {STRUCTURAL}


# Meshes


def test_scaling_a_mesh_scales_its_mass():
    box = trimesh.creation.box()
    assert Cloth.from_mesh(box, transform=np.diag([2.0, 2, 2, 1])).mass == pytest.approx(4 * Cloth.from_mesh(box).mass)


def test_branching_and_one_sided_meshes_are_no_cloth():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0]])
    book = trimesh.Trimesh(points, [[0, 1, 2], [0, 1, 3], [0, 1, 4]], process=False)
    with pytest.raises(MeshError, match="1 edge belongs to more than two triangles, first that from vertex 0 to 1"):
        Cloth.from_mesh(book)
    angle, side = np.meshgrid(np.linspace(0, 2 * np.pi, 13)[:-1], (-0.3, 0.3), indexing="ij")
    radius = 1 + side * np.cos(angle / 2)
    rails = np.stack([radius * np.cos(angle), radius * np.sin(angle), side * np.sin(angle / 2)], axis=-1).reshape(-1, 3)
    a = np.arange(0, 24, 2)
    b, c, d = a + 1, np.r_[a[1:], 1], np.r_[a[1:] + 1, 0]
    strip = trimesh.Trimesh(rails, np.concatenate([np.c_[a, b, c], np.c_[b, d, c]]), process=False)
    with pytest.raises(MeshError, match="only one side"):
        Cloth.from_mesh(strip)


def test_neighbours_are_made_to_face_the_same_way():
    grid = Cloth.grid((1, 1), (6, 6))
    mixed = grid.triangles.copy()
    mixed[::3] = mixed[::3, ::-1]
    cloth = Cloth.from_mesh(trimesh.Trimesh(grid.points, mixed, process=False))
    np.testing.assert_array_equal(cloth.triangles[1::3], grid.triangles[1::3])
    corners = cloth.points[cloth.triangles]
    assert np.all(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0.0)


@pytest.mark.parametrize("kind", ["woven", "fitted"])
@pytest.mark.parametrize(("axis", "mirrored"), [((0, 0, 1), False), ((0, 1, 0), False), ((1, 2, 3), True)])
def test_the_warp_of_a_mesh_turns_with_it(kind, axis, mirrored):
    """It runs along x of the mesh as it was before: turned, mirrored and stretched, it is as stiff along that."""
    fabric = Fabric(stretch_stiffness=4000.0, stretch_stiffness_weft=400.0, shear_stiffness=50.0)
    grid = Cloth.grid((0.4, 0.4), (7, 7), fabric)
    mesh = trimesh.Trimesh(grid.points, grid.triangles, process=False)
    turn = trimesh.transformations.rotation_matrix(0.5 * np.pi, axis)
    turn[:3, :3] = turn[:3, :3] @ np.diag([1.2, 0.9, -1.0 if mirrored else 1.0])
    cloth = Cloth.from_mesh(mesh, fabric, transform=turn, springs=kind)
    energies = []
    for column in (0, 1):  # of what was x, and y
        along = turn[:3, column] / np.linalg.norm(turn[:3, column])
        model = Model.build(cloth, precision="float64")
        x = cloth.points - cloth.points.mean(axis=0)
        model.particle_q.assign(cloth.points + 1e-3 * np.outer(x @ along, along))
        energies.append(Simulation(model, gravity=(0, 0, 0), check_start=False).energy()["spring"])
    assert 7.0 < energies[0] / energies[1] < 13.0
