"""Sweep files: designs, distributions, what is refused, and scenes that reproduce their samples."""

from pathlib import Path

import numpy as np
import pytest
from batch_sweeps import SCENE, written
from scipy import stats

from warpcloth import batch
from warpcloth.batch import Sweep, draws, load_sweep
from warpcloth.batch.schema import LimitsTable, ParameterTable, SweepTable
from warpcloth.errors import SceneError


def sweep_of(folder, *parameters: str, head: str = "count = 64") -> Sweep:
    tables = "".join(f"\n[[parameter]]\n{parameter}\n" for parameter in parameters)
    return load_sweep(written(folder, f'scene = "scene.toml"\n{head}\n{tables}'))


def values(sweep: Sweep, path: str) -> list:
    return [sweep.sample(index).parameters[path] for index in range(sweep.count)]


def test_distributions_are_what_they_are_called(tmp_path):
    sweep = sweep_of(
        tmp_path,
        'path = "cloth.0.position.0"\nuniform = [1.0, 3.0]',
        'path = "cloth.0.fabric.areal_density"\nlog_uniform = [0.01, 1.0]',
        'path = "cloth.0.position.1"\nnormal = [0.5, 0.1]',
        'path = "obstacle.ball.friction"\nvalues = [0.1, 0.9]\nweights = [3.0, 1.0]',
        'path = "frames"\nuniform = [5.0, 9.0]\nwhole = true',
        head="count = 300\nseed = 4",
    )
    paths = [parameter.path for parameter in sweep.table.parameter]
    samples = [sweep.sample(index).parameters for index in range(sweep.count)]
    x, k, y, friction, frames = (np.array([sample[path] for sample in samples]) for path in paths)
    assert stats.kstest(x, stats.uniform(1.0, 2.0).cdf).pvalue > 0.01
    assert stats.kstest(np.log(k), stats.uniform(np.log(0.01), np.log(100.0)).cdf).pvalue > 0.01
    assert stats.kstest(y, stats.norm(0.5, 0.1).cdf).pvalue > 0.01
    assert np.mean(friction == 0.1) == pytest.approx(0.75, abs=0.06)
    assert set(frames) == {5, 6, 7, 8, 9}
    scene = sweep.sample(7).scene
    assert scene.cloth[0].position[:2] == (x[7], y[7])
    assert (scene.cloth[0].fabric.areal_density, scene.obstacle[0].friction) == (k[7], friction[7])


@pytest.mark.parametrize("design", ["random", "sobol"])
def test_a_larger_sweep_begins_with_the_smaller_one(tmp_path, design):
    small, large = (
        sweep_of(tmp_path, 'path = "cloth.0.position.0"\nuniform = [0, 1]', head=f'design = "{design}"\ncount = {n}')
        for n in (20, 50)
    )
    assert values(small, "cloth.0.position.0") == values(large, "cloth.0.position.0")[:20]
    assert small.sample(3) != small.sample(4)
    assert small.sample(3).scene.seed == large.sample(3).scene.seed != small.sample(4).scene.seed


def test_space_filling_designs_fill_space(tmp_path):
    parameters = ['path = "cloth.0.position.0"\nuniform = [0, 1]', 'path = "cloth.0.position.1"\nuniform = [0, 1]']
    discrepancy = {}
    for design in ("random", "sobol", "latin_hypercube"):
        sweep = sweep_of(tmp_path, *parameters, head=f'design = "{design}"\ncount = 64')
        discrepancy[design] = stats.qmc.discrepancy(sweep.coordinates)
    assert discrepancy["sobol"] < 0.3 * discrepancy["random"]
    hypercube = sweep_of(tmp_path, *parameters, head='design = "latin_hypercube"\ncount = 10').coordinates
    np.testing.assert_array_equal(np.sort(np.floor(10 * hypercube), axis=0)[:, 0], np.arange(10))


def test_a_grid_has_every_combination_once(tmp_path):
    sweep = sweep_of(
        tmp_path,
        'path = "cloth.0.fabric"\nvalues = ["cotton", "denim"]\nweights = [5.0, 1.0]',
        'path = "cloth.0.position.2"\nrange = [0.3, 0.5, 3]',
        'path = "obstacle.ball.friction"\nuniform = [0.0, 1.0]',
        head='design = "grid"',
    )
    pairs = list(zip(values(sweep, "cloth.0.fabric"), values(sweep, "cloth.0.position.2"), strict=True))
    assert pairs == [(name, z) for name in ("cotton", "denim") for z in (0.3, 0.4, 0.5)]
    assert len(set(values(sweep, "obstacle.ball.friction"))) == 6
    assert sweep.sample(5).scene.cloth[0].fabric.name == "denim"


def test_a_long_range_is_made_once(tmp_path, monkeypatch):
    made = []
    levels = draws.levels
    monkeypatch.setattr(draws, "levels", lambda parameter: made.append(parameter.path) or levels(parameter))
    path = "cloth.0.position.2"
    sweep = sweep_of(tmp_path, f'path = "{path}"\nrange = [0.3, 0.5, 100]', head='design = "grid"')
    np.testing.assert_allclose(values(sweep, path), np.linspace(0.3, 0.5, 100))
    assert len(made) < 10


def test_whole_tables_and_fields_within_them(tmp_path):
    sweep = sweep_of(
        tmp_path,
        'path = "obstacle.0"\nvalues = [{ name = "brick", shape = "box", center = [0, 0, 0.1], size = [1, 1, 0.2] }]',
        'path = "obstacle.brick.rotation.2"\nvalues = [45.0]',
    )
    assert sweep.sample(0).scene.obstacle[0].rotation == (0.0, 0.0, 45.0)


def test_whole_lists_of_tables_and_fields_within_them(tmp_path):
    sweep = sweep_of(
        tmp_path,
        'path = "obstacle"\nvalues = [[{ shape = "box", center = [0, 0, 0.1], size = [1, 1, 0.2] }]]',
        'path = "obstacle.0.rotation.2"\nvalues = [45.0]',
    )
    assert sweep.sample(0).scene.obstacle[0].rotation == (0.0, 0.0, 45.0)


def test_files_by_pattern_are_found_beside_the_sweep(tmp_path):
    (tmp_path / "meshes").mkdir()
    for name in ("b.obj", "a.obj", "c.ply"):
        (tmp_path / "meshes" / name).touch()
    scene = SCENE.replace('shape = "sphere"\ncenter = [0.0, 0.0, 0.1]\nradius = 0.1', 'shape = "mesh"\npath = "x.obj"')
    text = 'scene = "scene.toml"\ndesign = "grid"\n[[parameter]]\npath = "obstacle.ball.path"\nglob = "meshes/*.obj"\n'
    sweep = load_sweep(written(tmp_path, text, scene))
    paths = [sweep.sample(index).scene.obstacle[0].path for index in range(sweep.count)]
    assert paths == [str(tmp_path / "meshes" / name) for name in ("a.obj", "b.obj")]
    (tmp_path / "meshes" / "d.obj").touch()
    assert load_sweep(tmp_path / "sweep.toml").identity != sweep.identity == Sweep.from_json(sweep.as_json()).identity


def test_a_file_that_is_not_text_is_named_once_and_a_byte_order_mark_is_nothing(tmp_path):
    path = written(tmp_path, f'scene = "scene.toml"\ncount = 2\n[[parameter]]\n{UNIFORM}\n')
    plain = load_sweep(path)
    path.write_text(path.read_text(encoding="utf-8"), encoding="utf-8-sig")
    assert load_sweep(path).identity == plain.identity
    path.write_bytes(b"scene = '\xff'")
    with pytest.raises(SceneError, match=r"^sweep\.toml: the file is not UTF-8 text \(byte 9\)$"):
        load_sweep(path)


UNIFORM = 'path = "cloth.0.position.2"\nuniform = [0.3, 0.5]'


@pytest.mark.parametrize(
    ("parameter", "head", "message"),
    [
        (UNIFORM, "", "sweep.toml: the sweep must have a count unless its design is 'grid'"),
        (UNIFORM, "count = 0", "count must be a whole number from 1 to 10,000,000, not 0"),
        (UNIFORM, 'count = 1\ndesign = "sobl"', "design must be .* did you mean 'sobol'"),
        (UNIFORM, "cuont = 1", "the key 'cuont' is unknown; did you mean 'count'"),
        ('path = "a b"\nuniform = [0, 1]', "count = 1", "parameter.0.path must be the dotted path"),
        ('path = "cloth.0.size.0"\nuniform = [1, 1]', "count = 1", "must have a lower bound below the upper one"),
        ('path = "cloth.0.size.0"\nlog_uniform = [0, 1]', "count = 1", "each above 0"),
        ('path = "cloth.0.size.0"\nuniform = [1, 2]\nvalues = [1]', "count = 1", "must have exactly one of"),
        ('path = "cloth.0.size.0"\nvalues = [1]\nweights = [1, 2]', "count = 1", "as many weights as values, not 2"),
        ('path = "frames"\nvalues = [1.5]\nwhole = true', "count = 1", "0 must not have 'whole' beside 'values'"),
        ('path = "cloth.0.path"\nglob = "*.obj"\nwhole = true', "count = 1", "must not have 'whole' beside 'glob'"),
        ('path = "cloth.0.size.0"\nrange = [1, 2, 0.5]', "count = 1", "a whole number of values in its range"),
        ('path = "cloth.0.size.0"\nrange = [1, 2, 1e11]', "count = 1", "range, from 1 to 10,000,000, not 1e.11"),
        ('path = "cloth.0.size.0"\nvalues = [1, nan]', "count = 1", "finite numbers among its values, and item 1 is"),
        ('path = "cloth.0"\nvalues = [{ size = [inf, 1] }]', "count = 1", "parameter.0 must have only finite numbers"),
        ('path = "obstacle.0.path"\nglob = "*.nothing"', "count = 1", "no file matches the pattern"),
        ('path = "obstacle.0.path"\nglob = ""', "count = 1", "no file matches the pattern '' of"),
        ('path = "obstacle.0.path"\nglob = "a**b/*"', "count = 1", "no file matches the pattern"),
        (UNIFORM, 'count = 1\ncheck = true\noutputs = ["strain"]', "'pose' or 'frames' .* for its 'check' to look at"),
        (f"{UNIFORM}\n[[parameter]]\n{UNIFORM}", "count = 1", "only one .* for 'cloth.0.position.2'"),
        (
            f'{UNIFORM}\n[[parameter]]\npath = "cloth.0.position"\nvalues = [[0, 0, 1]]',
            "count = 1",
            "the sweep must have its .* for 'cloth.0.position.2' after that for 'cloth.0.position', which would undo",
        ),
        ('path = "cloth.0.siez.0"\nvalues = [1]', "count = 1", "sample 0: .*siez' is unknown; did you mean 'size'"),
        ('path = "cloth.3.size"\nvalues = [1]', "count = 1", "sample 0: 'cloth' is a list of 1"),
        ('path = "cloth.0.size.0"\nnormal = [0.1, 1.0]', "count = 99", r"sample \d+: cloth.0.size must be 2 numbers"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_before_any_work(tmp_path, parameter, head, message):
    with pytest.raises(SceneError, match=message):
        sweep_of(tmp_path, parameter, head=head).check()


def test_a_sweep_is_the_same_whichever_way_its_file_is_named(tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "sweeps").mkdir()
    (tmp_path / "link").symlink_to("sweeps")
    sweep = load_sweep(written(tmp_path / "sweeps"))
    monkeypatch.chdir(tmp_path / "elsewhere")
    for name in ("../sweeps/sweep.toml", "../link/sweep.toml", "./../elsewhere/../sweeps/sweep.toml"):
        assert load_sweep(name).identity == sweep.identity


def test_a_missing_sweep_or_scene_names_what_is_near(tmp_path):
    written(tmp_path)
    with pytest.raises(SceneError, match=r"no sweep file .*; did you mean 'sweep.toml'"):
        load_sweep(tmp_path / "sweeep.toml")
    with pytest.raises(SceneError, match=r"sweep.toml: there is no scene"):
        load_sweep(tmp_path / "sweep.toml", ["scene=nothing"])


def test_the_readme_has_every_field_and_its_example_works(tmp_path):
    text = (Path(batch.__file__).parent / "README.md").read_text(encoding="utf-8")
    for table in (SweepTable, ParameterTable, LimitsTable):
        for name in table.model_fields:
            assert any(form in text for form in (f"`{name}`", f"{name} =", f"`[[{name}]]`")), name
    (tmp_path / "napkins.toml").write_text(text.split("```toml\n")[1].split("```")[0], encoding="utf-8")
    sweep = load_sweep(tmp_path / "napkins.toml", ["count=20"])
    sweep.check()
    assert {sweep.sample(index).parameters["cloth.0.fabric"] for index in range(20)} == {"cotton", "silk", "denim"}


def test_the_sweep_of_the_benchmark_is_valid():
    sweep = load_sweep(Path(__file__).parents[1] / "benchmarks" / "batch" / "thousand.toml", ["count=12"])
    sweep.check()
    assert sweep.sample(0).scene.cloth[0].resolution == (32, 32)
