"""Gradients of roll-outs, against central finite differences, closed forms, and each other."""

import numpy as np
import pytest
import trimesh
import warp as wp
from gradient_checks import AIR, FABRIC, RandomLoss, assert_slopes_agree, crumpled

import warpcloth as wc
from warpcloth.errors import InputError, NotDifferentiableError
from warpcloth.forces import MassDamping
from warpcloth.gradients import Rollout

GRADIENT_SCHEMES = ("forward_euler", "midpoint", "trapezoidal", "rk4", "velocity_verlet", "pefrl")


@pytest.mark.parametrize("assembly", ["scatter", "gather"])
@pytest.mark.parametrize("integrator", ["symplectic_euler", "xpbd"])
def test_every_gradient_equals_differences_through_200_steps(integrator, assembly):
    rollout = Rollout(crumpled(integrator, 40, assembly=assembly), 5, observe=[2, 5])
    assert rollout.steps == 200
    assert set(rollout.gradients) == {
        "particle_q", "particle_qd", "particle_mass", "gravity", "spring_rest_length", "spring_stiffness",
        "spring_damping", "bend_law", "bend_friction", "tri_air_drag", "tri_air_friction", "air_density", "wind",
    }  # fmt: skip
    assert_slopes_agree(RandomLoss(rollout), h=1e-5)  # by bend_law losses change least: 1e-6 leaves three digits


@pytest.mark.parametrize("integrator", GRADIENT_SCHEMES)
def test_gradients_of_each_scheme_through_200_steps(integrator):
    assert_slopes_agree(RandomLoss(Rollout(crumpled(integrator, 40), 5, observe=[5])), together=True)


def test_gradients_of_pressure_and_strain_limits():
    fabric = wc.Fabric(stretch_stiffness=200.0, shear_stiffness=50.0, strain_limit=0.002, limit_stiffness=300.0)
    ball = trimesh.creation.icosphere(0, 0.1)
    ball.apply_translation((0.0, 0.0, 1.0))
    cloths = [
        wc.Cloth.from_mesh(ball, fabric=fabric, inflation=wc.Inflation(pressure=50.0, gas=gas), name=str(gas))
        for gas in (True, False)
    ]
    model = wc.Model.build(cloths, precision="float64", differentiable=True)
    rollout = Rollout(wc.Simulation(model, "rk4", substeps=60), 1, observe=[1])
    loss = RandomLoss(rollout)
    assert {"bag_pressure", "spring_limit", "spring_limit_stiffness"} <= set(rollout.gradients)
    assert_slopes_agree(loss)
    loss.value()
    stretched = model.spring_limit.numpy() < 0.01
    assert loss.gradients()["spring_limit_stiffness"][stretched].any()


def test_gradients_of_pressure_that_turns_with_the_cloth():
    """As position-based schemes take it: it depends on velocities, too."""
    fabric = wc.Fabric(stretch_stiffness=200.0, shear_stiffness=50.0)
    inflation = wc.Inflation(pressure=50.0)
    ball = wc.Cloth.from_mesh(trimesh.creation.icosphere(0, 0.1), fabric=fabric, inflation=inflation)
    model = wc.Model.build(ball, precision="float64", differentiable=True)
    model.particle_qd.assign(np.cross([0.0, 0.0, 10.0], model.particle_q.numpy()))
    rollout = Rollout(wc.Simulation(model, "xpbd", substeps=20), 1, observe=[1])
    assert_slopes_agree(RandomLoss(rollout))


def test_oscillator():
    """Implicit or not, gradients of one spring's linear motion are powers of the step's matrix."""
    m, k, r, h, steps = 0.05, 20.0, 0.25, 1e-3, 120
    model = wc.Model.from_springs(
        [(0, 0, 0), (0.3, 0, 0)], m, [[0, 1]], r, k, 0.0, pinned=[0], precision="float64", differentiable=True
    )
    rollout = Rollout(wc.Simulation(model, gravity=(0, 0, 0), substeps=steps), 1, fps=1.0 / (h * steps))
    rollout.forward()
    gradients = rollout.backward(particle_q=[(0, 0, 0), (1, 0, 0)])
    s = h * h * k / (r * m)
    power = np.linalg.matrix_power(np.array([[1.0 - s, h], [-s / h, 1.0]]), steps)
    assert gradients["particle_q"].numpy()[1, 0] == pytest.approx(power[0, 0], rel=1e-10)
    assert gradients["particle_qd"].numpy()[1, 0] == pytest.approx(power[0, 1], rel=1e-10)


@pytest.mark.parametrize("assembly", ["scatter", "gather"])
@pytest.mark.parametrize("integrator", ["symplectic_euler", "velocity_verlet", "xpbd"])
def test_a_rollout_is_the_simulation(integrator, assembly):
    """To the last bit, but where the one scatters spring by spring and the other row by row.

    XPBD sweeps over the springs of models without gradients in another order; see the test below.
    """
    rollout = Rollout(crumpled(integrator, 10, assembly=assembly), 3)
    rollout.forward()
    repeated = rollout.forward()
    plain = crumpled(integrator, 10, differentiable=integrator == "xpbd", assembly=assembly)
    rounding = 1e-12 if assembly == "scatter" and integrator != "xpbd" else 0.0
    for state in repeated:
        plain.step(1.0 / 60.0)
        for name in ("particle_q", "particle_qd"):
            ours, theirs = getattr(state, name).numpy(), getattr(plain.state, name).numpy()
            np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=rounding)
    assert rollout.simulation.time == pytest.approx(3.0 / 60.0)


def test_the_order_of_xpbd_hardly_shows_where_its_steps_are_small():
    ends = []
    for differentiable in (False, True):
        sim = crumpled("xpbd", 640, differentiable=differentiable)
        sim.step(1.0 / 60.0)
        ends.append(sim.state.particle_q.numpy())
    way = np.abs(ends[0] - crumpled("xpbd", 1).state.particle_q.numpy()).max()
    assert 0.0 < np.abs(ends[0] - ends[1]).max() < 1e-3 * way


@wp.kernel
def launch_all(velocity: wp.array(dtype=wp.vec3d), particle_qd_out: wp.array(dtype=wp.vec3d)):
    i = wp.tid()
    particle_qd_out[i] = velocity[0]


@wp.kernel
def squared_miss(particle_q: wp.array(dtype=wp.vec3d), target: wp.vec3d, loss_out: wp.array(dtype=wp.float64)):
    miss = particle_q[wp.tid()] - target
    wp.atomic_add(loss_out, 0, wp.dot(miss, miss))


def test_own_kernels_before_and_after_on_one_tape():
    """From a throw, through the roll-out, to a loss: the derivative with respect to the throw."""
    model = wc.Model.build([wc.Cloth.grid((0.2, 0.2), (3, 3))], precision="float64", differentiable=True)
    rollout = Rollout(wc.Simulation(model, substeps=10), 6)
    velocity = wp.array([(1.0, 0.5, 2.0)], dtype=wp.vec3d, requires_grad=True)
    target, values = wp.vec3d(1.0, 0.2, 0.3), []

    def thrown(tape: wp.Tape) -> wp.array:
        loss = wp.zeros(1, dtype=wp.float64, requires_grad=True)
        with tape:
            wp.launch(launch_all, 9, [velocity], [rollout.start.particle_qd])
        rollout.forward(tape)
        with tape:
            wp.launch(squared_miss, 9, [rollout.end.particle_q, target], [loss])
        return loss

    for h in (1e-5, -1e-5):
        velocity.assign([(1.0 + h, 0.5, 2.0)])
        values.append(float(thrown(wp.Tape()).numpy()[0]))
    velocity.assign([(1.0, 0.5, 2.0)])
    tape = wp.Tape()
    tape.backward(thrown(tape))
    assert velocity.grad.numpy()[0, 0] == pytest.approx((values[0] - values[1]) / 2e-5, rel=1e-6)
    assert np.abs(rollout.gradients["gravity"].numpy()).max() > 0.0
    tape.zero()
    assert not rollout.gradients["gravity"].numpy().any()
    assert not velocity.grad.numpy().any()


class Magnet(wc.UserForce):
    """A force of the caller's own, of a kernel of their own."""

    name = "magnet"

    def __init__(self, strength: float):
        self.strength = wp.array([strength], dtype=wp.float64)

    def accumulate(self, state: wc.State, time_offset: float) -> None:
        inputs, count = [self.strength, state.particle_q], len(state.particle_q)
        wp.launch(pull_to_the_origin, count, inputs, [state.particle_f])

    def parameters(self) -> dict:
        return {"strength": self.strength}


@wp.kernel
def pull_to_the_origin(
    strength: wp.array(dtype=wp.float64), particle_q: wp.array(dtype=wp.vec3d), particle_f: wp.array(dtype=wp.vec3d)
):
    i = wp.tid()
    x = particle_q[i]
    particle_f[i] = particle_f[i] - strength[0] * x / (wp.float64(0.1) + wp.dot(x, x))


def test_forces_of_the_callers_own():
    model = wc.Model.build([wc.Cloth.grid((0.2, 0.2), (3, 3))], precision="float64", differentiable=True)
    pushes = model.array(0.01 * np.random.default_rng(0).normal(size=(9, 3)), model.vec3)
    forces = [Magnet(0.01), wc.AppliedForce(model, pushes), MassDamping(model, 3.0)]
    rollout = Rollout(wc.Simulation(model, substeps=10, forces=forces), 3)
    assert {"strength", "applied_force"} <= set(rollout.parameters)
    rollout.start.particle_q.assign(rollout.start.particle_q.numpy() + np.array([0.1, 0.2, 0.3]))
    loss = RandomLoss(rollout)
    assert_slopes_agree(loss, h=1e-5)


@pytest.mark.parametrize("name", ["strength", "spring_stiffness", "particle_friction", "particle_q"])
def test_two_parameters_of_one_name_are_refused(name):
    """Gradients are told by name, so one of them would have none."""

    class Other(Magnet):
        def parameters(self) -> dict:
            return {name: self.strength}

    cloths, obstacles = [wc.Cloth.grid((0.2, 0.2), (3, 3), transform=(0, 0, 1))], [wc.Plane()]
    model = wc.Model.build(cloths, obstacles, precision="float64", differentiable=True)
    simulation = wc.Simulation(model, "implicit_euler", substeps=2, forces=[Magnet(0.01), Other(0.02)])
    with pytest.raises(InputError, match=f"Force 'magnet' must not call a parameter '{name}', as another array"):
        Rollout(simulation, 1)


def test_single_precision_agrees_with_double():
    """Within a thousandth, as a median of several: where cloth buckles, rounding is what it happens to be."""
    wrong = [single_precision_errors(seed) for seed in range(5)]
    for name in wrong[0]:
        assert np.median([errors[name] for errors in wrong]) <= 1e-3, name


def single_precision_errors(seed: int) -> dict[str, float]:
    """Of each gradient, relative to its largest entry, for some weights of the positions at the end."""
    found = []
    for precision in ("float32", "float64"):
        cloth = wc.Cloth.grid((0.4, 0.4), (5, 5), wc.Fabric(stretch_stiffness=100.0, shear_stiffness=20.0), [wc.pin(0)])
        model = wc.Model.build([cloth], precision=precision, differentiable=True)
        rollout = Rollout(wc.Simulation(model, substeps=20), 3)
        rollout.forward()
        found.append(rollout.backward(np.random.default_rng(seed).normal(size=(25, 3))))
    exact = {name: gradient.numpy() for name, gradient in found[1].items()}
    return {name: np.abs(found[0][name].numpy() - exact[name]).max() / np.abs(exact[name]).max() for name in exact}


def test_worlds_have_gradients_of_their_own():
    cloths = [wc.Cloth.grid((0.2, 0.2), (3, 3), FABRIC, velocity=(0.1, 0.0, vz)) for vz in (0.0, 1.0)]
    worlds = [([cloth], [wc.Sphere((0.02, 0.03, -0.105), 0.1)]) for cloth in cloths]
    found = []
    for chosen in (worlds, worlds[:1], worlds[1:]):
        model = wc.Model.build_worlds(chosen, precision="float64", differentiable=True)
        rollout = Rollout(wc.Simulation(model, substeps=20, air=AIR), 2)
        rollout.forward()
        ones = np.ones((model.particle_count, 3))
        found.append({name: g.numpy().copy() for name, g in rollout.backward(ones, ones).items()})
    for name, both in found[0].items():
        alone = np.concatenate([found[1][name], found[2][name]])
        assert np.abs(both - alone).max() <= 1e-12 * np.abs(alone).max() + 1e-300, name


def test_what_has_no_gradients_says_so():
    cloth = wc.Cloth.grid((0.2, 0.2), (3, 3), FABRIC)
    plain = wc.Simulation(wc.Model.build([cloth], device="cpu"))
    model = wc.Model.build([cloth], precision="float64", differentiable=True)
    limited = wc.Cloth.grid((0.2, 0.2), (3, 3), wc.Fabric(strain_limit=0.01, limit_stiffness=100.0))
    meshes = [wc.MeshObstacle.from_mesh(trimesh.creation.box((1, 1, 0.1)))]
    grabbed = wc.Simulation(model)
    grabbed.grab(0)

    class Own(wc.UserForce):
        def accumulate(self, state: wc.State, time_offset: float) -> None:
            pass

    cases = [
        (wc.Simulation(model, forces=[Own()]), r"Force 'user' has no gradients, as it has no parameters\(\)"),
        (wc.Simulation(model, hooks=[wc.Hook()]), "Hooks have no gradients"),
        (plain, "differentiable=True"),
        (grabbed, "Force 'grab' has no gradients"),
        (wc.Simulation(model, "vbd"), "Integrator 'vbd' has no gradients; these have: forward_euler, "),
        (wc.Simulation(model, "dormand_prince"), "Integrator 'dormand_prince' has no gradients"),
        (wc.Simulation(model, contact="all"), "Contact among cloths has no gradients"),
        (wc.Simulation(wc.Model.build([limited], differentiable=True), "xpbd"), "Strain limits have no gradients"),
        (wc.Simulation(wc.Model.build([wc.Cloth.grid(transform=(0, 0, 1))], meshes, differentiable=True)), "MeshObst"),
    ]
    for simulation, sentence in cases:
        with pytest.raises(NotDifferentiableError, match=sentence):
            Rollout(simulation, 1)
