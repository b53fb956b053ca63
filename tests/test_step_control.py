"""How adaptive methods measure the error of a step, and what size they make of it."""

import numpy as np
import pytest
from integrator_problems import oscillator, simulation

from warpcloth.integrators.step_control import StepControl
from warpcloth.integrators.tableau import BOGACKI_SHAMPINE, DORMAND_PRINCE, Tableau

PAIRS = {"bogacki_shampine": BOGACKI_SHAMPINE, "dormand_prince": DORMAND_PRINCE}
OMEGA, AMPLITUDE, SPEED = 5.0, 0.3, 1.0


def estimate(tableau: Tableau, h: float) -> tuple[np.ndarray, np.ndarray]:
    """(x, v) of the oscillator after a step, and by how much the two methods of the pair differ."""
    system, start = np.array([[0.0, 1.0], [-(OMEGA**2), 0.0]]), np.array([AMPLITUDE, SPEED])
    slopes = np.zeros((tableau.stages, 2))
    for i in range(tableau.stages):
        slopes[i] = system @ (start + h * tableau.matrix[i] @ slopes)
    return start + h * np.array(tableau.b) @ slopes, h * np.array(tableau.error) @ slopes


@pytest.mark.parametrize("which", ["position", "velocity"])
@pytest.mark.parametrize("relative", [0.0, 1.0])
@pytest.mark.parametrize("name", PAIRS)
def test_the_error_of_a_step_is_what_the_pair_differs_by_over_the_tolerance(name, relative, which):
    """Told from the size of the next step, h 0.9 e^(−0.7/order); relative to the way and to the speed, or not."""
    tableau, h, k = PAIRS[name], 0.1, ("position", "velocity").index(which)
    end, difference = estimate(tableau, h)
    scale = (abs(end[0] - AMPLITUDE), abs(end[1]))[k]
    wanted = abs(difference[k]) / 0.95  # so that the error is 0.95
    options = {
        "position_tolerance": 1e9,
        "velocity_tolerance": 1e9,
        "rtol": max(0.9 * relative * wanted / scale, 1e-12),
    }
    options[f"{which}_tolerance"] = wanted - 0.9 * relative * wanted
    sim = simulation(oscillator(OMEGA, 0.0, AMPLITUDE, SPEED), name, integrator_options=options)
    sim.step(h)
    assert sim.metrics()["accepted_steps"] == 1
    assert sim.metrics()["step_size"] == pytest.approx(h * 0.9 * 0.95 ** (-0.7 / tableau.order), rel=1e-6)


@pytest.mark.parametrize("order", [3, 5])
def test_steps_become_steady_at_an_error_below_the_tolerance(order):
    """Of an error e = h^order, where 0.9 e^(−0.3/order) is 1; a rejected step leads to one of error 0.9^order."""
    control, size = StepControl(order), 2.0
    assert not control.accepts(size**order)
    size *= control.factor(size**order)
    assert size == pytest.approx(0.9)
    assert control.factor(1e-6) == 1.0  # no growth right after that
    assert control.factor(0.0) == 5.0
    assert control.factor(1e30) == 0.1
    for _ in range(120):
        size *= control.factor(size**order)
    assert size**order == pytest.approx(0.9 ** (order / 0.3), rel=1e-6)
