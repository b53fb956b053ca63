"""Attributes that a stage gives another type than they should have: one sentence, exit code 2, no file."""

import pytest
from pxr import Sdf, Usd, UsdPhysics
from shot_files import add_ball, add_cloth, new_stage, pin_points
from warpcloth.scenes.shots.opening import EARTH, gravity

from warpcloth.cli import run

TEXT, WORDS = Sdf.ValueTypeNames.String, Sdf.ValueTypeNames.StringArray
NUMBER, COLORS = Sdf.ValueTypeNames.Double, Sdf.ValueTypeNames.Color4fArray


def retype(stage: Usd.Stage, path: str, kind: Sdf.ValueTypeName) -> None:
    """What a careless writer does, and OpenUSD's own interface would not."""
    layer, where = stage.GetRootLayer(), Sdf.Path(path)
    if layer.GetAttributeAtPath(where):
        del layer.GetPrimAtPath(where.GetPrimPath()).properties[where.name]
    made = Sdf.AttributeSpec(layer.GetPrimAtPath(where.GetPrimPath()), where.name, kind)
    made.default = {NUMBER: 1.0, TEXT: "1", WORDS: ["1"], COLORS: [(1.0, 0.0, 0.0, 1.0)]}[kind]


def shot(folder) -> Usd.Stage:
    stage = new_stage(folder / "shot.usda")
    pin_points(add_cloth(stage), [0, 4])
    add_ball(stage)
    UsdPhysics.Scene.Define(stage, "/World/Physics")
    return stage


@pytest.mark.parametrize(
    ("path", "kind", "wanted"),
    [
        ("/World/Ball.radius", TEXT, "double"),
        ("/World/Ball.primvars:displayColor", COLORS, "color3f[]"),
        ("/World/Shirt.primvars:displayColor", NUMBER, "color3f[]"),
        ("/World/Shirt.holeIndices", TEXT, "int[]"),
        ("/World/Shirt.physics:thicknesses", NUMBER, "float[]"),
        ("/World/Shirt.physics:restShapePoints", NUMBER, "point3f[]"),
        ("/World/Shirt/pins.indices", WORDS, "int[]"),
        ("/World/Shirt/pins.warpcloth:motion:times", TEXT, "double[]"),
        ("/World/Physics.physics:gravityDirection", NUMBER, "vector3f"),
        ("/World/Physics.physics:gravityMagnitude", TEXT, "float"),
    ],
)
def test_a_value_of_another_type_is_one_sentence(tmp_path, capfd, path, kind, wanted):
    stage = shot(tmp_path)
    retype(stage, path, kind)
    stage.Save()
    capfd.readouterr()
    assert run(["simulate", str(tmp_path / "shot.usda"), "--device", "cpu", "-o", str(tmp_path / "out.usda")]) == 2
    said = " ".join(capfd.readouterr().err.split())
    assert said == f"warpcloth: Attribute {path} is of type {kind}, but must be of type {wanted}."
    assert [file.name for file in tmp_path.iterdir()] == ["shot.usda"]


def test_checks_and_players_say_the_same(tmp_path, capfd):
    stage = shot(tmp_path)
    stage.GetPrimAtPath("/World/Shirt").GetAttribute("points").Set([(0.0, 0.0, 0.0)] * 25, 1.0)
    retype(stage, "/World/Shirt.primvars:displayColor", NUMBER)
    stage.Save()
    capfd.readouterr()
    for command in (["check"], ["render", "-o", str(tmp_path / "out.png")]):
        assert run([command[0], str(tmp_path / "shot.usda"), *command[1:]]) == 2
        assert "/World/Shirt.primvars:displayColor is of type double" in capfd.readouterr().err


def test_precision_is_nobodys_fault(tmp_path):
    """Houdini and others write points and sizes in the precision that they have."""
    stage = shot(tmp_path)
    layer, kinds = stage.GetRootLayer(), Sdf.ValueTypeNames
    for path, kind in (("/World/Shirt.points", kinds.Double3Array), ("/World/Ball.radius", kinds.Float)):
        value = layer.GetAttributeAtPath(path).default
        prim = layer.GetPrimAtPath(Sdf.Path(path).GetPrimPath())
        del prim.properties[Sdf.Path(path).name]
        Sdf.AttributeSpec(prim, Sdf.Path(path).name, kind).default = value
    stage.SetEndTimeCode(1)
    stage.Save()
    assert run(["simulate", str(tmp_path / "shot.usda"), "--device", "cpu", "-o", str(tmp_path / "out.usda")]) == 0


def test_what_is_blocked_says_nothing(tmp_path):
    stage = shot(tmp_path)
    scene = UsdPhysics.Scene.Get(stage, "/World/Physics")
    for attribute in (scene.CreateGravityMagnitudeAttr(1.62), scene.CreateGravityDirectionAttr((1.0, 0.0, 0.0))):
        attribute.Block()
    assert gravity(scene) == [0.0, 0.0, -EARTH]
