"""Eight particles at once, against the kernels that take one: the same numbers, whatever is pinned or diverged."""

import numpy as np
import pytest
import warp as wp
from warpcloth.kernels import KernelSet

from warpcloth.launching import launch

COUNTS = [1, 7, 8, 21]
precisions = pytest.mark.parametrize("precision", ["float32", "float64"])
counts = pytest.mark.parametrize("count", COUNTS)


class Particles:
    """Arrays of random numbers; every third particle is pinned, and one is where nothing is finite."""

    def __init__(self, precision: str, count: int):
        self.kernels, self.count = KernelSet(precision), count
        self.real, self.vec3 = self.kernels.precision.real, self.kernels.precision.vec3
        self.rng = np.random.default_rng(count)
        inverse = np.where(np.arange(count) % 3 == 1, 0.0, self.rng.uniform(0.5, 2.0, count))
        self.inv_mass = wp.array(inverse, dtype=self.real, device="cpu")

    def vectors(self, rows: int = 0) -> wp.array:
        values = self.rng.normal(size=(rows, self.count, 3) if rows else (self.count, 3))
        values[..., min(4, self.count - 1), :] = np.nan
        return wp.array(values, dtype=self.vec3, device="cpu")

    def compare(self, module: str, kernel: str, inputs: list, outputs: list[wp.array]) -> None:
        """Both kernels leave the same in ``outputs``, whatever was there."""
        before, found = [output.numpy().copy() for output in outputs], []
        lanes = self.kernels.lanes.LANES
        for name, dim in ((module, self.count), ("particle_lanes", -(-self.count // lanes))):
            for output, values in zip(outputs, before, strict=True):
                output.assign(values)
            launch(getattr(getattr(self.kernels, name), kernel), dim, inputs, outputs, "cpu")
            found.append([output.numpy().copy() for output in outputs])
        assert any((one != old).any() for one, old in zip(found[0], before, strict=True))
        for one, eight in zip(*found, strict=True):
            np.testing.assert_allclose(eight, one, rtol=4 * np.finfo(one.dtype).eps, atol=1e-7, equal_nan=True)


@precisions
@counts
def test_gravity_of_each_world(precision, count):
    them = Particles(precision, count)
    world = wp.array(np.sort(them.rng.integers(0, 3, count)), dtype=wp.int32, device="cpu")
    gravity = wp.array(them.rng.normal(size=(3, 3)), dtype=them.vec3, device="cpu")
    them.compare("particles", "set_gravity_force", [them.inv_mass, world, gravity], [them.vectors()])


@precisions
@counts
@pytest.mark.parametrize("stages", [0, 3])
def test_advance(precision, count, stages):
    them = Particles(precision, count)
    weights = [them.kernels.explicit_step.weights(*them.rng.normal(size=8)) for _ in range(2)]
    vectors = [them.vectors() for _ in range(3)]
    inputs = [them.inv_mass, *vectors, them.vectors(max(stages, 1)), stages, 0.3, *weights]
    them.compare("explicit_step", "advance", inputs, [them.vectors(), them.vectors()])


@precisions
@counts
def test_start_and_end_of_position_based_steps(precision, count):
    them = Particles(precision, count)
    inputs = [them.inv_mass, *(them.vectors() for _ in range(4)), 0.5, 0.1]
    them.compare("position_step", "predict", inputs, [them.vectors() for _ in range(4)])
    inputs = [them.inv_mass, *(them.vectors() for _ in range(3)), 0.1]
    them.compare("position_step", "finish", inputs, [them.vectors() for _ in range(3)])


@precisions
@counts
def test_what_nobody_asks_for_is_left_out(precision, count):
    """Arrays of no length; of free particles what is there when a step begins does not matter."""
    them = Particles(precision, count)
    none, vectors = them.vectors()[:0], [them.vectors() for _ in range(3)]
    inputs = [them.inv_mass, *vectors, none, 0.5, 0.1]
    them.compare("position_step", "predict", inputs, [none, *(them.vectors() for _ in range(3))])
    them.compare("position_step", "finish", [them.inv_mass, vectors[0], none, vectors[1], 0.1], [none, *vectors[1:]])


def test_advance_in_place():
    them = Particles("float32", 21)
    weights = them.kernels.explicit_step.weights(0.5, *[0.0] * 7)
    q, qd, f, stage = them.vectors(), them.vectors(), them.vectors(), them.vectors(1)
    apart = [wp.zeros_like(q), wp.zeros_like(qd)]
    for outputs in (apart, [q, qd]):
        inputs = [them.inv_mass, q, qd, f, stage, 0, 0.3, weights, weights]
        launch(them.kernels.particle_lanes.advance, 3, inputs, outputs, "cpu")
    for one, other in zip(apart, (q, qd), strict=True):
        np.testing.assert_array_equal(one.numpy(), other.numpy())
