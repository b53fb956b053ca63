"""Our integrators as a solver of Newton's, over its own arrays, against Newton's own solver."""

import importlib.util
import sys

import newton
import numpy as np
import pytest
import warp as wp
from host_watch import no_host
from integrator_problems import NAMES

import warpcloth as wc
from warpcloth.errors import FabricWarning, InputError, MissingExtraError
from warpcloth.integrators import INTEGRATORS
from warpcloth.interop.newton import SolverMassSpring, add_cloth

STILL = dict.fromkeys(("tri_ke", "tri_ka", "tri_kd", "tri_drag", "tri_lift", "edge_ke", "edge_kd"), 0.0)
ZERO, UPRIGHT = wp.vec3(0.0, 0.0, 0.0), wp.quat_identity()
FABRIC = wc.Fabric(stretch_stiffness=50.0, shear_stiffness=20.0, damping_time=1e-3)


def newton_grid(builder: newton.ModelBuilder, n: int = 10) -> None:
    """As Newton makes a cloth of springs, moving sideways at first."""
    builder.add_cloth_grid(
        pos=wp.vec3(0, 0, 1), rot=UPRIGHT, vel=wp.vec3(0.2, 0.1, 0), dim_x=n, dim_y=n, cell_x=0.05, cell_y=0.05,
        mass=0.002, fix_left=True, add_springs=True, spring_ke=200.0, spring_kd=0.02, particle_radius=0.005, **STILL,
    )  # fmt: skip


def newton_mesh(builder: newton.ModelBuilder) -> None:
    """Newton's springs on a mesh of ours."""
    disc = wc.Cloth.disc(0.3, 6)
    builder.add_cloth_mesh(
        pos=wp.vec3(0, 0, 1), rot=UPRIGHT, scale=1.0, vel=ZERO, vertices=disc.points.tolist(),
        indices=disc.triangles.ravel().tolist(), density=0.5, add_springs=True, spring_ke=200.0, spring_kd=0.02,
        particle_radius=0.005, **STILL,
    )  # fmt: skip
    builder.particle_mass[0] = builder.particle_mass[40] = 0.0


def our_grid(builder: newton.ModelBuilder) -> None:
    add_cloth(builder, wc.Cloth.grid((0.4, 0.4), (9, 9), FABRIC, pins=[0, 8], transform=(0, 0, 1)))


def finished(*makers, worlds: int = 1) -> newton.Model:
    builder = newton.ModelBuilder()
    for _ in range(worlds):
        if worlds > 1:
            builder.begin_world()
        for make in makers:
            make(builder)
        if worlds > 1:
            builder.end_world()
    model = builder.finalize(device="cpu")
    model.particle_grid = None  # no contact among particles
    return model


def roll_out(model, solver, steps: int, dt: float, force=None) -> newton.State:
    now, later = model.state(), model.state()
    for _ in range(steps):
        now.clear_forces()
        if force is not None:
            now.particle_f.assign(force)
        solver.step(now, later, None, None, dt)
        now, later = later, now
    return now


def semi_implicit(model: newton.Model) -> newton.solvers.SolverBase:
    return newton.solvers.SolverSemiImplicit(model, enable_tri_contact=False)


def difference(a: newton.State, b: newton.State) -> float:
    return float(np.abs(a.particle_q.numpy() - b.particle_q.numpy()).max())


@pytest.mark.parametrize("make", [newton_grid, newton_mesh, our_grid])
def test_symplectic_euler_follows_newtons_own_solver(make):
    """Same law, same scheme, other order of sums: a micrometre after 200 steps."""
    model = finished(make)
    ours, theirs = SolverMassSpring(model), semi_implicit(model)
    dt = 0.8 * ours.stable_step()
    force = np.random.default_rng(0).normal(0.0, 0.005, (model.particle_count, 3)).astype(np.float32)
    a, b = (roll_out(model, solver, 200, dt, force) for solver in (ours, theirs))
    assert difference(a, b) < 1e-6
    assert np.abs(a.particle_q.numpy() - model.particle_q.numpy()).max() > 0.05


def test_flags_worlds_gravity_and_massless_particles_are_newtons():
    model = finished(newton_grid, worlds=3)
    model.set_gravity((1.0, 0.0, -2.0), world=1)
    model.set_gravity((0.0, 3.0, 0.0), world=2)
    flags = model.particle_flags.numpy()
    flags[[5, 17, 200]] = 0
    flags[[0, 11]] = 1
    model.particle_flags.assign(flags)
    velocity = model.particle_qd.numpy()
    velocity[[0, 11]] = (0.0, 0.0, 0.3)  # massless but active: Newton lets them go on
    model.particle_qd.assign(velocity)
    ours, theirs = SolverMassSpring(model), semi_implicit(model)
    a, b = (roll_out(model, solver, 200, 5e-4) for solver in (ours, theirs))
    assert difference(a, b) < 1e-6
    assert a.particle_q.numpy()[0, 2] == pytest.approx(1.03, abs=1e-5)
    np.testing.assert_array_equal(a.particle_q.numpy()[5], model.particle_q.numpy()[5])


@pytest.mark.parametrize("name", ["symplectic_euler", "xpbd"])
def test_springs_that_change_are_read_anew_when_told(name):
    model = finished(newton_grid)
    solver = SolverMassSpring(model, name, substeps=4)
    before = roll_out(model, solver, 20, 2e-3)
    model.spring_stiffness.fill_(20.0)
    solver.reset(model.state())
    assert difference(roll_out(model, solver, 20, 2e-3), before) == 0.0
    solver.notify_model_changed(newton.ModelFlags.MODEL_PROPERTIES)
    after = roll_out(model, solver, 20, 2e-3)
    assert difference(after, before) > 1e-4
    assert difference(after, roll_out(model, SolverMassSpring(model, name, substeps=4), 20, 2e-3)) == 0.0


def test_nothing_is_copied():
    model = finished(newton_grid, worlds=2)
    solver = SolverMassSpring(model)
    names = ("particle_q", "particle_qd", "particle_mass", "particle_radius", "particle_world", "spring_rest_length")
    for name in (*names, "spring_indices"):
        assert getattr(solver.network, name).ptr == getattr(model, name).ptr
    assert solver.forces.world_gravity.ptr == model.gravity.ptr
    now, later = model.state(), model.state()
    seen = {}
    step = solver.integrator.step

    def spy(network, state_in, state_out, forces, dt):
        seen.update(start=state_in, end=state_out, applied=solver.forces.terms[1].force)
        step(network, state_in, state_out, forces, dt)

    solver.integrator.step = spy
    force = now.particle_f.numpy()
    solver.step(now, later, None, None, 1e-3)
    for ours, theirs in ((seen["start"], now), (seen["end"], later)):
        assert (ours.particle_q.ptr, ours.particle_qd.ptr) == (theirs.particle_q.ptr, theirs.particle_qd.ptr)
    assert seen["applied"].ptr == now.particle_f.ptr
    np.testing.assert_array_equal(now.particle_f.numpy(), force)
    np.testing.assert_allclose(solver.network.spring_stiffness.numpy(), 200.0 * model.spring_rest_length.numpy())


@pytest.mark.parametrize("name", NAMES)
def test_any_integrator_steps_a_newton_model(name):
    """By 0.1 s all have gone where many small steps of Newton's solver go; pins and inactive particles stay."""
    model = finished(our_grid)
    flags = model.particle_flags.numpy()
    flags[40] = 0
    model.particle_flags.assign(flags)
    truth = roll_out(model, semi_implicit(model), 400, 2.5e-4).particle_q.numpy()
    end = roll_out(model, SolverMassSpring(model, name, substeps=10), 10, 0.01).particle_q.numpy()
    start = model.particle_q.numpy()
    assert np.abs(truth - start).max() > 0.02
    if INTEGRATORS[name].order > 0:  # else its material depends on the step
        assert np.abs(end - truth).max() < 2e-3
    np.testing.assert_array_equal(end[[0, 8, 40]], start[[0, 8, 40]])


@pytest.mark.parametrize("name", ["xpbd", "vbd", "implicit_euler", "velocity_verlet"])
def test_what_flies_along_with_massless_particles_is_not_pulled_at(name):
    """To the rounding of float32: a scheme knows where they are within its step, and how fast."""
    builder, v = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0)), np.array([1.0, 0.5, 0.2])
    cloth = wc.Cloth.grid((0.4, 0.4), (9, 9), FABRIC, pins=[0, 8], transform=(0, 0, 1), velocity=v)
    add_cloth(builder, cloth)
    model = builder.finalize(device="cpu")
    model.particle_qd.assign(np.tile(v, (81, 1)))
    end = roll_out(model, SolverMassSpring(model, name, substeps=10), 20, 0.01).particle_q.numpy()
    np.testing.assert_allclose(end - model.particle_q.numpy(), np.tile(0.2 * v, (81, 1)), atol=5e-5)
    ends, rest = cloth.springs.indices, cloth.springs.rest_lengths
    assert np.abs(np.linalg.norm(end[ends[:, 1]] - end[ends[:, 0]], axis=1) / rest - 1.0).max() < 1e-4


@pytest.mark.parametrize("name", ["xpbd", "implicit_midpoint"])
def test_particles_of_no_world_may_come_before_those_of_worlds(name):
    """As where something stands before the builder's first world begins; they share a world with those at the end."""
    builder = newton.ModelBuilder()
    our_grid(builder)
    for _ in range(2):
        builder.begin_world()
        our_grid(builder)
        builder.end_world()
    our_grid(builder)
    model = builder.finalize(device="cpu")
    model.particle_grid = None
    for world in range(2):
        model.set_gravity((3.0 * world, 0.0, -5.0), world=world)
    truth = roll_out(model, semi_implicit(model), 400, 2.5e-4).particle_q.numpy()
    end = roll_out(model, SolverMassSpring(model, name, substeps=10), 10, 0.01).particle_q.numpy()
    assert np.abs(end - truth).max() < 2e-3
    assert np.abs(truth - model.particle_q.numpy()).max() > 0.02


@pytest.mark.parametrize("name", ["velocity_verlet", "pefrl"])
def test_damping_that_comes_later_is_as_if_it_had_been_there(name):
    """Schemes treat forces that depend on velocities in another way."""
    ends = []
    for late in (False, True):
        model = finished(newton_grid)
        damping = model.spring_damping.numpy().copy()
        if late:
            model.spring_damping.zero_()
        solver = SolverMassSpring(model, name, substeps=20)
        model.spring_damping.assign(damping)
        if late:
            solver.notify_model_changed(newton.ModelFlags.MODEL_PROPERTIES)
        ends.append(roll_out(model, solver, 10, 0.005).particle_q.numpy())
    np.testing.assert_array_equal(*ends)


@pytest.mark.parametrize("name", ["symplectic_euler", "xpbd", "bdf2"])
def test_reset_with_a_world_mask(name):
    model = finished(newton_grid, worlds=3)
    solver, world = SolverMassSpring(model, name, substeps=4), model.particle_world.numpy()
    fresh = roll_out(model, SolverMassSpring(model, name, substeps=4), 3, 2e-3).particle_q.numpy()
    longer = roll_out(model, SolverMassSpring(model, name, substeps=4), 8, 2e-3).particle_q.numpy()
    now, later = roll_out(model, solver, 5, 2e-3), model.state()
    mask = wp.array([False, True, False, False], dtype=wp.bool, device="cpu")
    solver.reset(now, mask)
    np.testing.assert_array_equal(now.particle_q.numpy()[world == 1], model.particle_q.numpy()[world == 1])
    np.testing.assert_allclose(solver.world_time.numpy()[:3], [0.01, 0.0, 0.01])
    for _ in range(3):
        solver.step(now, later, None, None, 2e-3)
        now, later = later, now
    end = now.particle_q.numpy().copy()
    np.testing.assert_array_equal(end, np.where(world[:, None] == 1, fresh, longer))
    solver.reset(now, flags=newton.StateFlags.PARTICLE_QD)
    np.testing.assert_array_equal(now.particle_q.numpy(), end)
    np.testing.assert_array_equal(now.particle_qd.numpy(), model.particle_qd.numpy())


def test_steps_in_a_graph_are_the_steps():
    model = finished(newton_grid)
    plain, caught = SolverMassSpring(model, "xpbd", substeps=3), SolverMassSpring(model, "xpbd", substeps=3)
    a, b = model.state(), model.state()
    caught.step(a, b, None, None, 1e-3)
    caught.step(b, a, None, None, 1e-3)
    with wp.ScopedCapture(device="cpu") as capture:
        caught.step(a, b, None, None, 1e-3)
        caught.step(b, a, None, None, 1e-3)
    for _ in range(4):
        wp.capture_launch(capture.graph)
    np.testing.assert_array_equal(a.particle_q.numpy(), roll_out(model, plain, 10, 1e-3).particle_q.numpy())
    model.spring_stiffness.fill_(20.0)
    for solver in (plain, caught):
        solver.notify_model_changed(newton.ModelFlags.MODEL_PROPERTIES)
    caught.reset(a)
    for _ in range(4):
        wp.capture_launch(capture.graph)
    np.testing.assert_array_equal(a.particle_q.numpy(), roll_out(model, plain, 8, 1e-3).particle_q.numpy())


@pytest.mark.parametrize("name", [name for name in NAMES if not INTEGRATORS[name].adaptive])
def test_a_step_does_not_look_back_to_the_host(name, monkeypatch):
    model = finished(our_grid)
    solver, now, later = SolverMassSpring(model, name), model.state(), model.state()
    mask = wp.array([True, True], dtype=wp.bool, device="cpu")
    for patched in (False, True):  # the first time compiles and allocates
        if patched:
            no_host(monkeypatch)
        solver.step(now, later, None, None, 1e-3)
        solver.step(later, now, None, None, 1e-3)
        solver.reset(now)
        if not patched:
            solver.reset(now, mask)


def test_a_cloth_in_a_builder_is_that_cloth():
    """Its springs in Newton's units, its masses; and SolverMassSpring does with them what a simulation does."""
    cloth = wc.Cloth.grid((0.4, 0.4), (9, 9), FABRIC, pins=[0, 8], transform=(0, 0, 1), velocity=(0.1, 0, 0))
    builder = newton.ModelBuilder()
    builder.add_particle(ZERO, ZERO, 1.0)
    assert add_cloth(builder, cloth) == range(1, 82)
    model = builder.finalize(device="cpu")
    net = cloth.springs
    np.testing.assert_allclose(model.spring_stiffness.numpy(), net.stiffness / net.rest_lengths, rtol=1e-6)
    np.testing.assert_allclose(model.spring_rest_length.numpy(), net.rest_lengths, rtol=1e-6)
    assert model.particle_mass.numpy()[1:].sum() == pytest.approx(cloth.mass - cloth.masses[cloth.pinned].sum())
    assert model.tri_count == len(cloth.triangles)
    simulation = wc.Simulation(wc.Model.build([cloth], device="cpu"), substeps=200, contact="none")
    simulation.step(0.1)
    end = roll_out(model, SolverMassSpring(model), 200, 5e-4).particle_q.numpy()
    np.testing.assert_allclose(end[1:], simulation.state.particle_q.numpy(), atol=2e-6)


def test_edges_have_the_bending_energy_of_the_fabric():
    """½ B κ² A for a grid on a cylinder, less half a cell at either end, where no edge is bent."""
    rigidity, radius = 1e-4, 1.0
    cloth = wc.Cloth.grid((0.5, 0.5), (11, 11), wc.Fabric(bending_rigidity=rigidity))
    builder = newton.ModelBuilder()
    add_cloth(builder, cloth)
    rows = np.array(builder.edge_indices).reshape(-1, 4)
    inner = (rows >= 0).all(axis=1)
    stiffness = np.array(builder.edge_bending_properties)[inner, 0]
    x, y = cloth.points[:, 0] / radius, cloth.points[:, 1]
    bent = np.stack([radius * np.sin(x), y, radius * (1.0 - np.cos(x))], axis=1)
    a, b, c, d = (bent[rows[inner, k]] for k in range(4))
    length = np.linalg.norm(d - c, axis=1)
    one, two = np.cross(c - a, d - a), np.cross(d - b, c - b)
    sizes = np.linalg.norm(one, axis=1) * np.linalg.norm(two, axis=1)
    angle = np.arccos(np.minimum(np.sum(one * two, axis=1) / sizes, 1.0))
    energy = np.sum(0.5 * stiffness * length * angle**2)
    assert energy == pytest.approx(0.5 * rigidity / radius**2 * cloth.area * 9 / 10, rel=1e-3)


def test_what_newton_cannot_have_is_said():
    move = wc.Motion.keyframes([(0, (0, 0, 0)), (1, (1, 0, 0))])
    with pytest.raises(InputError, match="must have pins without motion for Newton, got a moving one"):
        add_cloth(newton.ModelBuilder(), wc.Cloth.grid(resolution=(3, 3), pins=[wc.pin([0], move)]))
    rich = wc.Fabric(bending_hysteresis=1e-3, strain_limit=0.1, limit_stiffness=10.0)
    with pytest.warns(FabricWarning, match="'cloth' has no bending_hysteresis, strain_limit in Newton"):
        add_cloth(newton.ModelBuilder(), wc.Cloth.grid(resolution=(3, 3), fabric=rich))
    with pytest.raises(InputError, match=r"^Builder must be a newton.ModelBuilder, got int\.$"):
        add_cloth(3, wc.Cloth.grid(resolution=(3, 3)))
    with pytest.raises(InputError, match=r"^Cloth must be a warpcloth.Cloth, got int\.$"):
        add_cloth(newton.ModelBuilder(), 3)


def test_misuse_is_one_sentence():
    model = finished(newton_grid)
    solver, state = SolverMassSpring(model), model.state()
    empty = newton.ModelBuilder().finalize(device="cpu")
    pair = newton.ModelBuilder()
    pair.add_particles([ZERO, ZERO], [ZERO, ZERO], [1.0, 1.0])
    pair.add_spring(0, 1, 1.0, 0.0, 0.0)
    mask, numbers = (wp.zeros(n, dtype=t, device="cpu") for n, t in ((1, wp.bool), (2, wp.int32)))
    for sentence, call, *arguments in (
        ("Model must be a newton.Model, got int.", SolverMassSpring, 3),
        ("The Newton model must have particles, got none.", SolverMassSpring, empty),
        ("rest_lengths[0] is 0, but must be greater than 0.", SolverMassSpring, pair.finalize(device="cpu")),
        ("state_in and state_out must be two states, got one and the same.", solver.step, state, state, None, None, 1),
        ("state_in must be a newton.State, got NoneType.", solver.step, None, state, None, None, 1),
        ("Dt must be a number greater than 0 and at most 1000, got 0.0.", solver.step, state, state, None, None, 0.0),
        ("World_mask must have shape (2,), got (1,).", solver.reset, state, mask),
        ("World_mask must be of dtype bool, got int32.", solver.reset, state, numbers),
    ):
        with pytest.raises(InputError) as error:
            call(*arguments)
        assert str(error.value) == sentence


def test_newton_missing_names_the_extra(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    monkeypatch.delitem(sys.modules, "warpcloth.interop.newton")
    with pytest.raises(MissingExtraError, match=r"pip install 'warpcloth\[newton\]'"):
        importlib.import_module("warpcloth.interop.newton")
