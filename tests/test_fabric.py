"""Fabrics: checked values, warp and weft, the library and its sources, the command, names in scene files."""

import dataclasses
import json
from dataclasses import replace

import numpy as np
import pytest
from warpcloth.scenes.load import scene_from_toml

import warpcloth as wc
from warpcloth.cli.main import run
from warpcloth.cloth.sheet import sheet_tensor
from warpcloth.errors import FabricWarning, InputError, SceneError
from warpcloth.fabric import rigidity_of_length

GRID = '[[cloth]]\nshape = "grid"\n'


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"shear_stiffness": 401.0}, "shear_stiffness must be at most the stretch stiffness, 400 N/m, got 401"),
        ({"stretch_stiffness_weft": 50.0}, "shear_stiffness must be at most the stretch stiffness, 50 N/m, got 80"),
        ({"stretch_stiffness_weft": 0.0}, "stretch_stiffness_weft must be a number greater than 0, got 0"),
        ({"bending_rigidity": -1e-6}, "bending_rigidity must be a number of at least 0, got -1e-06"),
        ({"bending_rigidity_weft": float("nan")}, "bending_rigidity_weft must be a number of at least 0, got nan"),
        ({"bending_hysteresis": "much"}, "bending_hysteresis must be a number of at least 0, got 'much'"),
        ({"bending_rigidity": 1e-5, "bending_rigidity_weft": 0.0}, "both be 0 or both greater, got 1e-05 and 0 N m"),
        ({"twist_ratio": 0.0}, "twist_ratio must be a number greater than 0, got 0"),
        ({"air_drag": -1.0}, "air_drag must be a number of at least 0"),
        ({"strain_limit": -0.1}, "strain_limit must be a number of at least 0"),
        ({"areal_density": float("inf")}, "areal_density must be a number greater than 0, got inf"),
    ],
)
def test_nonsense_gets_one_sentence(values, sentence):
    with pytest.raises(InputError) as caught:
        wc.Fabric(**values)
    assert sentence in str(caught.value)
    assert str(caught.value).count(".\n") == 0


def test_the_weft_is_like_the_warp_unless_it_is_given():
    fabric = wc.Fabric(stretch_stiffness=500.0, bending_rigidity=2e-5)
    assert (fabric.stretch, fabric.bending) == ((500.0, 500.0), (2e-5, 2e-5))
    other = replace(fabric, stretch_stiffness=300.0, bending_rigidity_weft=1e-5)
    assert (other.stretch, other.bending) == ((300.0, 300.0), (2e-5, 1e-5))


def test_bending_length_and_rigidity_are_two_ways_to_say_one_thing():
    fabric = wc.Fabric(areal_density=0.15, bending_rigidity=rigidity_of_length(0.02, 0.15))
    assert fabric.bending_rigidity == pytest.approx(0.15 * 9.80665 * 8e-6, rel=1e-12)
    assert fabric.bending_length == pytest.approx((0.02, 0.02), rel=1e-12)


@pytest.mark.parametrize("shear", [0.0, 5.0, 60.0])
def test_sheet_tensor_has_both_young_moduli(shear):
    c_x, c_y = sheet_tensor((300.0, 70.0), shear)
    assert c_x - shear**2 / c_y == pytest.approx(300.0, rel=1e-12)
    assert c_y - shear**2 / c_x == pytest.approx(70.0, rel=1e-12)


def test_grid_of_an_anisotropic_fabric_has_its_moduli_along_warp_and_weft():
    fabric = wc.Fabric(stretch_stiffness=300.0, stretch_stiffness_weft=70.0, shear_stiffness=20.0, bend_stiffness=0.0)
    net = (cloth := wc.Cloth.grid((0.6, 0.4), (13, 9), fabric)).springs
    along = cloth.points[net.indices[:, 1], :2] - cloth.points[net.indices[:, 0], :2]
    along /= np.linalg.norm(along, axis=1)[:, None]
    tensor = np.einsum("s,si,sj,sk,sl->ijkl", net.stiffness * net.rest_lengths, along, along, along, along) / 0.24
    c_x, c_y = sheet_tensor((300.0, 70.0), 20.0)
    np.testing.assert_allclose(
        [tensor[0, 0, 0, 0], tensor[1, 1, 1, 1], tensor[0, 0, 1, 1], tensor[0, 1, 0, 1]], [c_x, c_y, 20.0, 20.0]
    )


def test_long_cells_cannot_shear_stiffly_and_say_so():
    with pytest.warns(FabricWarning, match=r"shear stiffness of 80 N/m, but springs on cells 4 times .* only give it"):
        wc.Cloth.grid((1.0, 0.25), (5, 5))


def test_every_value_of_the_library_has_a_source():
    for name, entry in wc.fabrics().items():
        given = {
            field.name
            for field in dataclasses.fields(wc.Fabric)
            if getattr(entry.fabric, field.name) != field.default and field.name not in ("name", "color")
        }
        assert given <= set(entry.sources), name
        assert all(len(source) > 10 for source in entry.sources.values())
        assert entry.description.endswith(".")
        wc.Cloth.grid((0.3, 0.2), (7, 5), entry.fabric)


def test_measured_fabrics_are_as_published():
    cotton, polyester = (wc.library_fabric(name) for name in ("cotton", "polyester"))
    assert (cotton.areal_density, cotton.thickness, cotton.bending_rigidity) == (0.1238, 0.497e-3, 11.57e-6)
    assert cotton.bending_hysteresis == pytest.approx(0.124 * 9.80665e-3, rel=1e-3)
    assert polyester.bending_hysteresis == pytest.approx(0.029 * 9.80665e-3, rel=1e-2)


def test_library_fabric_can_be_changed():
    assert wc.library_fabric("silk", friction=0.1).friction == 0.1
    for call, sentence in (
        (lambda: wc.library_fabric("slik"), "did you mean 'silk'?"),
        (lambda: wc.library_fabric("silk", frction=0.1), "A fabric has no 'frction' (did you mean 'friction'?)"),
    ):
        with pytest.raises(InputError) as caught:
            call()
        assert sentence in str(caught.value)


def test_scene_names_a_fabric_and_changes_it():
    by_name = scene_from_toml(GRID + 'fabric = "denim"')
    assert by_name.cloth[0].fabric.build() == wc.library_fabric("denim")
    changed = scene_from_toml(GRID + 'fabric = { name = "denim", friction = 0.2 }')
    assert changed.cloth[0].fabric.build() == wc.library_fabric("denim", friction=0.2)
    overridden = scene_from_toml(GRID + 'fabric = "denim"', overrides=["cloth.0.fabric.friction=0.2"])
    assert overridden.cloth[0].fabric == changed.cloth[0].fabric
    assert by_name.changed({"frames": 3}).cloth[0].fabric.build() == wc.library_fabric("denim")
    swapped = scene_from_toml(GRID + 'fabric = "denim"', overrides=["cloth.0.fabric=silk"])
    assert swapped.cloth[0].fabric.build().name == "silk"
    own = scene_from_toml(GRID + 'fabric = { name = "felt", areal_density = 0.3, bending_length = 0.03 }')
    assert own.cloth[0].fabric.build() == wc.Fabric(
        name="felt", areal_density=0.3, bending_rigidity=rigidity_of_length(0.03, 0.3)
    )


def test_a_fabric_of_ones_own_may_have_nearly_a_name_of_the_library():
    sheet = "areal_density = 0.3, stretch_stiffness = 900.0, shear_stiffness = 30.0"
    scene = scene_from_toml(GRID + f'fabric = {{ name = "denim2", {sheet}, bending_length = 0.03 }}')
    assert scene.cloth[0].fabric.build().stretch_stiffness == 900.0
    assert scene.changed({"frames": 3}).cloth == scene.cloth


@pytest.mark.parametrize(
    ("fabric", "sentence"),
    [
        ('"denin"', "cloth.0.fabric must be a table or the name of a fabric"),
        ('"denin"', "the name of a fabric (`warpcloth fabrics`), not 'denin'; did you mean 'denim'?"),
        ('{ name = "denin" }', "must have the name of a fabric, or areal_density, bending_rigidity, shear_stiffness"),
        ('{ name = "denin", friction = 0.3 }', "of its own, not 'denin'; did you mean 'denim'?"),
        ('{ name = "denin", stretch_stiffness = 2000.0 }', "of its own, not 'denin'; did you mean 'denim'?"),
        ('{ name = "velvet", friction = 0.3 }', "of its own, not 'velvet': cotton, polyester"),
        ("{ twist_ratio = -1 }", "cloth.0.fabric.twist_ratio must be a number above 0 and at most 10, not -1"),
        ("{ shear_stiffness = 500 }", "shear_stiffness must be at most the stretch stiffness, 400 N/m, got 500"),
        ("{ bending_length = 0.02, bending_rigidity = 1e-5 }", "a bending_length or a bending_rigidity, not both"),
        ("{ bending_hysteresis = -1 }", "cloth.0.fabric.bending_hysteresis must be a number from 0 to 10 N, not -1"),
    ],
)
def test_scene_refuses_nonsense_in_one_sentence(fabric, sentence):
    with pytest.raises(SceneError) as caught:
        scene_from_toml(GRID + f"fabric = {fabric}")
    assert sentence in str(caught.value)


def test_command_lists_fabrics_and_their_sources(capsys):
    assert run(["fabrics", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)["fabrics"]
    assert {row["name"] for row in listed} == set(wc.fabrics())
    assert all(set(row["sources"]) <= set(row["units"]) for row in listed)
    assert run(["fabrics", "denim"]) == 0
    assert "0.324" in capsys.readouterr().out
    assert run(["fabrics", "denin"]) == 2
    assert "did you mean 'denim'" in capsys.readouterr().err
