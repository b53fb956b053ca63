"""Laboratory tests of stretch, shear, weight and friction: what was put in comes out, whatever the mesh."""

import json
from itertools import combinations

import numpy as np
import pytest

from warpcloth.cli.main import run
from warpcloth.fabric import STANDARD_GRAVITY, Fabric
from warpcloth.fabric_library import library_fabric
from warpcloth.lab import Setup, bias, hang, incline, shear, tensile
from warpcloth.model import Model

SOFT = Fabric(stretch_stiffness=400.0, stretch_stiffness_weft=300.0, shear_stiffness=100.0, bend_stiffness=0.0)
MESHES = {"grid": {}, "angle": {"angle": 26.565}, "irregular": {"mesh": "irregular"}}


COARSE = [("grid", 4), ("grid", 5), ("grid", 6), ("irregular", 4), ("irregular", 6), ("angle", 6)]
FINE = [("grid", 8), ("grid", 16), ("grid", 24), ("irregular", 12), ("angle", 12)]


@pytest.mark.parametrize(("mesh", "cells"), COARSE + FINE)
def test_tensile_test_returns_the_stiffness_put_in(mesh, cells):
    setup = Setup(fabric=SOFT, resolution=cells, **MESHES[mesh])
    for fabric in (SOFT, tensile.turned(SOFT)):
        strain, load, settled = tensile.pulled(setup, fabric, 0.002)
        assert settled
        assert load / strain == pytest.approx(fabric.stretch_stiffness, rel=0.02)


@pytest.mark.parametrize(("mesh", "cells"), [("grid", 4), ("grid", 8), ("grid", 16), ("irregular", 8), ("angle", 8)])
def test_shear_test_returns_the_stiffness_put_in(mesh, cells):
    stress, settled = shear.sheared(Setup(fabric=SOFT, resolution=cells, **MESHES[mesh]), 0.5)
    assert settled
    assert stress / np.deg2rad(0.5) == pytest.approx(100.0, rel=0.02)


@pytest.mark.parametrize("integrator", ["symplectic_euler", "xpbd", "vbd"])
def test_the_scheme_does_not_change_the_stiffness(integrator):
    strain, load, settled = tensile.pulled(Setup(fabric=SOFT, integrator=integrator, resolution=8), SOFT, 0.002)
    assert settled
    assert load / strain == pytest.approx(SOFT.stretch_stiffness, rel=0.02)


def test_tensile_curve_turns_at_the_strain_limit():
    limited = Fabric(
        stretch_stiffness=400.0, shear_stiffness=20.0, strain_limit=0.01, limit_stiffness=2000.0, bend_stiffness=0.0
    )
    strain, load, _ = tensile.pulled(Setup(fabric=limited, resolution=12), limited, 0.02)
    assert strain > 0.015
    assert load == pytest.approx(tensile.load_at(limited, strain), rel=0.01)


@pytest.mark.parametrize("integrator", ["implicit_euler", "linear_implicit_euler"])
def test_strip_hangs_as_long_as_it_must(integrator):
    result = hang.run(Setup(fabric=library_fabric("denim"), integrator=integrator, resolution=20), str)
    assert result.passed
    assert len(result.checks) == 1


@pytest.mark.parametrize(("mesh", "cells"), [("grid", 4), ("grid", 5), ("grid", 6), ("grid", 9), ("irregular", 9)])
def test_a_hanging_strip_is_measured_where_the_table_says(mesh, cells):
    """Displacements on a grid are exact at its rows of vertices, so that they tell where they were taken."""
    fabric = library_fabric("cotton")
    rows = hang.run(Setup(fabric=fabric, resolution=cells, **MESHES[mesh]), str).rows
    places, moved, expected, settled = np.array(rows, float).T
    scale = 1e6 * fabric.areal_density * STANDARD_GRAVITY / fabric.stretch_stiffness
    assert settled.all()
    assert np.abs(places - (0.25, 0.5, 0.75, 1.0)).max() <= 0.5 / cells + 1e-9
    assert expected == pytest.approx(scale * (places - 0.5 * places**2), rel=1e-9)
    assert moved == pytest.approx(expected, rel=1e-3 if mesh == "grid" else 0.02)


@pytest.mark.parametrize("mesh", list(MESHES))
def test_incline_slides_and_sticks_as_coulomb_says(mesh):
    result = incline.run(Setup(fabric=library_fabric("wool"), **MESHES[mesh]), str)
    assert [check.what.split()[0] for check in result.checks] == ["creep", "distance", "distance"]
    assert result.passed


def test_incline_slides_the_mesh_that_it_reports(monkeypatch):
    built, build = [], Model.build

    def watched(cloth, *others, **options):
        built.append(cloth)
        return build(cloth, *others, **options)

    monkeypatch.setattr(Model, "build", watched)
    monkeypatch.setattr(incline, "FRAMES", 1)
    setups = [Setup(), Setup(angle=30.0), Setup(mesh="irregular"), Setup(mesh="irregular", seed=1)]
    for setup in setups:
        incline.slid(setup, 10.0)
    meshes = [{tuple(point) for point in cloth.points.round(6)} for cloth in built]
    assert all(a != b for a, b in combinations(meshes, 2))
    assert [cloth.area for cloth in built] == pytest.approx([incline.SIDE**2] * 4, rel=1e-3)
    assert [cloth.points[:, 2].min() for cloth in built] == pytest.approx([built[0].points[0, 2]] * 4)


def test_bias_extension_of_firm_yarns_is_that_of_a_trellis():
    angle, load, settled = bias.drawn(Setup(fabric=library_fabric("silk"), resolution=24), 0.05)
    assert settled
    assert load > 0.0
    assert angle == pytest.approx(bias.trellis_angle(0.05), rel=0.1)
    knit, _, _ = bias.drawn(Setup(fabric=library_fabric("ponte"), resolution=24), 0.05)
    assert knit < 0.8 * angle


@pytest.mark.parametrize("cells", [7, 10, 11, 16])
def test_bias_strips_of_any_mesh_are_compared_with_a_trellis_of_their_width(cells):
    """Diagonals of cells seldom make up a third of the length; and whatever they make up, all corners are clamped."""
    width = bias.strip_width(cells)
    points = bias.bias_strip(cells, library_fabric("cotton")).points
    assert np.ptp(points[:, 1]) == pytest.approx(width)
    corners = np.all(np.isclose(np.abs(points[:, :2]), [0.5 * bias.LENGTH, 0.5 * width]), axis=1)
    assert corners.sum() == 4
    angle, load, settled = bias.drawn(Setup(fabric=library_fabric("cotton"), resolution=cells), 0.05)
    assert settled
    assert angle == pytest.approx(bias.trellis_angle(0.05, width), rel=0.1)
    assert load == pytest.approx(15.4, rel=0.15)  # N/m, of fine meshes a third as wide as long


def test_bias_extension_reports_the_mesh_that_it_has(monkeypatch):
    """Always the grid along the yarns, so that the options for other meshes change nothing."""
    monkeypatch.setattr(bias, "EXTENSIONS", (0.05,))
    setups = (Setup(resolution=12), Setup(resolution=12, mesh="irregular", angle=30.0, seed=7))
    plain, other = (bias.run(setup, str) for setup in setups)
    assert plain.rows == other.rows
    assert plain.setup == other.setup
    assert (other.setup["mesh"], other.setup["angle"], other.setup["resolution"]) == ("grid", 45.0, 12)


def test_command_writes_a_table_and_a_picture(tmp_path, capsys):
    assert run(["lab", "shear", "--fabric", "twill", "--resolution", "6", "-o", str(tmp_path), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["passed"]
    assert report["values"]["shear_stiffness"] == pytest.approx(104.8, rel=0.02)
    assert (tmp_path / "shear.png").stat().st_size > 10_000
