"""Bending that position-based schemes smooth so that it does not limit their steps."""

import dataclasses
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial.legendre import Legendre

import warpcloth as wc
from warpcloth.errors import DivergedError, StabilityWarning
from warpcloth.forces import AppliedForce, Bending, Forces
from warpcloth.forces.mass_damping import MassDamping
from warpcloth.integrators.bending_filter import MOST_STAGES, BendingFilter
from warpcloth.stability import bending_rates, fastest_rates, largest_stable_step
from warpcloth.state import State

DENIM = wc.library_fabric("denim")
CLOTHS = {
    "grid": wc.Cloth.grid((0.2, 0.15), (25, 16), DENIM),
    "pinned": wc.Cloth.grid((0.1, 0.1), (12, 12), DENIM, pins=wc.pin("left")),
    "disc": wc.Cloth.disc(0.08, 9, dataclasses.replace(DENIM, bending_hysteresis=0.0)),
}


def model_of(cloth: wc.Cloth, **options) -> wc.Model:
    return wc.Model.build(cloth, precision="float64", device="cpu", **options)


def step_of(model: wc.Model, stages: int) -> float:
    """The longest step with so many stages."""
    z, ((stiff, damped),) = stages * (stages + 1) * 0.999, bending_rates(model)
    return z / (damped + np.sqrt(damped**2 + stiff * z))


def matrix_of(model: wc.Model, dt: float) -> np.ndarray:
    """h² K + 2 h C of one coordinate [kg], element by element."""
    elements, total = model.bending, np.zeros((model.particle_count, model.particle_count))
    start, particle, weight = (array.numpy() for array in (elements.start, elements.particle, elements.weight))
    law, friction = elements.law.numpy(), elements.friction.numpy()
    for e in range(model.bend_count):
        entries = slice(start[e], start[e + 1])
        w = np.bincount(particle[entries], weight[entries], model.particle_count)
        total += (dt * dt * (law[e, 0] + friction[e, 0]) + 2.0 * dt * law[e, 1]) * np.outer(w, w)
    return total


class Given(Bending):
    """Bending that pulls as it is told to, and resists as ever."""

    forces: np.ndarray

    def accumulate(self, state: State, time_offset: float) -> None:
        state.particle_f.assign(state.particle_f.numpy() + self.forces)


def filtered(model: wc.Model, dt: float, forces: np.ndarray, assembly: str = "scatter", ranges: int = 1) -> np.ndarray:
    """Forces of bending after the filter."""
    state, term = State.of(model), Given(model, assembly, ranges)
    term.forces, before = forces, np.random.default_rng(7).normal(size=forces.shape)
    state.particle_f.assign(before)
    scratch = tuple(State.of(model).particle_q for _ in range(4))
    for array in scratch:
        array.fill_(float("nan"))  # what was there before must not matter
    BendingFilter(model).accumulate(
        state, Forces(model, [term], model.array(np.zeros((1, 3)), model.vec3)), dt, scratch
    )
    return state.particle_f.numpy() - before


@pytest.mark.parametrize("name", sorted(CLOTHS))
@pytest.mark.parametrize(("needed", "stages"), [(3, 3), (4, 5), (7, 7), (13, 13)])
def test_it_is_the_polynomial_of_legendre(name, needed, stages):
    """M q(Z) M⁻¹ f with q(z) = (1 − P(1 − 2z/(s² + s)))/z, by eigenvalues; the same however products are summed."""
    model = model_of(CLOTHS[name])
    dt, masses = step_of(model, needed), model.particle_mass.numpy()
    assert BendingFilter(model).stages(dt) == stages
    forces = np.random.default_rng(stages).normal(size=(model.particle_count, 3))
    free = model.particle_inv_mass.numpy() > 0.0
    root = np.sqrt(masses[free])
    z, modes = np.linalg.eigh(matrix_of(model, dt)[np.ix_(free, free)] / np.outer(root, root))
    assert 0.3 * needed**2 < z[-1] < needed**2 + needed  # the bound is one, and not a poor one
    share = np.where(z < 1e-9, 1.0, (1.0 - Legendre.basis(stages)(1.0 - 2.0 * z / (stages**2 + stages))) / z.clip(1e-9))
    expected = forces.copy()
    expected[free] = root[:, None] * (modes @ (share[:, None] * (modes.T @ (forces[free] / root[:, None]))))
    for assembly, ranges in (("scatter", 1), ("gather", 1), ("scatter", 3)):
        np.testing.assert_allclose(filtered(model, dt, forces, assembly, ranges), expected, rtol=1e-9, atol=1e-9)
    momentum = filtered(model, dt, forces)[free].sum(axis=0)
    if name != "pinned":
        np.testing.assert_allclose(momentum, forces.sum(axis=0), rtol=1e-9)


@settings(max_examples=30)
@given(stages=st.integers(1, 30).map(lambda k: 2 * k + 1))
def test_no_mode_is_left_without_force_or_too_fast(stages):
    """0 < z q(z) ≤ 2 up to s² + s: below the limit of 4, with as much to spare as other steps have."""
    z = np.linspace(0.0, stages**2 + stages, 2000)[1:]
    zq = 1.0 - Legendre.basis(stages)(1.0 - 2.0 * z / (stages**2 + stages))
    assert zq.max() <= 2.0 + 1e-9
    assert (zq[z > 1.0] > 0.5).all()


def test_short_steps_are_left_alone():
    model = model_of(CLOTHS["grid"])
    dt = step_of(model, 1)
    forces = np.random.default_rng(0).normal(size=(model.particle_count, 3))
    np.testing.assert_allclose(filtered(model, dt, forces), forces, rtol=0.0, atol=1e-14)
    assert (np.abs(filtered(model, 1.01 * dt, forces) - forces) > 1e-12).all()
    omega, gamma = fastest_rates(model, without=("springs",))
    ((stiff, damped),) = bending_rates(model)
    assert omega**2 <= stiff <= 1.2 * omega**2
    assert gamma <= damped <= 1.2 * gamma


def strip(
    cells: int, substeps: int | str, integrator: str = "xpbd", iterations: int | None = None, **changes
) -> wc.Simulation:
    """Denim held at one end, its air thick."""
    fabric = dataclasses.replace(DENIM, **changes)
    size, count = (0.3, 0.06), (cells + 1, cells // 5 + 1)
    held = np.flatnonzero(np.arange(count[0] * count[1]) % count[0] < 2)
    model = wc.Model.build(wc.Cloth.grid(size, count, fabric, pins=wc.pin(held)), device="cpu")
    options = {} if iterations is None else {"iterations": iterations}
    forces = [MassDamping(model, 6.0)]
    return wc.Simulation(
        model, integrator, substeps=substeps, contact="none", forces=forces, integrator_options=options
    )


# What the sweeps of a scheme leave unsolved is less with shorter steps, too; projective dynamics leaves least.
@pytest.mark.parametrize(
    ("integrator", "allowed"), [("xpbd", 2e-3), ("pbd", 6e-3), ("projective_dynamics", 7e-4), ("vbd", 6e-3)]
)
def test_a_stiff_strip_bends_as_with_steps_that_need_no_filter(integrator, allowed):
    """Five stages instead of one; without the filter the strip never comes to rest."""
    sims = [strip(40, substeps, integrator) for substeps in (150, 20)]
    assert [sim.integrator._bending_filter.stages(1.0 / 60.0 / sim.substeps) for sim in sims] == [1, 5]
    for sim in sims:
        sim.run(100)
    fine, coarse = (sim.state.particle_q.numpy() for sim in sims)
    assert np.abs(coarse - fine).max() < allowed
    assert fine[:, 2].min() < -0.28
    without = strip(40, 20, integrator)
    without.integrator._bending_filter._world_rates.zero_()  # one stage, whatever the step
    without.run(100)
    assert without.energy()["kinetic"] > 1e3 * sims[1].energy()["kinetic"]


def test_the_filter_does_not_change_what_is_at_rest():
    """Where springs pull hardly at all, forces of bending and weight are in balance, and are with any step."""
    ends = []
    for substeps, stages in ((200, 1), (25, 5)):
        sim = strip(
            16, substeps, iterations=20, bending_rigidity=0.03, bending_rigidity_weft=0.02, bending_hysteresis=0.0
        )
        assert sim.integrator._bending_filter.stages(1.0 / 60.0 / substeps) == stages
        sim.run(120)
        assert sim.settled
        ends.append(sim.state.particle_q.numpy())
    assert 0.05 < np.ptp(ends[0][:, 2]) < 0.12
    np.testing.assert_allclose(ends[1], ends[0], atol=2e-5)


@pytest.mark.parametrize("integrator", ["xpbd", "projective_dynamics"])
def test_a_sheet_pulled_in_its_plane_is_not_stretched_by_the_filter(integrator):
    """At a row of vertices, which is as rough as a load can be: what springs hold must not be smoothed."""
    ends = []
    for rigidity in (0.0, 1e-3):
        fabric = wc.Fabric(
            stretch_stiffness=2000.0, shear_stiffness=200.0, bending_rigidity=rigidity, bend_stiffness=0.0
        )
        across = np.arange(33 * 5) % 33
        model = wc.Model.build(wc.Cloth.grid((0.32, 0.04), (33, 5), fabric, pins=wc.pin(np.flatnonzero(across < 2))))
        load, tip = AppliedForce(model), across == 32
        load.force.assign(np.outer(tip / tip.sum(), (0.5, 0.0, 0.0)))
        forces = [load, MassDamping(model, 20.0)]
        sim = wc.Simulation(
            model, integrator, (0.0, 0.0, 0.0), 11, contact="none", forces=forces,
            integrator_options={"iterations": 40},
        )  # fmt: skip
        assert rigidity == 0.0 or sim.integrator._bending_filter.stages(1.0 / 660.0) >= 5
        sim.run(180)
        assert sim.settled
        ends.append((sim.state.particle_q.numpy() - model.particle_q.numpy())[tip, 0].mean())
    assert 1e-3 < ends[0] < 5e-3
    assert ends[1] == pytest.approx(ends[0], rel=0.03)


def test_automatic_steps_hardly_shrink_with_the_cells_of_a_stiff_fabric():
    counts = [strip(cells, "auto").substeps_for(1.0 / 60.0) for cells in (40, 80)]
    limits = [1.0 / 60.0 / (1.4 / fastest_rates(strip(cells, 1).model, without=("springs",))[0]) for cells in (40, 80)]
    assert limits[1] > 3.5 * limits[0] > 100.0
    assert counts[1] < 0.2 * limits[1]
    assert strip(80, 1).integrator._bending_filter.stages(1.0 / 60.0 / counts[1]) in (9, 11)
    model = wc.Model.build(wc.Cloth.grid((0.3, 0.06), (41, 9), DENIM), differentiable=True, device="cpu")
    omega, gamma = fastest_rates(model, without=("springs",))
    scheme = wc.Simulation(model, "xpbd").integrator
    assert largest_stable_step(model, scheme) == pytest.approx(0.7 * scheme.explicit_step(omega, gamma))  # no filter


def test_steps_that_smooth_too_much_warn_and_still_hold_together():
    sim = strip(40, 3)
    assert sim.integrator._bending_filter.stages(1.0 / 180.0) > MOST_STAGES
    with pytest.warns(StabilityWarning, match="xpbd is unstable with 3 substeps"):
        sim.step(1.0 / 60.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sim.run(120)
        strip(40, "auto").step(1.0 / 60.0)
    assert np.abs(sim.state.particle_q.numpy()).max() < 0.35


def test_steps_beyond_all_measure_fail_loudly_and_soon():
    """A plate of steel in one step a frame would need thousands of stages."""
    sim = strip(40, 1, bending_rigidity=10.0, bending_rigidity_weft=10.0, bending_hysteresis=0.0)
    assert sim.integrator._bending_filter.stages(1.0 / 60.0) == 63
    with pytest.warns(StabilityWarning, match="unstable with 1 substep"), pytest.raises(DivergedError):
        sim.step(1.0 / 60.0)


def test_a_world_is_what_it_is_alone_beside_a_stiffer_one_on_any_threads():
    soft = wc.Cloth.grid((0.3, 0.3), (30, 30), wc.library_fabric("silk"), pins=wc.pin("left"))
    firm = wc.Cloth.grid((0.3, 0.3), (40, 40), wc.library_fabric("wool"), pins=wc.pin("left"))
    stiff = wc.Cloth.disc(0.15, 16, DENIM)
    options = {"integrator": "xpbd", "substeps": 8, "contact": "none"}
    alone = []
    for cloth in (soft, firm, stiff):
        sim = wc.Simulation(wc.Model.build(cloth, device="cpu"), **options)
        sim.run(5)
        alone.append((sim.state.particle_q.numpy(), sim.integrator._bending_filter.stages(1.0 / 480.0)))
    assert len({stages for _, stages in alone}) == 3
    for threads in (1, 2):
        model = wc.Model.build_worlds([([soft], []), ([firm], []), ([stiff], [])], device="cpu")
        sim = wc.Simulation(model, threads=threads, **options)
        sim.run(5)
        np.testing.assert_array_equal(sim.state.particle_q.numpy(), np.concatenate([q for q, _ in alone]))
