"""Worlds of one model are each what they would be alone: measured by themselves, taken to another model, run again."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from embedding_kernels import Lowest
from integrator_problems import NAMES

import warpcloth as wc
from warpcloth import diagnostics
from warpcloth.contact.pair_list import PairList
from warpcloth.errors import InputError, SimulationError
from warpcloth.integrators import INTEGRATORS

INDEPENDENT = [name for name in NAMES if not INTEGRATORS[name].couples_worlds]
TABLE = wc.Box((0.0, 0.0, -0.05), (0.1, 0.1, 0.1))


SOFT = wc.Fabric(stretch_stiffness=20.0, shear_stiffness=5.0, bend_stiffness=0.5, damping_time=1e-3)
# The same with all that a fabric can have, and with next to nothing.
RICH = replace(SOFT, bending_rigidity=1e-5, bending_hysteresis=1e-3, strain_limit=0.01, limit_stiffness=20.0)
BARE = replace(SOFT, shear_stiffness=0.0, bend_stiffness=0.0, bending_rigidity=0.0)


def cloth(height: float, n: int = 5, fabric: wc.Fabric = SOFT) -> wc.Cloth:
    pins = [wc.pin("top_left", motion=wc.Motion.keyframes([(0, (0, 0, 0)), (1, (0.1, 0, 0.1))]))]
    return wc.Cloth.grid((0.3, 0.3), (n, n), fabric, pins=pins, transform=(0.0, 0.0, height))


WORLDS = [([cloth(0.02)], [TABLE]), ([cloth(0.05, 7, RICH)], []), ([cloth(0.03, 6, BARE)], [TABLE])]


def simulation(worlds, name="xpbd", **options) -> wc.Simulation:
    return wc.Simulation(wc.Model.build_worlds(worlds), name, substeps=50, **options)


def phase(sim: wc.Simulation) -> np.ndarray:
    return np.hstack([sim.state.particle_q.numpy(), sim.state.particle_qd.numpy()])


@pytest.mark.parametrize("name", INDEPENDENT)
def test_a_world_among_quite_different_ones_is_that_world_alone(name):
    whole = simulation(WORLDS, name, contact="all")
    whole.run(3)
    for number, world in enumerate(WORLDS):
        alone = simulation([world], name, contact="all")
        alone.run(3)
        np.testing.assert_array_equal(phase(alone), phase(whole)[whole.model.particle_world.numpy() == number])


@pytest.mark.parametrize(("name", "kept"), [*((name, [0, 2]) for name in INDEPENDENT), ("xpbd", [1]), ("bdf2", [1])])
def test_worlds_go_on_in_another_model(name, kept):
    """Also where the scheme remembers earlier steps, contact acts and pins move with the world's own clock."""
    whole = simulation(WORLDS, name, contact="all")
    whole.run(4)
    rest = simulation([WORLDS[w] for w in kept], name, contact="all")
    rest.continue_from(whole, kept)
    whole.run(3)
    rest.run(3)
    world = whole.model.particle_world.numpy()
    np.testing.assert_array_equal(phase(rest), phase(whole)[np.isin(world, kept)])
    assert rest.time == whole.time
    np.testing.assert_array_equal(rest.settled_worlds(), whole.settled_worlds()[kept])


class Deepest(Lowest):
    """How far below the ground particles have been, remembered as hooks should."""

    def __init__(self, model: wc.Model):
        super().__init__(model)
        self.lowest.zero_()
        self.rows = np.arange(model.particle_count)

    def memory(self):
        return [wc.Memory(self.lowest, self.rows)]


def test_what_hooks_remember_goes_along():
    pair = [wc.Model.build_worlds(own) for own in (WORLDS, WORLDS[1:2])]
    whole, rest = (wc.Simulation(model, "xpbd", substeps=5, hooks=[Deepest(model)]) for model in pair)
    whole.run(20)
    rest.continue_from(whole, [1])
    lowest = whole.hooks[0].lowest.numpy()[whole.model.particle_world.numpy() == 1]
    assert lowest.min() < -0.1
    np.testing.assert_array_equal(rest.hooks[0].lowest.numpy(), lowest)
    with pytest.raises(InputError, match=r"^A simulation can go on only with hooks .* other one, Deepest, not none\.$"):
        simulation(WORLDS[1:2]).continue_from(whole, [1])


def test_automatic_substeps_stay_in_another_model():
    """Though the world that needed them is not there any more."""
    stiff = replace(SOFT, stretch_stiffness=2000.0)
    worlds = [([cloth(0.02)], []), ([cloth(0.02, fabric=stiff)], [])]
    whole, rest, alone = (wc.Simulation(wc.Model.build_worlds(own)) for own in (worlds, worlds[:1], worlds[:1]))
    whole.run(2)
    rest.continue_from(whole, [0])
    for sim in (whole, rest, alone):
        sim.run(2)
    np.testing.assert_array_equal(phase(rest), phase(whole)[whole.model.particle_world.numpy() == 0])
    assert rest.substeps == whole.substeps > 2 * alone.substeps


@pytest.mark.parametrize("name", ["xpbd", "bdf2", "symplectic_euler", "dormand_prince"])
def test_a_frame_done_again_for_want_of_memory_is_the_same(name, monkeypatch):
    roomy = simulation(WORLDS, name, contact="all")
    roomy.run(4)
    usual = PairList.__init__
    monkeypatch.setattr(PairList, "__init__", lambda self, model, capacity: usual(self, model, 1))
    tight = simulation(WORLDS, name, contact="all")
    tight.run(4)
    np.testing.assert_array_equal(phase(tight), phase(roomy))


@pytest.mark.parametrize("name", INDEPENDENT)
def test_worlds_that_are_reset_begin_anew(name):
    """Bitwise as in the beginning, whatever the scheme, hysteresis and pins remember; the others go on undisturbed."""
    sim, fresh, going = (simulation(WORLDS, name, contact="all") for _ in range(3))
    sim.run(4)
    mask = wp.array([True, True, False], dtype=wp.bool, device=sim.model.device)
    sim.reset(mask)
    world = sim.model.particle_world.numpy()
    np.testing.assert_array_equal(phase(sim)[world < 2], phase(fresh)[world < 2])
    sim.run(3)
    fresh.run(3)
    going.run(7)
    np.testing.assert_array_equal(phase(sim), np.where(world[:, None] < 2, phase(fresh), phase(going)))
    np.testing.assert_allclose(sim.state.world_time.numpy(), np.array([3, 3, 7]) / 60.0)
    assert np.abs(phase(fresh) - phase(going)).max() > 1e-3
    sim.reset()
    assert sim.time == 0.0
    sim.run(3)
    np.testing.assert_array_equal(phase(sim), phase(fresh))


@pytest.mark.parametrize("name", [name for name in NAMES if name not in INDEPENDENT])
def test_all_worlds_begin_anew_where_they_share_steps(name):
    sim, fresh = (simulation(WORLDS, name) for _ in range(2))
    sim.run(2)
    sim.reset()
    for one in (sim, fresh):
        one.run(2)
    np.testing.assert_array_equal(phase(sim), phase(fresh))
    assert sim.integrator.metrics() == fresh.integrator.metrics()


@pytest.mark.filterwarnings("ignore::warpcloth.errors.ConvergenceWarning")
@pytest.mark.parametrize("name", NAMES)
def test_what_has_diverged_begins_anew(name):
    """Bitwise, however infinite the forces that its last step left behind."""
    model = wc.Model.build([wc.Cloth.grid((0.2, 0.2), (4, 4), SOFT, pins="left")])
    force = wc.AppliedForce(model)
    sim, fresh = (wc.Simulation(model, name, substeps=50, forces=forces) for forces in ([force], []))
    force.force.assign(np.where(np.arange(48).reshape(16, 3) == 21, np.inf, 0.0))
    with pytest.raises(SimulationError):
        sim.run(2)
    force.force.zero_()
    sim.reset()
    for one in (sim, fresh):
        one.run(2)
    np.testing.assert_array_equal(phase(sim), phase(fresh))


@pytest.mark.parametrize(
    ("mask", "sentence"),
    [
        ([True, False], r"World mask must be booleans of shape \(3,\), one for each world, got bool of shape \(2,\)."),
        ([1, 0, 1], r"World mask must be booleans of shape \(3,\), one for each world, got int64 of shape \(3,\)."),
        (wp.zeros(3, dtype=wp.int32, device="cpu"), "World mask must be of dtype bool, got int32."),
        (wp.zeros(2, dtype=wp.bool, device="cpu"), r"World mask must have shape \(3,\), got \(2,\)."),
    ],
)
def test_masks_that_do_not_fit_are_refused(mask, sentence):
    with pytest.raises(InputError, match=f"^{sentence}$"):
        simulation(WORLDS).reset(mask)


def test_a_reset_world_is_not_at_rest():
    """Others still are."""
    sim = simulation(2 * [([wc.Cloth.grid((0.1, 0.1), (3, 3), transform=(0, 0, 0.0021))], [wc.Plane()])])
    sim.run(18)
    assert sim.settled
    sim.reset([True, False])
    assert sim.settled_worlds().tolist() == [False, True]


def test_each_world_is_measured_by_itself():
    together = simulation(WORLDS)
    together.run(3)
    rows = diagnostics.measure_worlds(together.model, together.state, together.time)
    for world, row in zip(WORLDS, rows, strict=True):
        alone = simulation([world])
        alone.run(3)
        assert row == diagnostics.measure(alone.model, alone.state, alone.time)
    whole = diagnostics.measure(together.model, together.state, together.time)
    assert whole["max_strain"] == max(row["max_strain"] for row in rows) > 0.0


def test_worlds_come_to_rest_one_by_one():
    fabric = wc.Fabric(damping_time=1e-2)
    low, high = (wc.Cloth.grid((0.1, 0.1), (3, 3), fabric, transform=(0, 0, z)) for z in (0.0021, 0.6))
    sim = simulation([([low], [wc.Plane()]), ([high], [wc.Plane()])])
    sim.run(18)
    assert sim.settled_worlds().tolist() == [True, False]
    assert not sim.settled
    rest = simulation([([low], [wc.Plane()])])
    rest.continue_from(sim, [0])
    assert rest.settled
    sim.run(60)
    assert sim.settled


def test_contact_among_cloth_looks_as_far_as_each_pair_is_thick():
    """A world of thicker cloth beside it changes nothing."""

    def layers(thickness: float) -> tuple[list[wc.Cloth], list[wc.Sphere]]:
        fabric = replace(SOFT, thickness=thickness)
        below = wc.Cloth.grid((0.3, 0.3), (10, 10), fabric, transform=(0.0, 0.0, 0.3))
        above = wc.Cloth.grid(
            (0.2, 0.2), (8, 8), fabric, transform=(0.03, 0.02, 0.32), name="above", velocity=(0.0, 0.0, -1.5)
        )
        return [below, above], [wc.Sphere((0.0, 0.0, 0.2), 0.08)]

    alone, beside = (
        simulation([layers(t) for t in thickness], contact="all") for thickness in ([0.002], [0.002, 0.006])
    )
    alone.run(20, fps=60)
    beside.run(20, fps=60)
    assert np.array_equal(phase(beside)[: alone.model.particle_count], phase(alone))
    assert np.abs(phase(alone)[100:, 5] + 1.5).max() > 0.5  # the layers have met
