"""The laboratory: simulated specimens against closed forms, whatever the mesh and the scheme."""

import functools
import json

import numpy as np
import pytest

from warpcloth.cli.main import run
from warpcloth.fabric import Fabric
from warpcloth.fabric_library import library_fabric
from warpcloth.lab import TESTS, Setup, cantilever, cusick, lateral_buckling, settle
from warpcloth.lab.elastica import heavy_elastica
from warpcloth.lab.result import Check, Panel, Result
from warpcloth.lab.shadow import shadow_of
from warpcloth.lab.specimen import disc_ring, rectangle

ORIENTATIONS = {
    "along": {},
    "26.6": {"angle": 26.565},
    "45": {"angle": 45.0},
    "irregular": {"mesh": "irregular"},
}
ELASTICA = {  # x/L, y/L, H/W by scipy's boundary value solver
    0.5: (0.997779, 0.062306, 0.062444),
    10.0: (0.656354, 0.700200, 1.066802),
    100.0: (0.159223, 0.937524, 5.888105),
}


def error(gamma: float, cells: int, orientation: str) -> float:
    """Distance of the tip from where it should be, over the length of the strip; hardly any of it from stretch."""
    setup = Setup(resolution=cells, **ORIENTATIONS[orientation])
    measured, (x, y, _) = cantilever.bent_strip(setup, gamma, 1e4), ELASTICA[gamma]
    return float(np.hypot(measured.reach - x, measured.drop - y))


@functools.cache
def strip(gamma: float, cells: int, orientation: str = "along", integrator: str = "implicit_euler") -> cantilever.Strip:
    return cantilever.bent_strip(Setup(integrator=integrator, resolution=cells, **ORIENTATIONS[orientation]), gamma)


def test_elastica_is_the_tabulated_one():
    for shape, (x, y, ratio) in zip(heavy_elastica(list(ELASTICA)), ELASTICA.values(), strict=True):
        assert shape.x[-1] == pytest.approx(x, abs=1e-6)
        assert shape.y[-1] == pytest.approx(y, abs=1e-6)
        assert shape.drop == pytest.approx(ratio, rel=1e-5)


CASES = [(0.5, 32, name) for name in ORIENTATIONS] + [(100.0, 32, "along"), (10.0, 16, "26.6"), (10.0, 16, "45")]


@pytest.mark.parametrize(("gamma", "cells", "orientation"), [*CASES, (100.0, 32, "irregular")])
def test_cantilever_follows_the_elastica(gamma, cells, orientation):
    """Within 1 %; the tip's place over the length of the strip."""
    measured, (x, y, ratio) = strip(gamma, cells, orientation), ELASTICA[gamma]
    assert measured.settled
    assert measured.drop / measured.reach == pytest.approx(ratio, rel=0.01)
    assert np.hypot(measured.reach - x, measured.drop - y) < 0.01


@pytest.mark.parametrize("orientation", ["along", "irregular"])
def test_cantilever_converges_with_second_order(orientation):
    coarse, fine = (error(10.0, cells, orientation) for cells in (8, 16))
    assert 1.7 < np.log2(coarse / fine) < 2.8


def test_rigidity_of_the_standard_is_the_one_put_in():
    setup = Setup(resolution=16)
    assert cantilever.measured_rigidity(setup) == pytest.approx(setup.fabric.bending[0], rel=0.02)


def test_lateral_buckling_at_the_known_length(monkeypatch):
    """Within 5 %: twist has its stiffness. A strip one cell wide, as the closed form is for narrow ones."""
    monkeypatch.setattr(lateral_buckling, "WIDTH", 1)
    gammas, setup = (15.0, 17.0), Setup(resolution=16)
    found = lateral_buckling.extrapolated(gammas, [lateral_buckling.resistance(setup, gamma) for gamma in gammas])
    assert found == pytest.approx(18.178, rel=0.05)


SCHEMES = ["symplectic_euler", "rk4", "bdf2", "implicit_midpoint", "linear_implicit_euler", "xpbd", "vbd"]


@pytest.mark.parametrize("integrator", SCHEMES)
def test_the_scheme_does_not_change_the_rest_shape(integrator):
    """To what is left of the forces, 1e-5 of the weight, and to the standstill that ends it."""
    implicit, other = strip(10.0, 8), strip(10.0, 8, integrator=integrator)
    assert other.settled
    assert np.hypot(other.reach - implicit.reach, other.drop - implicit.drop) < 1e-5


@pytest.mark.parametrize("integrator", ["implicit_euler", "symplectic_euler", "xpbd"])
def test_steps_and_substeps_do_not_change_the_rest_shape(integrator, monkeypatch):
    usual = strip(10.0, 8, integrator=integrator)
    for name in ("LONG_STEP", "SHORT_STEP", "RESOLVED"):
        monkeypatch.setattr(settle, name, 0.4 * getattr(settle, name))
    other = cantilever.bent_strip(Setup(integrator=integrator, resolution=8), 10.0)
    assert other.settled
    assert np.hypot(other.reach - usual.reach, other.drop - usual.drop) < 1e-5


def test_shadow_of_a_wavy_disc():
    """Area, outline and folds of a flat fan of triangles with five waves; a level specimen has all of its ring."""
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    radius = 0.12 + 0.01 * np.cos(5.0 * angle)
    rim = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0.0 * angle])
    number = np.arange(400)
    fan = np.column_stack([np.full(400, 400), number, np.roll(number, -1)])
    shadow = shadow_of(np.vstack([rim, np.zeros(3)]), fan, 0.09)
    assert shadow.area == pytest.approx(np.pi * (0.12**2 + 0.5 * 0.01**2), rel=2e-3)
    assert shadow.folds == 5
    assert shadow.radius.max() == pytest.approx(0.13, abs=5e-4)
    cloth = disc_ring(0.09, 0.15, 8, Setup(), Fabric())
    level = cusick.Drape(cloth.points, cloth.triangles, shadow_of(cloth.points, cloth.triangles, 0.09), True)
    assert level.coefficient == pytest.approx(100.0, abs=0.5)
    assert level.shadow.folds == 0


@pytest.mark.parametrize("fabric", list(cusick.MEASURED))
def test_drape_of_real_fabrics_is_predicted(fabric):
    """Within 10 points and two folds of what was measured, from the fabric's properties alone; on a coarse mesh."""
    (coefficient, folds), setup = cusick.MEASURED[fabric], Setup(fabric=library_fabric(fabric), resolution=5)
    drape = cusick.draped(setup, 0)
    assert drape.settled
    assert drape.coefficient == pytest.approx(coefficient, abs=10.0)
    assert abs(drape.shadow.folds - folds) <= 2


@pytest.fixture(scope="module")
def cotton_drape() -> cusick.Drape:
    return cusick.draped(Setup(fabric=library_fabric("cotton"), resolution=5), 0)


@pytest.mark.parametrize(("integrator", "step"), [("bdf2", 0.02), ("xpbd", 0.02), ("implicit_euler", 0.01)])
def test_drape_does_not_depend_on_scheme_or_step(cotton_drape, integrator, step, monkeypatch):
    """With friction in bending, which remembers every swing."""
    monkeypatch.setattr(cusick, "STEP", step)
    monkeypatch.setattr(cusick, "RELEASE", round(2.0 / step))
    drape = cusick.draped(Setup(fabric=library_fabric("cotton"), resolution=5, integrator=integrator), 0)
    assert drape.settled
    assert drape.coefficient == pytest.approx(cotton_drape.coefficient, abs=1.0)
    assert drape.shadow.folds == cotton_drape.shadow.folds


@pytest.mark.parametrize("options", [{"angle": 30.0}, {"mesh": "irregular"}])
def test_specimens_fill_their_rectangle(options):
    cloth = rectangle((-0.1, 0.0), (0.4, 0.1), 0.02, Setup(**options), Fabric())
    assert cloth.area == pytest.approx(0.05, rel=1e-3)
    assert cloth.points[:, :2].min(axis=0) == pytest.approx([-0.1, 0.0], abs=1e-9)
    assert len(cloth.triangles) == pytest.approx(2 * 25 * 5, rel=0.2)


def test_command(tmp_path, capsys, monkeypatch):
    """A table for people, JSON for programs, files in the folder; the page has all tests."""

    def quick(setup: Setup, progress) -> Result:
        progress("half")
        checks = [Check("two", 2.0, 2.0, 0.1), Check("three", 2.0, 3.0, 0.1, absolute=True)]
        summary, panels = setup.summary(), [Panel("x", "y", [])]
        return Result("quick", "Quick test", "Looks.", summary, ("a", "b"), [(1.0, 2)], {}, checks, panels)

    monkeypatch.setattr(cantilever, "run", quick)
    for name in list(TESTS):
        monkeypatch.setattr(TESTS[name], "run", quick)
    assert run(["lab", "cantilever", "-o", str(tmp_path), "--json"]) == 3  # a check fails
    found = json.loads(capsys.readouterr().out)
    assert [check["passed"] for check in found["checks"]] == [True, False]
    assert found["rows"] == [{"a": 1.0, "b": 2}]
    assert (tmp_path / "quick.png").stat().st_size > 1000
    assert run(["lab", "report", "-o", str(tmp_path), "--no-plots"]) == 3
    page = (tmp_path / "report.md").read_text()
    assert "## Quick test" in page
    assert "out of tolerance" in page
    assert run(["lab", "nothing", "-o", str(tmp_path)]) == 2
    assert run(["lab", "cantilever", "--mesh", "knitted"]) == 2
