"""Every integrator converges to solutions found by other means, at the order it claims."""

import functools
import math
from itertools import pairwise

import numpy as np
import pytest
from integrator_problems import ALL, NAMES, PROBLEMS, phase, simulation
from scipy.integrate import solve_ivp

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


PENDULUM = {  # section 2 of the known answers: (k_d [N s], time [s]): x, y [m], v_x, v_y [m/s], to 9 decimals
    (0.0, 0.5): (0.409091381, -0.927079959, -3.852925616, -1.728877758),
    (0.0, 2.0): (0.760241003, -0.664284176, 2.326803297, 2.726887498),
    (0.5, 5.0): (0.972133967, -0.248863327, -0.514553791, -2.134610356),
}
LAST_DIGIT = 1e-9
OMEGA = math.sqrt(200.0 / 0.1)  # of the spring [1/s]
PER_SECOND = {1: 768, 2: 640, 3: 160, 4: 320, 5: 128}  # steps
PER_SECOND_IMPLICIT = {0: 512, 1: 512, 2: 384}


def pendulum_errors(name: str, per_second: int, **options) -> list[np.ndarray]:
    """In each row of :data:`PENDULUM`; all three swing side by side, one spring each."""
    dampings = [k_d for k_d, _ in PENDULUM]
    model = wc.Model.from_springs(
        [[0, 0, 0], [1, 0, 0]] * 3, [1.0, 0.1] * 3, [[0, 1], [2, 3], [4, 5]], 1.0, 200.0, dampings, [0, 2, 4],
        precision="float64",
    )  # fmt: skip
    sim = simulation(model, name, (0, -9.81, 0), per_second // 4, **options)
    errors = []
    for row, ((_, end), expected) in enumerate(PENDULUM.items()):
        sim.run(round(4 * (end - sim.time)), fps=4)
        errors.append(phase(sim)[:, 2 * row + 1, :2].ravel() - np.array(expected))
    return errors


@pytest.mark.filterwarnings("ignore::warpcloth.errors.StabilityWarning")  # forward Euler grows here, as it must
@pytest.mark.parametrize("name", CONVERGENT)
def test_elastic_pendulum(name):
    """Errors below 4 t θ^order, θ = ω h, of which two steps h and h/2 tell the leading term.

    Without it, less than 0.4 of the error at h/2 must be left. Were the true order one lower or higher, that would be
    more than half: |2^p − 2^q|/(2^p − 1) for order q instead of p.
    """
    order = INTEGRATORS[name].order
    steps = (PER_SECOND_IMPLICIT if INTEGRATORS[name].implicit else PER_SECOND)[order]
    for (_, end), coarse, fine in zip(
        PENDULUM, pendulum_errors(name, steps), pendulum_errors(name, 2 * steps), strict=True
    ):
        assert np.linalg.norm(fine) < 4.0 * end * (OMEGA / (2 * steps)) ** order + LAST_DIGIT
        rest = (2**order * fine - coarse) / (2**order - 1)
        assert np.linalg.norm(rest) < 0.4 * np.linalg.norm(fine) + LAST_DIGIT


@pytest.mark.parametrize("name", [cls.name for cls in ALL if cls.adaptive])
def test_elastic_pendulum_by_tolerance(name):
    """The error estimate is of the order of the method, so errors at the end are in proportion to the tolerance."""
    errors = []
    for tolerance in (1e-5, 1e-7):
        options = {"rtol": tolerance, "position_tolerance": tolerance, "velocity_tolerance": tolerance}
        found = pendulum_errors(name, 4, integrator_options=options)
        errors.append(np.linalg.norm(found, axis=1))
    assert (errors[1] < 1000.0 * 1e-7 * np.array([end for _, end in PENDULUM])).all()
    assert (errors[1] < errors[0] / 20.0).all()


@pytest.mark.parametrize("name", [cls.name for cls in ALL if cls.order == 0])
def test_elastic_pendulum_without_order(name):
    """The stiffness of PBD is made by its step, so small steps lead to another pendulum: a rigid one."""
    swing = solve_ivp(lambda t, y: [y[1], -9.81 * math.cos(y[0])], (0.0, 2.0), [0.0, 0.0], rtol=1e-10, atol=1e-12)
    place = np.array([math.cos(swing.y[0, -1]), math.sin(swing.y[0, -1])])
    expected = place - np.array(PENDULUM[0.0, 2.0][:2])
    assert np.linalg.norm(expected) > 0.05
    np.testing.assert_allclose(pendulum_errors(name, PER_SECOND_IMPLICIT[0])[1][:2], expected, atol=5e-3)


def test_tableaux_prove_their_order():
    assert [len(rooted_trees(n)) for n in range(1, 6)] == [1, 1, 2, 4, 9]
    for tableau in (RK4, BOGACKI_SHAMPINE, DORMAND_PRINCE):
        with pytest.raises(ValueError, match="not of order"):
            Tableau(tableau.a, tableau.b, tableau.order + 1 if tableau.order < 5 else 6)
    with pytest.raises(ValueError, match="not of order 2"):
        Tableau(((), (1.0,)), (0.4, 0.6), 2)
    with pytest.raises(ValueError, match="rows of 0, 1, 2"):
        Tableau(((), (1.0, 0.0)), (0.5, 0.5), 2)
    for pair in (BOGACKI_SHAMPINE, DORMAND_PRINCE):
        moved = np.zeros(pair.stages)  # from one weight of the embedded method to another: they still sum to 1
        moved[[0, -1]] = 1e-3, -1e-3
        with pytest.raises(ValueError, match=f"embedded method is not of order {pair.order - 1}"):
            Tableau(pair.a, pair.b, pair.order, error=tuple(pair.error + moved))


@pytest.mark.parametrize("pair", [BOGACKI_SHAMPINE, DORMAND_PRINCE])
def test_the_last_stage_of_embedded_pairs_is_the_first_of_the_next_step(pair):
    assert (*pair.a[-1], 0.0) == pair.b


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
