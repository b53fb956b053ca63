"""The benchmark of many worlds, small."""

import json

import pytest

from warpcloth.cli import run


def test_throughput_is_measured(tmp_path, capfd):
    arguments = ["--worlds", "1,3", "--resolution", "4", "--budget", "0.02", "--integrators", "xpbd", "--json"]
    assert run(["bench", "worlds", *arguments, "-o", str(tmp_path)]) == 0
    results = json.loads(capfd.readouterr().out)
    assert json.loads((tmp_path / "results.json").read_text())["rows"] == results["rows"]
    assert [(row["worlds"], row["particles"]) for row in results["rows"]] == [(1, 16), (3, 48)]
    for row in results["rows"]:
        assert row["finite"]
        assert row["steps"] >= 5
        assert row["world_steps_per_s"] == pytest.approx(row["worlds"] * 1e3 / row["step_ms"])
        assert row["particle_steps_per_s"] == pytest.approx(row["particles"] * row["substeps"] * 1e3 / row["step_ms"])


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["worlds", "--worlds", "0"], "Worlds must be a whole number from 1 to 1,000,000, got 0."),
        (["worlds", "--integrators", "xpdb"], "(did you mean 'xpbd'?)"),
        (["worlds", "--frames", "3"], "--frames is an option of `bench integrators` and `bench contact`"),
        (["contact", "--worlds", "3"], "--worlds is an option of `bench worlds`, not of `bench contact`."),
    ],
)
def test_bad_options_are_said(arguments, sentence, tmp_path, capfd):
    assert run(["bench", *arguments, "-o", str(tmp_path)]) == 2
    assert sentence in capfd.readouterr().err
