"""Every integrator converges to solutions found by other means, at the order it claims."""

import functools
import math
from itertools import pairwise

import numpy as np
import pytest
from integrator_problems import ALL, NAMES, PROBLEMS, phase, simulation

import warpcloth as wc
from warpcloth.integrators import INTEGRATORS
from warpcloth.integrators.tableau import BOGACKI_SHAMPINE, DORMAND_PRINCE, RK4, Tableau, rooted_trees

CONVERGENT = [cls.name for cls in ALL if cls.order > 0]
STEPS = {1: 256, 2: 64, 3: 32, 4: 32, 5: 64}  # where the leading term of the error rules, well above round-off

problem = functools.cache(lambda name: PROBLEMS[name]())


@pytest.mark.parametrize("name", CONVERGENT)
@pytest.mark.parametrize("task", PROBLEMS)
def test_order(task, name):
    """From two steps; for high orders from three, with the next term of the error extrapolated away."""
    order = INTEGRATORS[name].order
    levels = 2 if order < 3 else 3
    errors = [problem(task).error(name, 2**level * STEPS[order]) for level in range(levels)]
    orders = [math.log2(coarse / fine) for coarse, fine in pairwise(errors)]
    measured = orders[0] if levels == 2 else 2.0 * orders[1] - orders[0]
    assert measured == pytest.approx(order, abs=0.1)


ROWS = [
    (0.0, 0.5, (0.409091381, -0.927079959, -3.852925616, -1.728877758)),
    (0.5, 5.0, (0.972133967, -0.248863327, -0.514553791, -2.134610356)),
]


def pendulum_error(name: str, row: tuple, substeps: int) -> np.ndarray:
    k_d, end, expected = row
    model = wc.Model.from_springs(
        [[0, 0, 0], [1, 0, 0]], [1.0, 0.1], [[0, 1]], 1.0, 200.0, k_d, [0], precision="float64"
    )
    sim = simulation(model, name, (0, -9.81, 0), substeps)
    sim.step(end)
    return phase(sim)[:, 1, :2].ravel() - np.array(expected)


@pytest.mark.filterwarnings("ignore::warpcloth.errors.StabilityWarning")  # forward Euler grows here, as it must
@pytest.mark.parametrize("name", CONVERGENT)
def test_elastic_pendulum(name):
    """The known answers: the error is of size θ^order, θ = ω h of the spring, and falls as fast as it should."""
    order = INTEGRATORS[name].order
    per_second = {1: 768, 2: 640, 3: 128, 4: 80, 5: 64}[order]
    for row in ROWS if not INTEGRATORS[name].implicit and order > 1 else ROWS[:1]:
        coarse, fine = (np.linalg.norm(pendulum_error(name, row, n * int(row[1] * per_second))) for n in (1, 2))
        assert fine < 3.0 * (44.7 / (2.0 * per_second)) ** order
        assert math.log2(coarse / fine) > order - 0.6


def test_tableaux_prove_their_order():
    assert [len(rooted_trees(n)) for n in range(1, 6)] == [1, 1, 2, 4, 9]
    for tableau in (RK4, BOGACKI_SHAMPINE, DORMAND_PRINCE):
        with pytest.raises(ValueError, match="not of order"):
            Tableau(tableau.a, tableau.b, tableau.order + 1 if tableau.order < 5 else 6)
    with pytest.raises(ValueError, match="not of order 2"):
        Tableau(((), (1.0,)), (0.4, 0.6), 2)
    with pytest.raises(ValueError, match="rows of 0, 1, 2"):
        Tableau(((), (1.0, 0.0)), (0.5, 0.5), 2)
    with pytest.raises(ValueError, match="weights that sum to 1"):
        Tableau(RK4.a, RK4.b, 4, error=(0.1, 0.0, 0.0, 0.0))
    assert (BOGACKI_SHAMPINE.first_same_as_last, RK4.first_same_as_last) == (True, False)


def test_a_new_integrator_is_a_class_and_a_line(monkeypatch):
    class Dummy(INTEGRATORS["symplectic_euler"].__mro__[1]):
        """Drift, then kick."""

        name = "dummy"
        sequence = ((0.0, 1.0), (1.0, 0.0))
        order = 1
        reference = cost = use = "in this test only"

    stage = type(INTEGRATORS["symplectic_euler"].sequence[0])
    Dummy.sequence = tuple(stage(*row) for row in Dummy.sequence)
    monkeypatch.setitem(INTEGRATORS, Dummy.name, Dummy)
    info = wc.integrators()["dummy"]
    assert (info.order, info.symplectic, info.stability_limit) == (1, True, pytest.approx(2.0))
    coarse, fine = (problem("damped_spring").error("dummy", n) for n in (256, 512))
    assert math.log2(coarse / fine) == pytest.approx(1.0, abs=0.1)
    model = wc.Model.build(wc.Cloth.grid((0.2, 0.2), (4, 4)), precision="float64")
    sim = wc.Simulation(model, "dummy")
    sim.step(1.0 / 60.0)
    assert sim.substeps > 1
    assert "dummy" not in NAMES
