"""A small simulation of all forces, a loss of its roll-out, its gradients, and central finite differences of it."""

import numpy as np

import warpcloth as wc
from warpcloth.gradients import Rollout

FABRIC = wc.Fabric(
    stretch_stiffness=100.0, shear_stiffness=20.0, bending_rigidity=2e-5, bending_hysteresis=1e-4, damping_time=2e-3
)
AIR = wc.Air(wind=(1.0, 2.0, 0.5), gust=0.2, turbulence=0.3)
RELATIVE = 1e-4  # what gradients must agree with differences to
STEP = 1e-6  # of the differences, in units of the parameters' sizes


def crumpled(integrator: str, substeps: int, *, differentiable: bool = True, **options) -> wc.Simulation:
    """A small cloth of all forces, one corner held, one led, in wind; not flat, so that every force is at work."""
    lead = wc.Motion.keyframes([(0.0, (0, 0, 0)), (1.0, (0.3, 0.0, 0.2))])
    pins = [wc.pin(0), wc.pin(4, lead)]
    cloth = wc.Cloth.grid((0.4, 0.4), (5, 5), FABRIC, pins, (0, 0, 1), velocity=(0.3, 0.1, 0.0))
    model = wc.Model.build([cloth], precision="float64", differentiable=differentiable)
    simulation = wc.Simulation(model, integrator, substeps=substeps, air=AIR, **options)
    free = model.particle_inv_mass.numpy() > 0.0
    noise = 0.01 * np.random.default_rng(0).normal(size=(25, 3)) * free[:, None]
    simulation.state.particle_q.assign(simulation.state.particle_q.numpy() + noise)
    return simulation


class RandomLoss:
    """A fixed random linear function of the positions and velocities of all observed states."""

    def __init__(self, rollout: Rollout, seed: int = 0):
        self.rollout = rollout
        shape = (len(rollout.states), 2, rollout.model.particle_count, 3)
        self.weights = np.random.default_rng(seed).normal(size=shape) * np.array([1.0, 0.1]).reshape(1, 2, 1, 1)

    def value(self) -> float:
        """After a new roll-out."""
        states = self.rollout.forward()
        pairs = zip(self.weights, states, strict=True)
        return sum((w[0] * s.particle_q.numpy()).sum() + (w[1] * s.particle_qd.numpy()).sum() for w, s in pairs)

    def gradients(self) -> dict[str, np.ndarray]:
        """Of the latest roll-out."""
        for w, state in zip(self.weights, self.rollout.states, strict=True):
            state.particle_q.grad.assign(w[0])
            state.particle_qd.grad.assign(w[1])
        return {name: array.numpy().copy() for name, array in self.rollout.backward().items()}


def arrays_of(rollout: Rollout) -> dict:
    """Everything that there are gradients for, by name."""
    return {
        "particle_q": rollout.start.particle_q,
        "particle_qd": rollout.start.particle_qd,
        **rollout.parameters,
    }


def random_direction(name: str, values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A direction of the size of the values; zeros of what must not be negative stay."""
    noise = rng.normal(size=values.shape)
    if name == "particle_q":
        return 0.01 * noise
    if name in ("particle_qd", "gravity", "wind"):
        return noise
    return noise * np.abs(values)


def slopes(
    loss: RandomLoss, names: list[str], gradients: dict[str, np.ndarray], h: float = STEP
) -> tuple[float, float]:
    """Derivative of the loss along a random direction in the arrays named, by gradients and by central differences."""
    rng = np.random.default_rng(1)
    arrays = arrays_of(loss.rollout)
    middle = {name: arrays[name].numpy().copy() for name in names}
    along = {name: random_direction(name, values, rng) for name, values in middle.items()}
    found = []
    for sign in (1.0, -1.0):
        for name in names:
            arrays[name].assign(middle[name] + sign * h * along[name])
        found.append(loss.value())
    for name in names:
        arrays[name].assign(middle[name])
    slope = sum(float((gradients[name] * along[name]).sum()) for name in names)
    return slope, (found[0] - found[1]) / (2.0 * h)


def assert_slopes_agree(
    loss: RandomLoss, *, together: bool = False, h: float = STEP, zero: tuple[str, ...] = ()
) -> None:
    """Gradients equal differences to ``RELATIVE``, for each array or for all together; none is 0 but those named."""
    loss.value()
    gradients = loss.gradients()
    names = [name for name in gradients if name not in zero]
    for group in [names] if together else [[name] for name in names]:
        slope, difference = slopes(loss, group, gradients, h)
        assert abs(difference) > 1e-7, group
        assert abs(slope - difference) <= RELATIVE * abs(difference), (group, slope, difference)
