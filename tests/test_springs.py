"""The spring law: against numpy in float64, scatter against gather, momentum, degenerate springs."""

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st

import warpcloth as wc
from warpcloth.forces import Forces, Springs
from warpcloth.state import State


def random_network(seed: int, particles: int = 60, springs: int = 240):
    rng = np.random.default_rng(seed)
    ends = rng.integers(0, particles, (springs, 2))
    ends[:, 1] = np.where(ends[:, 0] == ends[:, 1], (ends[:, 1] + 1) % particles, ends[:, 1])
    return {
        "positions": rng.normal(size=(particles, 3)),
        "masses": rng.uniform(0.1, 2.0, particles),
        "springs": ends,
        "rest_lengths": rng.uniform(0.2, 2.0, springs),
        "k_s": rng.uniform(1.0, 1e3, springs),
        "k_d": rng.uniform(0.0, 10.0, springs),
        "velocities": rng.normal(size=(particles, 3)),
    }


def law_in_numpy(net: dict) -> np.ndarray:
    """The law of the design, written down a second time."""
    p, q = net["springs"].T
    d = net["positions"][q] - net["positions"][p]
    u = net["velocities"][q] - net["velocities"][p]
    length = np.linalg.norm(d, axis=1)
    n = d / length[:, None]
    r = net["rest_lengths"]
    f = (net["k_s"] * (length / r - 1.0) + net["k_d"] * np.sum(u * n, axis=1) / r)[:, None] * n
    total = np.zeros_like(net["positions"])
    np.add.at(total, p, f)
    np.add.at(total, q, -f)
    return total


def forces_of(model: wc.Model, assembly: str = "scatter", gravity=(0.0, 0.0, 0.0)) -> np.ndarray:
    state = State.of(model)
    state.particle_f.fill_(float("nan"))  # what an evaluation does not write must show
    world_gravity = wp.array([gravity], dtype=model.vec3, device=model.device)
    Forces(model, [Springs(model, assembly)], world_gravity).evaluate(state)
    return state.particle_f.numpy()


@pytest.mark.parametrize("seed", range(5))
def test_forces_equal_an_independent_evaluation(seed):
    net = random_network(seed)
    expected = law_in_numpy(net)
    got = forces_of(wc.Model.from_springs(**net, precision="float64"))
    assert np.abs(expected).max() > 1.0
    assert np.abs(got - expected).max() <= 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize(("precision", "tolerance"), [("float32", 3e-6), ("float64", 1e-14)])
def test_gather_equals_scatter_to_round_off(precision, tolerance):
    model = wc.Model.from_springs(**random_network(7), precision=precision)
    scatter, gather = forces_of(model), forces_of(model, "gather")
    assert np.abs(scatter - gather).max() <= tolerance * np.abs(scatter).max()


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6))
def test_internal_forces_have_no_resultant_and_no_moment(seed):
    net = random_network(seed)
    f = forces_of(wc.Model.from_springs(**net, precision="float64"))
    scale = np.abs(f).sum()
    assert np.abs(f.sum(axis=0)).max() <= 1e-14 * scale
    assert np.abs(np.cross(net["positions"], f).sum(axis=0)).max() <= 1e-13 * scale


def test_every_particle_gets_its_weight():
    net = random_network(3)
    model = wc.Model.from_springs(**net, precision="float64")
    weight = forces_of(model, gravity=(1.0, 2.0, -9.81)) - forces_of(model)
    assert np.allclose(weight, net["masses"][:, None] * np.array([1.0, 2.0, -9.81]), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("assembly", ["scatter", "gather"])
def test_zero_length_spring_exerts_no_force(assembly):
    model = wc.Model.from_springs(np.zeros((2, 3)), 1.0, [[0, 1]], 1.0, 100.0, 1.0)
    assert np.array_equal(forces_of(model, assembly), np.zeros((2, 3)))


def test_force_is_minus_the_gradient_of_the_energy():
    net = random_network(11)
    net["k_d"] = 0.0
    f = forces_of(wc.Model.from_springs(**net, precision="float64"))
    assert np.linalg.norm(f) > 1.0

    def energy(x):
        model = wc.Model.from_springs(**{**net, "positions": x}, precision="float64")
        return wc.Simulation(model, gravity=(0, 0, 0), substeps=1).energy()["spring"]

    h = 1e-6
    for particle, axis in [(0, 0), (5, 1), (17, 2), (42, 0)]:
        step = np.zeros_like(net["positions"])
        step[particle, axis] = h
        slope = (energy(net["positions"] + step) - energy(net["positions"] - step)) / (2.0 * h)
        assert slope == pytest.approx(-f[particle, axis], rel=1e-6, abs=1e-6 * np.abs(f).max())


@pytest.mark.parametrize("assembly", ["scatter", "gather"])
def test_free_network_keeps_its_momenta(assembly):
    net = random_network(2, particles=20, springs=60)
    model = wc.Model.from_springs(**net, precision="float64")
    sim = wc.Simulation(model, gravity=(0, 0, 0), substeps=200, assembly=assembly)
    m = net["masses"][:, None]
    before = np.vstack([(m * net["velocities"]).sum(0), np.cross(net["positions"], m * net["velocities"]).sum(0)])
    sim.run(5, fps=10)
    x, v = sim.state.particle_q.numpy(), sim.state.particle_qd.numpy()
    assert np.linalg.norm(x - net["positions"]) > 1.0  # it did move
    after = np.vstack([(m * v).sum(0), np.cross(x, m * v).sum(0)])
    assert np.abs(after - before).max() <= 1e-10 * np.abs(before).max()


def test_model_refuses_nonsense():
    good = random_network(0)
    cases = {
        "masses": np.zeros(60),
        "rest_lengths": 0.0,
        "k_s": -1.0,
        "k_d": np.nan,
        "springs": [[0, 60]],
        "positions": np.full((60, 3), np.nan),
        "pinned": [60],
        "precision": "float16",
        "device": "abacus",
    }
    for key, value in cases.items():
        with pytest.raises(wc.errors.InputError) as error:
            wc.Model.from_springs(**{**good, key: value})
        assert str(error.value).count(".") >= 1, key
        assert "\n" not in str(error.value), key
