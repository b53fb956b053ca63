"""Paths that begin with ``~``: a home folder, or the name of a user that is not there."""

import pytest

from warpcloth.cli import run as cli
from warpcloth.validate import at_home


def test_a_home_folder_stands_for_a_tilde(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    assert at_home("~/a") == tmp_path / "a"
    assert str(at_home("~no_such_user/a")) == "~no_such_user/a"


@pytest.mark.parametrize(
    "arguments",
    [
        ["batch", "~no_such_user/sweep.toml"],
        ["batch", "status", "~no_such_user/batch"],
        ["simulate", "~no_such_user/scene.toml"],
        ["simulate", "hanging", "--set", 'cloth.0={shape="mesh", path="~no_such_user/a.obj"}'],
        ["simulate", "hanging", "--set", "stage.path='~no_such_user/a.usda'"],
        ["check", "~no_such_user/a.usdc"],
    ],
)
def test_a_user_that_is_not_there_is_a_folder_that_is_not_there(capfd, arguments):
    assert cli(arguments) == 2
    assert "~no_such_user" in capfd.readouterr().err
