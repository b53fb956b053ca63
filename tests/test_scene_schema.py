"""Scene files: what a valid one becomes, and what an invalid one is told."""

import re
from pathlib import Path

import numpy as np
import pytest
import warpcloth.scenes
from warpcloth.scenes import Scene, bundled_scenes, load_scene, scene_from_toml
from warpcloth.scenes.reference import field_tables, refreshed
from warpcloth.scenes.schema.fabric import FabricTable

from warpcloth import errors, obstacles
from warpcloth.cloth import Cloth

GRID = '[[cloth]]\nshape = "grid"\n'
SPHERE = '[[obstacle]]\nshape = "sphere"\n'
README = Path(warpcloth.scenes.__file__).parent / "README.md"

# What is wrong in the file → what the sentence must be.
MISTAKES = [
    ("", "the scene must have a [[cloth]], a [network] or a [stage] to simulate"),
    (GRID + 'sise = [1, 1]', "the key 'cloth.0.sise' is unknown; did you mean 'size'?"),
    ("frame = 1\nfsp = 2\n" + GRID, "the key 'frame' is unknown; did you mean 'frames'? (and 1 more problem)"),
    (GRID + 'fabric = { density = 1 }', "the key 'cloth.0.fabric.density' is unknown; did you mean 'areal_density'?"),
    ("frames = 1.5\n" + GRID, "frames must be a whole number from 1 to 1,000,000, not 1.5"),
    ("frames = true\n" + GRID, "frames must be a whole number from 1 to 1,000,000, not true"),
    ("fps = nan\n" + GRID, "fps must be a number from 0.001 to 100,000 1/s, not nan"),
    (GRID + "size = [1]", "cloth.0.size must be 2 numbers [width, height], each above 0 and at most 10,000 m, not [1]"),
    (
        GRID + "resolution = [3000, 3000]",
        "cloth.0 must have a resolution of at most 4,000,000 vertices, and 3000 by 3000 are 9,000,000",
    ),
    ("[[cloth]]", "the key 'cloth.0.shape' is missing; choose 'grid', 'disc' or 'mesh'"),
    ('[[cloth]]\nshape = "gird"', "cloth.0.shape must be 'grid', 'disc' or 'mesh', not 'gird'; did you mean 'grid'?"),
    ('[cloth]\nshape = "grid"', "cloth must be a list, not a table; write [[cloth]] above it"),
    (GRID + SPHERE + "radius = 1", "the key 'obstacle.0.center' is missing"),
    (
        GRID + 'pins = [{ edge = "lef" }]',
        "cloth.0.pins.0.edge must be 'left', 'right', 'bottom' or 'top', not 'lef'; did you mean 'left'?",
    ),
    (
        GRID + "pins = [{}]",
        "cloth.0.pins.0 must have exactly one of 'edge', 'corner', 'indices', 'box' or 'nearest', and has none",
    ),
    (
        GRID + 'pins = [{ edge = "top", indices = [1] }]',
        "cloth.0.pins.0 must have exactly one of 'edge', 'corner', 'indices', 'box' or 'nearest', "
        "not 'edge' and 'indices'",
    ),
    (
        GRID + SPHERE + "center = [0, 0, 0]\nradius = 1\nmotion.keys = [{ time = 1 }, { time = 0 }]",
        "obstacle.0.motion must have keyframes in order of time, but keys.1 does not come after the one before",
    ),
    (
        GRID + 'name = "a"\n' + GRID + 'name = "a"',
        "the scene must give every cloth and obstacle its own name, but 'a' occurs twice",
    ),
    (
        "[network]\npositions = [[0, 0, 0], [1, 0, 0]]\nmasses = 1\nsprings = [[0, 2]]\nk_s = 1",
        "network must join two different particles from 0 to 1 by springs.0",
    ),
    (
        "[network]\npositions = [[0, 0, 0], [1, 0, 0]]\nmasses = [1]\nsprings = [[0, 1]]\nk_s = 1",
        "network must have one of masses for each particle: 2, not 1",
    ),
    (
        GRID + "[network]\npositions = [[0, 0, 0], [1, 0, 0]]\nmasses = 1\nsprings = [[0, 1]]\nk_s = 1",
        "the scene must not have [[cloth]] beside a [network], which is simulated alone",
    ),
    (
        GRID + "fabric = { strain_limit = 0.05 }",
        "cloth.0.fabric must have a strain_limit and a limit_stiffness, or neither, as one alone does nothing",
    ),
    (
        GRID + '[[obstacle]]\nshape = "lathe"\noutline = [[0, 0], [1, 1], [1, 0], [0, 1]]',
        "obstacle.0.outline must not cross itself, but its sides from items 0 and 2 do",
    ),
    (
        "[air]\nwind = [1, 0, 0]\n"
        "[network]\npositions = [[0, 0, 0], [1, 0, 0]]\nmasses = 1\nsprings = [[0, 1]]\nk_s = 1",
        "the scene must not have wind beside a [network], which has no surface that air could push",
    ),
    (
        GRID + 'name = "a b"',
        "cloth.0.name must be a name of letters, digits and _ that does not start with a digit, not 'a b'",
    ),
    ("frames = 1\nfps = ?\n", "this is not TOML: Invalid value (at line 2, column 7)"),
    ("frames = 1\nfps =", "this is not TOML: Invalid value (at line 2, the end)"),
    ("x = " + "[" * 100_000, "this is not a scene: its lists or tables are nested too deeply"),
    ("frames = " + "9" * 5000, "this is not a scene: it has a number of thousands of digits"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "sentence"), MISTAKES, ids=[sentence[:40] for _, sentence in MISTAKES])
def test_a_mistake_is_answered_by_one_sentence(text, sentence):
    with pytest.raises(errors.SceneError) as caught:
        scene_from_toml(text, source="s.toml")
    assert str(caught.value) == f"s.toml: {sentence}"


def test_readme_is_up_to_date():
    text = README.read_text(encoding="utf-8")
    assert text == refreshed(text), "run python -m warpcloth.scenes.reference scenes/README.md"


def test_readme_example_is_a_scene():
    example = README.read_text(encoding="utf-8").split("```toml\n")[1].split("```")[0]
    cloths, solids = scene_from_toml(example).build()
    assert len(cloths[0].points) == 41 * 41
    assert solids[0].radius == 0.2


@pytest.mark.parametrize("name", bundled_scenes())
def test_bundled_scenes_build(name):
    scene = load_scene(name)
    cloths, _ = scene.build()
    assert scene.title
    assert scene.description
    assert len(cloths) == len(scene.cloth) or scene.network is not None


def test_values_reach_the_simulator():
    cloths, solids = scene_from_toml(
        """
        [[cloth]]
        name = "flag"
        shape = "grid"
        size = [2, 1]
        resolution = [3, 5]
        position = [1.0, 2.0, 3.0]
        rotation = [90.0, 0.0, 0.0]
        velocity = [0, 0, -2]
        fabric = { areal_density = 0.5, shear_stiffness = 0 }
        pins = [{ edge = "left", motion.keys = [{ time = 0 }, { time = 2, rotation = [0, 0, 180] }] }]

        [[obstacle]]
        shape = "box"
        center = [0, 0, -1]
        size = [1, 2, 3]
        rotation = [0, 0, 45]
        friction = 0.25
        """
    ).build()
    flag, box = cloths[0], solids[0]
    assert isinstance(flag, Cloth)
    assert (flag.name, flag.fabric.areal_density) == ("flag", 0.5)
    assert flag.masses.sum() == pytest.approx(0.5 * 2.0)
    # Turned by 90° about x, the grid's height along y points up.
    np.testing.assert_allclose(flag.points.min(axis=0), [0.0, 2.0, 2.5], atol=1e-12)
    np.testing.assert_allclose(flag.points.max(axis=0), [2.0, 2.0, 3.5], atol=1e-12)
    np.testing.assert_array_equal(flag.velocity, [0, 0, -2])
    assert len(flag.pins[0].indices) == 5
    np.testing.assert_allclose(flag.pins[0].motion.pose(2.0)[1], np.diag([-1.0, -1.0, 1.0]), atol=1e-12)
    assert isinstance(box, obstacles.Box)
    assert (box.name, box.friction) == ("box", 0.25)
    np.testing.assert_allclose(box.rotation, [0, 0, np.pi / 4])


def test_every_kind_of_pin_finds_its_vertices():
    pins = """[
        { corner = "bottom_left" }, { indices = [1] }, { nearest = [[0.5, 0.5, 0.0]] },
        { box = { lower = [-1, 0.4, -1], upper = [-0.4, 1, 1] } },
    ]"""
    cloth = scene_from_toml(f"{GRID}resolution = [3, 3]\npins = {pins}").build()[0][0]
    held = np.unique(np.concatenate([pin.indices for pin in cloth.pins]))
    np.testing.assert_array_equal(held, [0, 1, 6, 8])


def test_names_are_made_up_where_none_are_given():
    scene = scene_from_toml(GRID + GRID + 'name = "cloth_2"\n' + GRID + '[[obstacle]]\nshape = "plane"\n' * 2)
    assert scene.cloth_names == ["cloth", "cloth_2", "cloth_3"]
    assert scene.obstacle_names == ["plane", "plane_2"]


def test_jitter_follows_the_seed_and_spares_the_pins():
    text = GRID + 'resolution = [9, 9]\njitter = 0.001\npins = [{ edge = "top" }]'
    flat = scene_from_toml(text, overrides=["cloth.0.jitter=0"]).build()[0][0]
    first, again, other = (scene_from_toml(f"seed = {n}\n{text}").build()[0][0] for n in (1, 1, 2))
    np.testing.assert_array_equal(first.points, again.points)
    assert not np.array_equal(first.points, other.points)
    offset = first.points - flat.points
    assert np.all(offset[first.pins[0].indices] == 0.0)
    # 216 draws of a normal variable: their standard deviation is within 5 standard errors of the asked one.
    assert np.std(offset[offset != 0.0]) == pytest.approx(1e-3, rel=5 / np.sqrt(2 * 216))
    np.testing.assert_array_equal(first.springs.rest_lengths, flat.springs.rest_lengths)


def test_mesh_paths_start_from_the_scene_file(tmp_path):
    (tmp_path / "tri.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n")
    (tmp_path / "s.toml").write_text('[[cloth]]\nshape = "mesh"\npath = "tri.obj"\nscale = 2\n')
    cloth = load_scene(tmp_path / "s.toml").build()[0][0]
    np.testing.assert_allclose(np.ptp(cloth.points, axis=0), [2, 2, 0])


def test_errors_while_building_name_the_table():
    scene = scene_from_toml(GRID + "pins = [{ indices = [5000] }]")
    with pytest.raises(errors.InputError, match=r"^cloth\.0: .*vertex 5000"):
        scene.build()


def test_overrides_by_number_and_by_name():
    scene = load_scene(
        "two_cloths",
        [
            "cloth.0.fabric.areal_density=0.25",
            "cloth.silk.size=[2, 3]",
            "obstacle.left_stand.motion.keys=[{time=0}]",
            "simulation.precision=float64",
            "cloth.1.resolution.0 = 9",
        ],
    )
    assert scene.cloth[0].fabric.areal_density == 0.25
    assert scene.cloth[1].size == (2.0, 3.0)
    assert scene.obstacle[0].motion.keys[0].time == 0.0
    assert scene.simulation.precision == "float64"
    assert scene.cloth[1].resolution == (9, 45)


def test_overrides_of_single_numbers_in_lists_that_the_file_leaves_to_their_defaults():
    overrides = ["air.wind.1=4", "simulation.gravity.2 = -1.6", "cloth.0.velocity.0=1", "cloth.0.velocity.2=-2"]
    scene = scene_from_toml(GRID, overrides=overrides)
    assert (scene.air.wind, scene.simulation.gravity) == ((0.0, 4.0, 0.0), (0.0, 0.0, -1.6))
    assert scene.cloth[0].velocity == (1.0, 0.0, -2.0)
    with pytest.raises(errors.SceneError, match=r"'air\.wind' is a list of 3, counted from 0, so it has no 3"):
        scene_from_toml(GRID, overrides=["air.wind.3=4"])
    with pytest.raises(errors.SceneError, match="'obstacle' is a list of 0, counted from 0, so it has no 0"):
        scene_from_toml(GRID, overrides=["obstacle.0.shape=sphere"])


@pytest.mark.parametrize("fabric", ["denim", "plain"])
def test_an_override_of_one_number_of_a_color_leaves_the_fabrics_others(fabric):
    name = [] if fabric == "plain" else [f"cloth.0.fabric={fabric}"]
    color = scene_from_toml(GRID, overrides=name).cloth[0].fabric.build().color
    changed = scene_from_toml(GRID, overrides=[*name, "cloth.0.fabric.color.1=0.125"]).cloth[0].fabric.build()
    assert changed.color == (color[0], 0.125, color[2])


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("frames", "'frames' is not of the form path=value"),
        ("cloth.3.size=[1, 1]", "'cloth' is a list of 2, counted from 0, so it has no 3"),
        ("cloth.denm.size=[1, 1]", "'cloth' is a list and has no item 'denm'; did you mean 'denim'?"),
        ("frames.x=1", "'frames' is a single value and has no 'x' in it"),
        ("frames=1\nfps=2", "the value '1\\nfps=2' of 'frames' is not TOML"),
        ("cloth.silk.sise=[1, 1]", "the key 'cloth.1.sise' is unknown; did you mean 'size'?"),
        ("cloth.0.fabric.friction=-1", "cloth.0.fabric.friction must be a number from 0 to 10, not -1"),
    ],
)
def test_wrong_overrides_are_explained(override, sentence):
    with pytest.raises(errors.SceneError) as caught:
        load_scene("two_cloths", [override])
    assert sentence in str(caught.value)


def test_changed_scenes_are_validated_and_keep_their_place():
    scene = load_scene("hanging")
    shorter = scene.changed({"frames": 3, "simulation.substeps": 7})
    assert (shorter.frames, shorter.simulation.substeps) == (3, 7)
    assert (shorter.name, shorter.folder) == (scene.name, scene.folder)
    assert shorter.cloth == scene.cloth
    with pytest.raises(errors.SceneError, match=r"^simulation.substeps must be \"auto\" or a whole number"):
        scene.changed({"simulation.substeps": "many"})


def test_changes_take_the_paths_that_set_takes():
    scene = load_scene("hanging").changed({"cloth.0.size": [2, 3], "cloth.cloth.fabric.friction": 0.2})
    assert (scene.cloth[0].size, scene.cloth[0].fabric.friction) == ((2.0, 3.0), 0.2)
    for values, sentence in [
        ({"simulation.substeps.x": 3}, "'simulation.substeps' is a single value and has no 'x' in it"),
        ({"cloth.9.size": 3}, "'cloth' is a list of 1, counted from 0, so it has no 9"),
        ({"simulation.substep": 3}, "the key 'simulation.substep' is unknown; did you mean 'substeps'?"),
        ({3: 3}, 'Values must be a dict such as {"frames": 10}, got {3: 3}.'),
        (5, 'Values must be a dict such as {"frames": 10}, got 5.'),
    ]:
        with pytest.raises(errors.InputError) as caught:
            scene.changed(values)
        assert str(caught.value) == sentence


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("hangin", "there is no scene 'hangin'; did you mean 'hanging'?"),
        ("nowhere.toml", "there is no scene file 'nowhere.toml'"),
        (".", "'.' is not a scene"),
        ("", "there is no scene ''"),
        ("a\0b", "there is no scene 'a\\x00b'"),
        ("x" * 5000, "there is no scene 'xxx"),
    ],
)
def test_missing_scenes_are_explained(name, sentence, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(errors.SceneError) as caught:
        load_scene(name)
    assert str(caught.value).startswith(sentence)


def test_a_misspelt_scene_file_is_answered_with_its_neighbour(tmp_path):
    (tmp_path / "curtain.toml").write_text(GRID)
    with pytest.raises(errors.SceneError, match=r"did you mean 'curtain.toml'\?"):
        load_scene(tmp_path / "curtian.toml")


def test_files_that_are_not_text_are_refused(tmp_path):
    (tmp_path / "s.toml").write_bytes(b"title = '\xff'")
    with pytest.raises(errors.SceneError, match=r"^s.toml: the file is not UTF-8 text \(byte 9\)"):
        load_scene(tmp_path / "s.toml")


def test_a_byte_order_mark_is_no_part_of_a_scene(tmp_path):
    (tmp_path / "s.toml").write_text(GRID, encoding="utf-8-sig")
    assert load_scene(tmp_path / "s.toml") == scene_from_toml(GRID, name="s", folder=tmp_path)


def test_scenes_are_immutable_and_have_a_json_schema():
    scene = scene_from_toml(GRID)
    with pytest.raises(ValueError, match="frozen"):
        scene.frames = 3
    schema = Scene.model_json_schema()
    assert schema["properties"]["frames"]["type"] == "integer"
    assert set(FabricTable.model_fields) == set(schema["$defs"]["FabricTable"]["properties"])


@pytest.mark.parametrize("outline", ["[[1, 0], [2, 0], [2, 1], [1, 1]]", "[[1, 1], [2, 1], [2, 0], [1, 0]]"])
def test_a_lathe_turns_its_outline_about_the_axis(outline):
    scene = scene_from_toml(GRID + f'[[obstacle]]\nshape = "lathe"\noutline = {outline}\nposition = [0, 0, 3]\n')
    ring = scene.build()[1][0]
    corners = ring.points[ring.triangles]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
    # A prism of 48 sides between radii 1 and 2, whichever way around the outline goes.
    assert volume == pytest.approx(0.5 * 48 * np.sin(2 * np.pi / 48) * (2.0**2 - 1.0**2), rel=1e-6)
    assert (ring.points[:, 2].min(), ring.points[:, 2].max()) == pytest.approx((3.0, 4.0))


def test_a_lathe_takes_an_outline_around_an_area_on_one_side_of_its_axis():
    turned_over, flat = "[[0, 0], [-1, 0], [0, 1]]", "[[0, 0], [1, 0], [0, 0]]"
    for outline, match in {turned_over: "one side of the axis, but its item 1 has", flat: "an area"}.items():
        with pytest.raises(errors.SceneError, match=match):
            scene_from_toml(GRID + f'[[obstacle]]\nshape = "lathe"\noutline = {outline}\n')


def test_the_defaults_of_fabrics_in_the_reference_are_what_cloth_gets():
    """The schema leaves them to the simulator, so the reference asks that."""
    (cloth,) = scene_from_toml('[[cloth]]\nshape = "grid"\n').cloth
    fabric = cloth.fabric.build()
    rows = dict(re.findall(r"^\| `(\w+)` \|[^|]*\| `([^`]*)` \|", field_tables().split("### `fabric`")[1], flags=re.M))
    for name in ("areal_density", "stretch_stiffness", "bend_stiffness", "damping_time", "air_friction"):
        assert float(rows[name]) == getattr(fabric, name)
