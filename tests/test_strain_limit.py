"""Strain limiting: gradient, momenta, the biphasic tensile curve at any resolution and with every kind of scheme."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

import warpcloth as wc
from warpcloth.forces import Forces, Linearization, StrainLimit
from warpcloth.stability import fastest_rates, rate_bounds
from warpcloth.state import State

LIMITED = wc.Fabric(
    stretch_stiffness=100.0, shear_stiffness=0.0, bend_stiffness=0.0, strain_limit=0.05, limit_stiffness=2000.0
)


def crumpled(seed: int = 0) -> tuple[Forces, State]:
    model = wc.Model.build(wc.Cloth.grid((0.3, 0.2), (4, 3), LIMITED), precision="float64")
    state = State.of(model)
    state.particle_q.assign(1.1 * state.particle_q.numpy() + np.random.default_rng(seed).normal(0.0, 0.02, (12, 3)))
    return Forces(model, [StrainLimit(model)], model.array(np.zeros((1, 3)), model.vec3)), state


def evaluated(forces: Forces, state: State) -> np.ndarray:
    state.particle_f.fill_(float("nan"))
    forces.evaluate(state)
    return state.particle_f.numpy().copy()


def test_force_is_the_slope_of_the_energy_and_the_matrix_that_of_the_force():
    forces, state = crumpled()
    model, f, middle, h = forces.model, evaluated(forces, state), state.particle_q.numpy().copy(), 1e-6
    assert np.linalg.norm(f) > 10.0
    at = Linearization(state, 1.0, 0.0, model.array([0.0], model.real))
    for x in np.random.default_rng(1).normal(size=(4, *f.shape)):
        out = wp.zeros_like(model.particle_q)
        forces.hessian_product(at, model.array(x, model.vec3), out)
        ends = []
        for sign in (1.0, -1.0):
            state.particle_q.assign(middle + sign * h * x)
            ends.append((forces.energy(state)["spring"], evaluated(forces, state)))
        state.particle_q.assign(middle)
        assert -np.sum(f * x) == pytest.approx((ends[0][0] - ends[1][0]) / (2.0 * h), rel=1e-6)
        slope = -(ends[0][1] - ends[1][1]) / (2.0 * h)
        assert np.abs(out.numpy() - slope).max() <= 1e-6 * np.abs(slope).max()
    blocks = wp.zeros(model.particle_count, dtype=model.kernels.precision.mat33)
    forces.hessian_diagonal(at, blocks)
    unit, out = np.zeros((12, 3)), wp.zeros_like(model.particle_q)
    unit[5, 1] = 1.0
    forces.hessian_product(at, model.array(unit, model.vec3), out)
    np.testing.assert_allclose(blocks.numpy()[5][:, 1], out.numpy()[5], rtol=1e-12, atol=1e-9)


def test_momenta_are_kept():
    forces, state = crumpled(2)
    f, q = evaluated(forces, state), state.particle_q.numpy()
    scale = np.abs(f).sum()
    assert np.abs(f.sum(axis=0)).max() <= 1e-14 * scale
    assert np.abs(np.cross(q, f).sum(axis=0)).max() <= 1e-14 * scale


@pytest.mark.parametrize(
    ("integrator", "substeps"), [("symplectic_euler", "auto"), ("implicit_euler", 2), ("xpbd", 250), ("vbd", 150)]
)
@pytest.mark.parametrize("cells", [2, 5])
def test_hanging_strip_is_biphasic_at_any_resolution(integrator, substeps, cells):
    """Under a load T per width: ε = T/Y up to the limit, ε_L + (T − Y ε_L)/(Y + Y_L) beyond. Here T is the weight of
    what hangs below, which each spring between two rows carries."""
    fabric = wc.Fabric(
        areal_density=8.0, stretch_stiffness=100.0, shear_stiffness=0.0, bend_stiffness=0.0, damping_time=0.02,
        strain_limit=0.05, limit_stiffness=2000.0,
    )  # fmt: skip
    cloth = wc.Cloth.grid((0.1, 0.2), (2, cells + 1), fabric, pins="top")
    simulation = wc.Simulation(
        wc.Model.build(cloth, precision="float64"), integrator, (0.0, -9.81, 0.0), substeps, contact="none"
    )
    simulation.run(30, 60.0)
    y = simulation.state.particle_q.numpy().reshape(cells + 1, 2, 3)[:, 0, 1]
    strain = np.diff(y) / (0.2 / cells) - 1.0
    load = 8.0 * 9.81 * 0.2 * (np.arange(cells) + 0.5) / cells
    expected = np.where(load < 5.0, load / 100.0, 0.05 + (load - 5.0) / 2100.0)
    assert load.max() > 5.0
    np.testing.assert_allclose(strain, expected, rtol=0.02)


KNIT = replace(LIMITED, stretch_stiffness_weft=70.0, shear_stiffness=35.0)


def limit_energy(cloth: wc.Cloth, factors: tuple[float, float, float]) -> float:
    """What the limit adds per area [N/m] as cloth is stretched evenly, over ½ times the square of its excess strain."""
    model = wc.Model.build(cloth, precision="float64")
    state = State.of(model)
    state.particle_q.assign(model.particle_q.numpy() * factors)
    excess = max(factors) - 1.0 - LIMITED.strain_limit
    return StrainLimit(model).energy(state)["spring"] / cloth.area / (0.5 * excess * excess)


@pytest.mark.parametrize("resolution", [(5, 5), (6, 5), (9, 8)])
def test_what_a_limit_adds_does_not_depend_on_the_shape_of_cells(resolution):
    """Cells of 1 : 1, 4 : 5 and 7 : 8, of a knit, whose structural springs carry half of its stretch stiffness."""
    along, across = (
        [limit_energy(wc.Cloth.grid((1.0, 1.0), n, KNIT), factors) for n in ((5, 5), resolution)]
        for factors in ((1.1, 1.0, 1.0), (1.0, 1.1, 1.0))
    )
    assert along == pytest.approx([KNIT.limit_stiffness] * 2)
    assert across[0] == pytest.approx(across[1])


@pytest.mark.filterwarnings("ignore::warpcloth.errors.FabricWarning")
@pytest.mark.parametrize("springs", ["stretch", "shear", "fitted"])
def test_meshes_have_all_of_the_limit_whatever_their_springs_have_of_the_fabric(springs):
    """Stretched alike in all directions each edge counts three times: as often as its triangles have directions."""
    fabric = replace(KNIT, stretch_stiffness_weft=None, shear_stiffness=15.0)
    cloth = wc.Cloth.disc(0.2, 3, fabric, springs=springs)
    assert limit_energy(cloth, (1.1, 1.1, 1.0)) == pytest.approx(3.0 * fabric.limit_stiffness)


@pytest.mark.parametrize("pins", [None, "left"])
def test_a_yarn_by_itself_is_limited_as_implicit_euler_has_it(pins):
    """Schemes that solve for springs alone take the limit afterwards, one spring after the other."""
    yarn = replace(LIMITED, stretch_stiffness=1e-6, damping_time=0.0)
    model = wc.Model.build(wc.Cloth.grid((0.1, 0.1), (2, 2), yarn, pins=pins), precision="float64")
    ends = []
    for name, options in (("xpbd", {"iterations": 1}), ("implicit_euler", {"tolerance": 1e-12})):
        sim = wc.Simulation(model, name, (0, 0, 0), 1, contact="none", integrator_options=options)
        sim.state.particle_q.assign(model.particle_q.numpy() * (1.2, 1.0, 1.0))
        sim.step(1e-3)
        ends.append(np.hstack([sim.state.particle_q.numpy(), sim.state.particle_qd.numpy()]))
    np.testing.assert_allclose(*ends, atol=1e-7)
    assert np.abs(ends[0][:, 3]).max() > 1.0


def test_captured_frames_equal_plain_ones():
    cloth = wc.Cloth.grid((0.3, 0.2), (4, 3), LIMITED, pins="left")
    for integrator in ("xpbd", "symplectic_euler"):
        results = []
        for graph in (True, False):
            simulation = wc.Simulation(wc.Model.build(cloth), integrator, substeps=60, contact="none", graph=graph)
            simulation.run(5)
            results.append(simulation.state.particle_q.numpy())
        assert np.array_equal(*results)


def test_automatic_steps_know_the_second_spring():
    """Three times as stiff as the first, it makes the fastest mode twice as fast, and so do bounds of it."""
    model = wc.Model.build(wc.Cloth.grid((0.2, 0.2), (4, 4), wc.Fabric(bend_stiffness=0.0)), precision="float64")
    model.spring_limit_stiffness.zero_()
    before = *fastest_rates(model), *rate_bounds(model)
    model.spring_limit_stiffness.assign(3.0 * model.spring_stiffness.numpy())
    after = *fastest_rates(model), *rate_bounds(model)
    np.testing.assert_allclose(np.array(after) / before, [2.0, 1.0, 2.0, 1.0], rtol=1e-9)
