"""Rows of springs: which there are, that they are solved as one, and that sweeps end where they would without."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import warpcloth as wc
from warpcloth.integrators import rows as rows_module
from warpcloth.integrators.rows import SHORTEST_ROW, ListRows, Rows, in_groups, in_launches, spring_rows


def grid_ends(rows: int, columns: int) -> np.ndarray:
    number = np.arange(rows * columns).reshape(rows, columns)
    along = np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1)
    across = np.stack([number[:-1].ravel(), number[1:].ravel()], axis=1)
    return np.concatenate([along, across])


def test_rows_of_a_grid_are_its_threads():
    ends = grid_ends(7, 9)
    springs, first = spring_rows(ends)
    assert sorted(np.diff(first)) == [6] * 9 + [8] * 7
    assert np.array_equal(np.sort(springs), np.arange(len(ends)))


def test_of_springs_that_join_the_same_particles_one_is_in_the_row():
    ends = np.array([(0, 1), (0, 1), (1, 2), (2, 3), (2, 3), (3, 4), (4, 5)])
    springs, first = spring_rows(ends)
    assert first.tolist() == [0, 5]
    assert springs.tolist() == [0, 2, 3, 5, 6]


@given(st.lists(st.tuples(st.integers(0, 30), st.integers(1, 4)), min_size=1, max_size=80))
def test_rows_go_on_and_share_no_spring(springs):
    """Also where several springs join the same particles."""
    ends = np.array([(p, p + step) for p, step in springs])
    found, begins = spring_rows(ends)
    assert len(np.unique(found)) == len(found)
    for first, last in pairwise(begins):
        row = ends[found[first:last]]
        assert len(row) >= SHORTEST_ROW
        assert np.array_equal(row[:-1, 1], row[1:, 0])
        assert len(np.unique(row[:, 1] - row[:, 0])) == 1


def test_rows_of_one_launch_share_no_particle():
    ends = np.concatenate([grid_ends(7, 9), [(0, 5), (5, 10), (10, 15), (15, 20)]])
    spring, first = spring_rows(ends)
    launches = in_launches(Rows(spring, first, spring), ends, 63)
    assert len(launches) == 3  # along, across, and a row over both
    for rows in launches:
        particles = np.concatenate([np.append(ends[row, 0], ends[row[-1], 1]) for row in rows])
        assert len(np.unique(particles)) == len(particles)
    assert sorted(np.concatenate([row for rows in launches for row in rows])) == sorted(spring)


@given(st.lists(st.tuples(st.integers(1, 5), st.integers(1, 3)), min_size=1, max_size=40))
def test_groups_have_rows_that_are_alike(drawn):
    """Rows of a length and a step each, none with a particle of another."""
    ends, rows, particle = [], [], 0
    for length, step in drawn:
        rows.append(np.arange(len(ends), len(ends) + length))
        ends += [(particle + k * step, particle + (k + 1) * step) for k in range(length)]
        particle += length * step + 1
    ends = np.array(ends)
    found = []
    for group in in_groups(rows[::-1], ends, 4):
        assert group.shape[1] == 4
        assert len(np.unique(ends[group, 1] - ends[group, 0])) == 1
        lanes = [tuple(lane) for lane in group.T.tolist()]
        own = sorted(set(lanes), key=lambda row: ends[row[0], 0])
        assert lanes == own + [own[0]] * (4 - len(own))
        found += own
    assert sorted(found) == sorted(tuple(row.tolist()) for row in rows)


def chain(count: int, stretch: float, **options) -> dict:
    """A straight row of springs of 0.1 m, longer by ``stretch``, in float64."""
    x = np.zeros((count + 1, 3))
    x[:, 0] = 0.1 * (1.0 + stretch) * np.arange(count + 1)
    springs = np.stack([np.arange(count), np.arange(1, count + 1)], axis=1)
    net = {"positions": x, "masses": 0.01, "springs": springs, "rest_lengths": 0.1, "k_s": 50.0, "k_d": 0.02}
    return net | {"precision": "float64"} | options


def stepped(net: dict, h: float, steps: int = 1, **options) -> np.ndarray:
    sim = wc.Simulation(wc.Model.from_springs(**net), "xpbd", (0, 0, 0), substeps=1, integrator_options=options)
    for _ in range(steps):
        sim.step(h)
    return sim.state.particle_q.numpy()


@pytest.mark.parametrize("stretch", [0.2, -0.1])
def test_a_straight_row_is_solved_at_once(stretch):
    """One sweep and it is implicit Euler, as one system of linear equations, pulled or pushed."""
    count, h, m = 37, 0.01, 0.01
    net = chain(count, stretch, pinned=[0])
    elastic, viscous = h * h * 50.0 / 0.1, h * 0.02 / 0.1
    differences = np.diff(np.eye(count + 1), axis=0)
    free = np.arange(1, count + 1)
    system = m * np.eye(count + 1) + (elastic + viscous) * differences.T @ differences
    x = net["positions"][:, 0]
    load = -elastic * differences.T @ (np.diff(x) - 0.1)
    expected = x.copy()
    expected[free] += np.linalg.solve(system[np.ix_(free, free)], load[free])
    assert stepped(net, h, iterations=1)[:, 0] == pytest.approx(expected, abs=1e-12)
    assert np.abs(stepped(net, h, iterations=1, rows=False)[:, 0] - expected).max() > 0.01


@pytest.mark.parametrize("warm_start", [0.0, 0.5])
def test_sweeps_end_where_they_would_without_rows(warm_start):
    net = chain(20, 0.1, pinned=[0])
    net["positions"][:, 2] = 0.05 * np.sin(np.arange(21))
    options = {"iterations": 3000, "warm_start": warm_start}
    assert stepped(net, 0.02, 3, **options) == pytest.approx(stepped(net, 0.02, 3, rows=False, **options), abs=1e-9)


def test_rows_take_over_new_properties_of_springs():
    """As :meth:`Xpbd.prepare` promises: what comes of them is what a new model does, to the last bit."""
    model = wc.Model.from_springs(**chain(20, 0.1))
    sim = wc.Simulation(model, "xpbd", (0, 0, 0), substeps=1)
    for name, times in (("spring_rest_length", 0.9), ("spring_stiffness", 3.0), ("spring_damping", 2.0)):
        array = getattr(model, name)
        array.assign(times * array.numpy())
    sim.integrator.prepare()
    sim.step(0.01)
    new = chain(20, 0.1) | {"rest_lengths": 0.9 * 0.1, "k_s": 3.0 * 50.0, "k_d": 2.0 * 0.02}
    assert np.array_equal(sim.state.particle_q.numpy(), stepped(new, 0.01))


def test_rows_keep_momentum():
    net = chain(37, 0.3)
    net["positions"] += np.random.default_rng(1).normal(size=(38, 3)) * 0.02
    sim = wc.Simulation(wc.Model.from_springs(**net), "xpbd", (0, 0, 0), substeps=1)
    sim.step(0.01)
    momentum = (0.01 * sim.state.particle_qd.numpy()).sum(axis=0)
    assert np.abs(sim.state.particle_qd.numpy()).max() > 1.0
    assert np.abs(momentum).max() < 1e-12


def test_particles_in_one_place_pull_nowhere():
    net = chain(6, 0.2)
    net["positions"][3] = net["positions"][4]
    assert np.isfinite(stepped(net, 0.01, 3)).all()


def test_cloth_that_is_jolted_by_cells_only_loses_energy():
    """Undamped, in large steps: rows, which are solved as if they were straight, do not make any."""
    model = wc.Model.build(wc.Cloth.grid((1.0, 1.0), (33, 33), wc.Fabric(damping_time=0.0)))
    jolts = np.random.default_rng(0).normal(0.0, 3.0 / 32.0, (model.particle_count, 3))
    model.particle_q.assign(model.particle_q.numpy() + jolts.astype(np.float32))
    sim = wc.Simulation(model, "xpbd", (0, 0, 0), substeps=1, contact="none", check=False)
    energies = [sim.energy()["total"]]
    for _ in range(30):
        sim.step(1.0 / 60.0)
        energies.append(sim.energy()["total"])
    assert max(energies[1:]) < 0.01 * energies[0]
    assert energies[-1] < energies[1]


def worst_strain(sim: wc.Simulation, cloth: wc.Cloth, frames: int = 40) -> float:
    edges, rest = (values[cloth.springs.kinds == 0] for values in (cloth.springs.indices, cloth.springs.rest_lengths))
    worst = 0.0
    for _ in range(frames):
        sim.step(1.0 / 60.0)
        q = sim.state.particle_q.numpy()
        worst = max(worst, float(np.abs(np.linalg.norm(q[edges[:, 1]] - q[edges[:, 0]], axis=1) / rest - 1.0).mean()))
    return worst


@pytest.mark.parametrize("damping_time", [0.0, 5e-4])
def test_fine_cloth_hangs_with_few_substeps(damping_time):
    cloth = wc.Cloth.grid((1.0, 1.0), (65, 65), wc.Fabric(damping_time=damping_time), pins="left")
    model = wc.Model.build(cloth)
    sim = wc.Simulation(model, "xpbd", contact="none")
    assert worst_strain(sim, cloth) < 0.01
    assert sim.substeps <= 5
    plain = wc.Simulation(model, "xpbd", contact="none", integrator_options={"rows": False})
    assert plain.substeps_for(1.0 / 60.0) > 2 * sim.substeps
    fewer = wc.Simulation(model, "xpbd", contact="none", substeps=sim.substeps, integrator_options={"rows": False})
    assert worst_strain(fewer, cloth) > 0.05


def test_substeps_hardly_grow_with_the_mesh():
    def substeps(n: int, name: str = "xpbd", **options) -> int:
        model = wc.Model.build(wc.Cloth.grid((1.0, 1.0), (n, n), pins="left"))
        return wc.Simulation(model, name, contact="none", integrator_options=options).substeps_for(1.0 / 60.0)

    assert substeps(32) <= 4
    assert substeps(128) <= 7
    assert substeps(128, rows=False) >= 5 * substeps(32, rows=False)


@pytest.mark.parametrize("contact", ["none", "all"])
def test_stronger_gravity_takes_more_substeps(contact):
    """All times go with √(L/g), so where stiffness grows with gravity strain is the same; it was 4 and 0.5 %."""
    strains, counts = [], []
    for times in (1.0, 16.0):
        fabric = wc.Fabric(damping_time=5e-4 / times**0.5, stretch_stiffness=4e3 * times, shear_stiffness=4e2 * times)
        cloth = wc.Cloth.grid((1.0, 1.0), (17, 17), fabric, pins="left")
        sim = wc.Simulation(wc.Model.build(cloth), "xpbd", (0.0, 0.0, -9.81 * times), contact=contact)
        counts.append(sim.substeps_for(1.0 / 60.0))
        strains.append(worst_strain(sim, cloth))
    assert counts[1] == pytest.approx(4 * counts[0], abs=3)
    assert strains[1] < 1.5 * strains[0]


def crooked(count: int, rng: np.random.Generator) -> dict:
    """A chain of unlike springs and masses that runs to and fro."""
    net = chain(count, 0.15, pinned=[0], velocities=rng.normal(size=(count + 1, 3)))
    net["positions"] += 0.03 * rng.normal(size=(count + 1, 3))
    return net | {"masses": rng.uniform(0.01, 0.03, count + 1), "k_s": rng.uniform(20.0, 80.0, count), "k_d": 0.1}


def test_rows_follow_their_formula():
    """That of ``kernels/rows.py`` in numpy."""
    rng, h, count = np.random.default_rng(3), 0.02, 45
    net = crooked(count, rng)
    model = wc.Model.from_springs(**net)
    sim = wc.Simulation(model, "xpbd", (0, 0, 0), integrator_options={"warm_start": 0.5})
    scheme, start = sim.integrator, model.particle_q.numpy()
    force, moved = rng.normal(size=(count, 3)), rng.normal(size=(count + 1, 3)) * 0.01
    sweep = next(sweep for sweep in scheme.sweeps if len(sweep.slots()[0]) > 0)
    spring, slot = sweep.slots()
    places = slot[:, None] + sweep.stride * np.arange(3)
    flat = sweep.flat_force.numpy()
    flat[places] = force[spring]
    sweep.flat_force.assign(flat)
    scheme.displacement.assign(moved)
    for part, turn in scheme.pieces(sim.state, h):
        if part in scheme._row_parts:
            part.solve(turn, scheme.displacement)

    d, w = np.diff(start + moved, axis=0), model.particle_inv_mass.numpy()
    length = np.linalg.norm(d, axis=1)
    n = d / length[:, None]
    elastic, viscous = h * h * net["k_s"] / 0.1, h * 0.1 / 0.1
    lacks = elastic * (length - 0.1) + (n * (viscous * np.diff(moved, axis=0) - h * h * force)).sum(axis=1)
    coupled = np.diag(w[:-1] + w[1:])
    for j in range(count - 1):
        coupled[j, j + 1] = coupled[j + 1, j] = -w[j + 1] * n[j] @ n[j + 1]
    more = np.linalg.solve(np.eye(count) + (elastic + viscous)[:, None] * coupled, lacks)[:, None] * n
    expected = moved + w[:, None] * np.diff(more, axis=0, prepend=0.0, append=0.0)
    assert np.abs(expected - moved).max() > 0.01
    assert scheme.displacement.numpy() == pytest.approx(expected, abs=1e-12)
    assert sweep.flat_force.numpy()[places] == pytest.approx((force + more / h**2)[spring], abs=1e-9)


def solved(warm_start: float) -> np.ndarray:
    """Positions after some steps of rumpled cloths in two worlds, and of a crooked chain."""
    grids = [wc.Cloth.grid((0.5, 0.4), shape, pins="left") for shape in ((29, 23), (50, 37))]
    model = wc.Model.build_worlds([([cloth], []) for cloth in grids], precision="float64", device="cpu")
    rng, shape = np.random.default_rng(5), (model.particle_count, 3)
    model.particle_q.assign(1.1 * model.particle_q.numpy() + rng.normal(0.0, 0.004, shape))
    found = []
    for own in (model, wc.Model.from_springs(**crooked(13, rng))):
        options = {"warm_start": warm_start}
        sim = wc.Simulation(own, "xpbd", substeps=3, contact="none", integrator_options=options)
        assert sim.integrator.rows
        sim.step(0.01)
        found.append(sim.state.particle_q.numpy())
    return np.concatenate(found)


@pytest.mark.parametrize("warm_start", [0.0, 0.5])
def test_eight_rows_at_once_are_the_same_as_one_by_one(warm_start):
    moved = solved(warm_start)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rows_module, "LaneRows", ListRows)
        expected = solved(warm_start)
    np.testing.assert_allclose(moved, expected, atol=1e-12)
