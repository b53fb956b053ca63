"""Undamped implicit rules, in worlds whose state jumps and in others; and steps for thrown cloth."""

import math
from dataclasses import replace

import numpy as np
import pytest

import warpcloth as wc
from warpcloth.contact.travel import travel_step
from warpcloth.diagnostics import greatest_speeds
from warpcloth.integrators import INTEGRATORS
from warpcloth.stability import MAX_SUBSTEPS

SCHEMES = ["implicit_midpoint", "implicit_trapezoid"]
FABRIC = wc.Fabric(thickness=0.0025, friction=0.5, stretch_stiffness=300.0, shear_stiffness=60.0, bend_stiffness=0.2)
DT = 1.0 / 60.0


def sheet(height: float = 1.0, angle: float = 0.0, size: float = 0.24, **options) -> wc.Cloth:
    turn = np.eye(4)
    turn[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    turn[2, 3] = height
    return wc.Cloth.grid((size, size), (9, 9), FABRIC, transform=turn, **options)


def swinging() -> wc.Cloth:
    return sheet(pins=["top_left", "top_right"])


@pytest.mark.parametrize("name", SCHEMES)
def test_sheets_thrown_on_one_another_come_to_rest(name):
    """Without damped steps after contact they have 167 and 324 times the energy of the impact in the end."""
    stiff = replace(FABRIC, stretch_stiffness=3000.0, shear_stiffness=600.0)
    bed = wc.Cloth.grid((0.3, 0.3), (11, 11), stiff, pins=["left", "right"])
    falling = [
        replace(sheet(0.03 + 0.03 * k, 0.4 * (k + 1), name=f"layer {k}"), fabric=stiff, velocity=(0, 0, -8.0))
        for k in range(3)
    ]
    sim = wc.Simulation(wc.Model.build([bed, *falling]), name, substeps=4, contact="all")
    start = sim.energy()["total"]
    sim.run(30, 60.0)
    assert sim.energy()["total"] < 0.3 * start
    assert sim.metrics()["mean_strain"] < 0.01
    assert sim.metrics()["intersections"] == 0


@pytest.mark.parametrize("name", SCHEMES)
def test_only_the_world_that_jumped_is_damped(name):
    """And a world beside it goes on as if it were alone, bit for bit."""
    alone = wc.Simulation(wc.Model.build(swinging()), name, substeps=4)
    both = wc.Simulation(wc.Model.build_worlds([([swinging()], []), ([swinging()], [])]), name, substeps=4)
    for frame in range(6):
        if frame == 3:
            velocities = both.state.particle_qd.numpy()
            velocities[100] += 1.0
            both.state.particle_qd.assign(velocities)
        alone.step(DT)
        both.step(DT)
    first, second = both.state.particle_q.numpy().reshape(2, -1, 3)
    np.testing.assert_array_equal(first, alone.state.particle_q.numpy())
    assert np.abs(second - first).max() > 1e-4
    mine, others = (sim.integrator.newton.worlds.newton_total.numpy() for sim in (alone, both))
    assert others[0] == mine[0]  # nothing is solved there for the other world's sake


@pytest.mark.parametrize("name", SCHEMES)
def test_after_a_jump_a_step_is_two_of_implicit_euler(name):
    """With pins that are led, so that the clock counts."""
    led = wc.pin("top_right", wc.Motion.keyframes([(0, (0, 0, 0)), (2 * DT, (0, 0.01, 0)), (3 * DT, (0, 0.03, 0))]))
    model = wc.Model.build(sheet(pins=["top_left", led]), precision="float64")
    sims = [wc.Simulation(model, scheme, substeps=n) for scheme, n in ((name, 1), ("implicit_euler", 2), ("bdf2", 1))]
    for sim in sims:
        sim.step(DT)
    for sim in sims[1:]:
        sim.state.particle_q.assign(sims[0].state.particle_q)
    speeds = 1.5 * sims[0].state.particle_qd.numpy()
    for sim in sims:
        sim.state.particle_qd.assign(speeds)
        sim.step(DT)
    mine, euler, other = (sim.state.particle_q.numpy() for sim in sims)
    np.testing.assert_allclose(mine, euler, atol=1e-9)
    assert np.abs(mine - other).max() > 1e-5


@pytest.mark.parametrize("worlds", [None, [True]])
@pytest.mark.parametrize("name", SCHEMES)
def test_a_reset_is_no_jump(name, worlds):
    sim = wc.Simulation(wc.Model.build(swinging()), name, substeps=2)

    def way() -> np.ndarray:
        for _ in range(3):
            sim.step(DT)
        return sim.state.particle_q.numpy()

    first = way()
    sim.reset(worlds)
    np.testing.assert_array_equal(way(), first)


@pytest.mark.parametrize("what", ["particle_q", "particle_qd"])
def test_whatever_changes_a_state_is_a_jump(what):
    ways = []
    for times in (1.0, 1.0 + 1e-6):
        sim = wc.Simulation(wc.Model.build(swinging(), precision="float64"), "implicit_midpoint", substeps=1)
        sim.step(DT)
        array = getattr(sim.state, what)
        array.assign(times * array.numpy())
        sim.step(DT)
        ways.append(sim.state.particle_q.numpy())
    assert np.abs(ways[1] - ways[0]).max() > 1e-4  # far more than was changed: another rule took the step


@pytest.mark.parametrize("name", ["implicit_euler", "bdf2", "linear_implicit_euler", *SCHEMES])
def test_no_implicit_step_takes_cloth_through_its_own_cells(name):
    """A third of an edge, 10 mm, at √(v² + 2 g L) with L = 0.24 m; of two worlds the faster one counts."""

    def substeps(*speeds: float, contact: str = "all") -> int:
        worlds = [([replace(sheet(), velocity=(0.0, v, 0.0))], []) for v in speeds]
        return wc.Simulation(wc.Model.build_worlds(worlds), name, contact=contact).substeps_for(0.024)

    times = INTEGRATORS[name].steps_per_travel
    assert times == (3 if name == "linear_implicit_euler" else 1)
    found = [substeps(0.0), substeps(6.0), substeps(3.0), substeps(0.0, 6.0)]
    assert found == [times * count for count in (6, 16, 9, 16)]
    assert substeps(6.0, contact="none") == 1


def test_steps_of_xpbd_are_no_longer_than_its_sweeps_allow_nor_than_contact_does():
    def substeps(speed: float, contact: str) -> int:
        model = wc.Model.build(replace(sheet(), velocity=(0.0, speed, 0.0)))
        return wc.Simulation(model, "xpbd", contact=contact).substeps_for(0.024)

    assert substeps(0.0, "none") == substeps(0.0, "all") == substeps(12.0, "none") == 12
    assert substeps(12.0, "all") == 45


@pytest.mark.parametrize("name", ["vbd", "pbd", "projective_dynamics"])
def test_steps_of_other_position_based_schemes_are_no_longer_than_contact_allows_either(name):
    model = wc.Model.build(replace(sheet(), velocity=(0.0, 12.0, 0.0)))
    alone, among = (wc.Simulation(model, name, contact=contact).substeps_for(0.024) for contact in ("none", "all"))
    assert alone < among == 45


def test_steps_of_explicit_schemes_are_as_long_as_they_are_stable():
    cloth = replace(sheet(), velocity=(0.0, 6.0, 0.0))
    counts = [
        wc.Simulation(wc.Model.build(c), "symplectic_euler", contact="all").substeps_for(0.024)
        for c in (sheet(), cloth)
    ]
    assert counts[0] == counts[1]


def test_steps_for_contact_have_an_end():
    model = wc.Model.build(replace(sheet(), velocity=(0.0, 1e7, 0.0)))
    assert wc.Simulation(model, "implicit_euler", contact="all").substeps_for(0.024) == MAX_SUBSTEPS


def test_pinned_particles_are_not_thrown():
    thrown = [replace(sheet(pins=pins), velocity=(0.0, 60.0, 0.0)) for pins in ((), np.arange(80), np.arange(81))]
    steps = [travel_step(wc.Model.build(cloth)) for cloth in thrown]
    assert steps[0] == pytest.approx(0.01 / math.hypot(60.0, math.sqrt(2 * 9.81 * 0.24)))
    assert steps[1] == steps[0]
    assert math.isinf(steps[2])


@pytest.mark.parametrize("name", SCHEMES)
def test_a_hand_does_not_make_cloth_ring(name):
    """Undamped, cotton led by 10 cm in ten frames, one step each, flew about with 49 and 11 m/s."""
    both = [([wc.Cloth.grid((0.5, 0.5), (12, 12), pins="left")], []) for _ in range(2)]
    sim = wc.Simulation(wc.Model.build_worlds(both, device="cpu"), name, substeps=1)
    free = wc.Simulation(wc.Model.build_worlds(both, device="cpu"), name, substeps=1)
    sim.step(DT)
    hand = sim.grab(70)
    start, fastest = hand.point, 0.0
    for k in range(1, 31):
        hand.move(start + np.array([0.0, 0.0, 0.01 * min(k, 10)]))
        sim.step(DT)
        fastest = max(fastest, greatest_speeds(sim.model, sim.state)[0])
    free.run(31, 60.0)
    assert fastest < 5.0
    assert np.linalg.norm(hand.point - hand.target) < 0.05
    untouched = [each.state.particle_q.numpy()[144:] for each in (sim, free)]
    np.testing.assert_array_equal(*untouched)
    hand.release()
    sim.step(DT)
    assert not sim.integrator._jumped.numpy().any()
    free.state.particle_q.assign(free.state.particle_q.numpy() + 0.001)
    for jumps in (True, False):
        free.step(DT)
        assert bool(free.integrator._jumped.numpy().all()) == bool(free.integrator._jumped.numpy().any()) == jumps


ROUGH = {"stretch_stiffness": 1e5, "shear_stiffness": 2e4}


@pytest.mark.filterwarnings("ignore::warpcloth.errors.ConvergenceWarning")  # as implicit Euler has them there
@pytest.mark.parametrize("name", SCHEMES)
@pytest.mark.parametrize(
    ("fabric", "rough", "wind"),
    [
        ({}, 0.0, 0.0),
        ({"damping_time": 0.0}, 0.3, 0.0),
        (ROUGH, 0.3, 0.0),
        ({}, 0.0, 100.0),
        ({"damping_time": 0.1}, 0.3, 0.0),
    ],
)
def test_nothing_gains_energy_by_too_large_a_step(name, fabric, rough, wind):
    """At one step a frame, hung by two corners: 91 m/s as it is, 384 undamped, 879 if stiff; trapezoid, 6e4 if damped
    for long, 9e6 in a storm."""
    cloth = wc.Cloth.grid((1, 1), (17, 17), replace(wc.Fabric(), **fabric), pins=["top_left", "top_right"])
    sim = wc.Simulation(wc.Model.build(cloth, device="cpu"), name, air=wc.Air(wind=(wind, 0, 0)) if wind else None)
    noise = np.random.default_rng(0).standard_normal((2, 289, 3)) * (sim.model.particle_inv_mass.numpy() > 0.0)[:, None]
    sim.state.particle_q.assign(sim.state.particle_q.numpy() + 0.01 * rough * noise[0])
    sim.state.particle_qd.assign(sim.state.particle_qd.numpy() + rough * noise[1])
    start, fastest = sim.energy()["total"], 0.0
    for _ in range(20 if wind or fabric.get("damping_time") else 60):
        sim.step(DT)
        fastest = max(fastest, greatest_speeds(sim.model, sim.state)[0])
        assert wind or sim.energy()["total"] < 1.1 * start + 0.1
    assert sim.substeps == 1
    assert 1.0 < fastest < 15.0 + 2.0 * wind


@pytest.mark.parametrize("name", SCHEMES)
def test_motion_that_steps_resolve_is_not_damped(name):
    """Undamped cloth that swings with a thirtieth of a frame as its step keeps its energy, and takes no damped step."""
    fabric = replace(FABRIC, damping_time=0.0)
    cloth = wc.Cloth.grid((0.24, 0.24), (9, 9), fabric, pins=["top_left", "top_right"])
    sim = wc.Simulation(wc.Model.build(cloth, device="cpu", precision="float64"), name, substeps=30)
    start, kinetic = sim.energy()["total"], []
    for _ in range(30):
        sim.step(DT)
        kinetic.append(sim.energy()["kinetic"])
        assert not sim.integrator._damps.numpy().any()
    assert abs(sim.energy()["total"] - start) < 0.01 * max(kinetic)
