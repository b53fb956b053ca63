"""Whatever a scene file or a command line holds: a result, or one sentence and exit code 2. Never a traceback.

Scenes are validated and built, but not simulated, except where they are tiny; building is left out where a valid scene
has more vertices than a test has time for.
"""

import copy
import io
import math
import re
import tomllib
from contextlib import redirect_stderr, redirect_stdout

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from warpcloth.scenes import bundled_scenes, load_scene, scene_from_toml
from warpcloth.scenes.load import BUNDLED, scene_from_data
from warpcloth.scenes.overrides import apply_overrides

from warpcloth import errors
from warpcloth.cli import run

pytestmark = pytest.mark.filterwarnings("ignore::warpcloth.errors.FabricWarning")  # of cells that are long
MANY = settings(max_examples=800, derandomize=True, suppress_health_check=list(HealthCheck))
FEW = settings(MANY, max_examples=60)
MOST_VERTICES = 2_000  # that a test builds
LONGEST = 1_000  # characters of a sentence

# Few vertices, and a mesh that reads fast.
TEXTS = {
    name: re.sub(r"resolution = .*", "resolution = [5, 4]", (BUNDLED / f"{name}.toml").read_text()).replace(
        "bunny", "cube"
    )
    for name in bundled_scenes()
}
TABLES = {name: tomllib.loads(text) for name, text in TEXTS.items()}
LINES = sorted({line for text in TEXTS.values() for line in text.splitlines()})

NAPKIN = """
[simulation]
substeps = 2

[[cloth]]
shape = "grid"
resolution = [3, 3]

[[obstacle]]
shape = "plane"
point = [0, 0, -1]
"""

# Words that mean something somewhere in a scene file.
VOCABULARY = [
    "grid", "disc", "mesh", "plane", "sphere", "capsule", "box", "left", "right", "top", "bottom_left", "top_right",
    "linear", "smooth", "auto", "float32", "float64", "symplectic_euler", "cpu", "warp:sphere.usd", "warp:rocks.usd",
]  # fmt: skip

numbers = st.one_of(
    st.sampled_from([0, -1, 1, 2, 3, 10**6, 2**31, 2**63, 10**400, -(10**400)]),
    st.sampled_from([0.0, -0.0, 5e-324, 1e-30, 1e30, 1.7e308, -1e308, math.inf, -math.inf, math.nan]),
    st.integers(-5, 100),
    st.floats(-10, 10),
)
words = st.one_of(
    st.sampled_from(
        ["", "auto", "grid", "mesh", "left", "warp:sphere.usd", "warp:", "/", "..", "cpu", "cuda:7", "a\nb", "\0"]
    ),
    st.text(max_size=12),
)
dates = st.one_of(st.dates(), st.times(), st.datetimes())
junk = st.recursive(
    st.one_of(numbers, words, st.booleans(), dates),
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(words, inner, max_size=3)),
    max_leaves=6,
)


def places(node, path=()):
    """Paths of everything in nested tables and lists."""
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in items:
        yield (*path, key)
        yield from places(value, (*path, key))


@st.composite
def mutated_tables(draw):
    """A bundled scene with a few values replaced, removed, renamed or added."""
    data = copy.deepcopy(TABLES[draw(st.sampled_from(sorted(TABLES)))])
    for _ in range(draw(st.integers(1, 2))):
        path = draw(st.sampled_from(list(places(data)) or [("title",)]))
        parent = data
        for key in path[:-1]:
            parent = parent[key]
        mutate(draw, parent, path[-1])
    return data


def mutate(draw, parent, key):
    """Change one entry of a table or list."""
    action = draw(st.sampled_from(["nudge"] * 5 + ["replace", "remove", "rename", "add"]))
    if action == "nudge":
        parent[key] = draw(nudged(parent[key]))
    elif action == "remove":
        del parent[key]
    elif action == "rename" and isinstance(parent, dict):
        parent[draw(words)] = parent.pop(key)
    elif action == "add" and isinstance(parent, dict):
        parent[draw(words)] = draw(junk)
    elif action == "add":
        parent.append(draw(junk))
    else:
        parent[key] = draw(junk)


def nudged(value):
    """Values of the same type: mostly ones that may well be right."""
    if isinstance(value, bool):
        return st.just(not value)
    if isinstance(value, int):
        return st.one_of(st.integers(-1, 12), numbers)
    if isinstance(value, float):
        factor = st.sampled_from([0.0, 1e-6, 0.1, 0.9, 1.1, 10.0, 1e6, -1.0])
        return st.one_of(factor.map(lambda times: times * value), numbers)
    if isinstance(value, str):
        return st.one_of(st.sampled_from(VOCABULARY), words)
    if isinstance(value, list):
        return st.one_of(st.permutations(value), st.just(value[1:]), st.just(value + value[-1:]))
    return st.just(value)


def build(make):
    """The scene that ``make`` returns, built, or the sentence that it is refused with."""
    try:
        scene = make()
        if vertices(scene) <= MOST_VERTICES:
            scene.build()
            scene.build_network()
    except errors.InputError as refusal:
        sentence = str(refusal)
    else:
        return
    check_sentence(sentence)


def vertices(scene):
    """How many vertices the grids and discs of a scene have."""
    return sum(table.vertices for table in scene.cloth if table.shape != "mesh")


def check_sentence(text):
    """One line, not too long, without the innards of Python or pydantic."""
    assert text.strip()
    assert "\n" not in text
    assert len(text) < LONGEST
    assert not any(
        word in text for word in ("Traceback", "pydantic", "validation error", "ValidationError", "object at 0x")
    )


@MANY
@given(mutated_tables())
def test_mutated_scenes(data):
    build(lambda: scene_from_data(data, source="s.toml"))


@MANY
@given(st.lists(st.one_of(st.sampled_from(LINES), st.text(max_size=20)), max_size=25))
def test_shuffled_lines(lines):
    build(lambda: scene_from_toml("\n".join(lines), source="s.toml"))


@MANY
@given(st.sampled_from(sorted(TEXTS)), st.data())
def test_garbled_text(name, data):
    text = TEXTS[name]
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.integers(0, len(text)))
        stop = data.draw(st.integers(start, min(len(text), start + 20)))
        text = text[:start] + data.draw(st.text(max_size=8)) + text[stop:]
    build(lambda: scene_from_toml(text, source="s.toml"))


@st.composite
def assignments(draw, tables):
    """``path=value``: mostly of a path in the scene with a value of the right type, else anything."""
    path = draw(st.sampled_from(list(places(tables))))
    value = tables
    for key in path:
        value = value[key]
    right = nudged(value).map(str)
    others = st.sampled_from(["[1, 1]", "{}", "[[", '"x"', "true", "1979-01-01", "1\nx=2"])
    text = draw(st.one_of(right, right, right, numbers.map(str), words, others))
    where = ".".join(map(str, path))
    wrong = st.sampled_from([f"{where}.x={text}", f"x.{where}={text}", where, text, f"{where}="])
    return draw(st.one_of(st.just(f"{where}={text}"), st.just(f"{where} = {text}"), wrong))


@MANY
@given(st.sampled_from(sorted(TABLES)), st.data())
def test_overrides(name, data):
    changes = data.draw(st.lists(assignments(TABLES[name]), min_size=1, max_size=3))

    def make():
        data = copy.deepcopy(TABLES[name])
        apply_overrides(data, changes)
        return scene_from_data(data, source="s.toml")

    build(make)


@settings(MANY, max_examples=200)
@given(st.one_of(words, st.text(max_size=300), st.sampled_from([*TEXTS, "hanging.toml", "x/y.toml", "~", "/dev/null"])))
def test_scene_names(name):
    build(lambda: load_scene(name))


@pytest.fixture(scope="module")
def napkin(tmp_path_factory):
    """A scene that simulates in no time."""
    path = tmp_path_factory.mktemp("fuzz") / "napkin.toml"
    path.write_text(NAPKIN)
    return path


values = st.one_of(numbers.map(str), words.filter(lambda text: "\0" not in text))
COMMANDS = ("simulate", "scenes", "check", "integrators", "fabrics")
flags = st.sampled_from(["--substeps", "--integrator", "--precision", "--device", "--frames", "--set", "--bogus", "-o"])


@FEW
@given(st.lists(st.tuples(flags, values), min_size=1, max_size=3))
def test_command_lines(napkin, options):
    """Flags with any values; what turns out to be valid is simulated for a frame or two."""
    arguments = ["simulate", str(napkin), "-o", str(napkin.with_suffix(".usdc"))]
    arguments += [part for option in options for part in option if not too_long(*option)]
    check_run([*arguments, *([] if "--frames" in arguments else ["--frames", "1"])])


def too_long(flag, value):
    """Whether an option would make a valid run take longer than a test may, or write into the current folder."""
    return (flag in ("--frames", "--substeps") and value.isdigit() and int(value) > 3) or flag == "-o"


@settings(FEW, max_examples=200)
@given(
    st.lists(
        st.one_of(values, st.sampled_from(["simulate", "scenes", "check", "integrators", "--json", "--help"])),
        max_size=4,
    )
)
def test_any_words_as_a_command_line(words):
    check_run(["scenes" if word in TEXTS else word for word in words])


@FEW
@given(
    st.fixed_dictionaries(
        {},
        optional={
            "cloth.0.size": st.lists(st.floats(1e-6, 1e4), min_size=2, max_size=2),
            "cloth.0.fabric.areal_density": st.floats(1e-12, 1e3),
            "cloth.0.fabric.stretch_stiffness": st.floats(80.0, 1e7),
            "cloth.0.fabric.damping_time": st.floats(0.0, 10.0),
            "cloth.0.velocity": st.lists(st.floats(-1e4, 1e4), min_size=3, max_size=3),
            "simulation.gravity": st.lists(st.floats(-1e4, 1e4), min_size=3, max_size=3),
            "fps": st.floats(1e-3, 1e5),
        },
    )
)
def test_extreme_but_valid_scenes_simulate_or_fail_in_words(napkin, fields):
    changes = [part for path, value in fields.items() for part in ("--set", f"{path}={value}")]
    check_run(
        ["simulate", str(napkin), "-o", str(napkin.with_suffix(".usdc")), "--frames", "2", *changes], codes=(0, 3)
    )


def check_run(arguments, codes=(0, 2)):
    """A command ends with one of the exit codes, and says why where it is not 0."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = run(arguments)
    assert code in codes, err.getvalue()
    if code != 0:
        *warnings, message = err.getvalue().rstrip("\n").split("\n")
        for line in (*warnings, message):
            assert line.startswith("warpcloth: ")
            check_sentence(line)
