"""What the READMEs say can be done can be done."""

import json
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from warpcloth.cli import run

REPOSITORY = Path(__file__).resolve().parents[1]
READMES = sorted(
    path for path in REPOSITORY.glob("**/*.md") if not path.relative_to(REPOSITORY).parts[0].startswith(".")
)


def blocks(path: Path, language: str) -> list[str]:
    """Fenced code blocks of one language."""
    return re.findall(rf"^```{language}\n(.*?)^```", path.read_text(encoding="utf-8"), flags=re.S | re.M)


def test_the_python_example_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (example,) = blocks(REPOSITORY / "README.md", "python")
    assert len(example.splitlines()) <= 10
    names: dict = {}
    exec(compile(example, "README.md", "exec"), names)
    points = names["points"]
    assert points.shape == (1681, 3)
    assert points[:, 2].min() < 0.3 < 0.6 < points[:, 2].max()  # it hangs over the ball
    assert "kinetic" in capsys.readouterr().out


def test_the_first_command_runs(tmp_path, monkeypatch):
    """As printed, but for two frames instead of all; what it writes passes the check that the README names."""
    monkeypatch.chdir(tmp_path)
    text = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    (simulate,) = re.findall(r"pip install -e \. && (warpcloth .*)", text)
    (check,) = re.findall(r"`(warpcloth check .*?)`", text)
    assert run([*simulate.split()[1:], "--frames", "2"]) == 0
    assert run(check.split()[1:]) == 0


def test_the_first_scene_takes_the_steps_that_the_text_says(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    path = REPOSITORY / "scenes" / "README.md"
    (tmp_path / "my_scene.toml").write_text(blocks(path, "toml")[0], encoding="utf-8")
    assert run(["simulate", "my_scene.toml", "--frames", "1", "--json"]) == 0
    taken = json.loads(capsys.readouterr().out)["substeps"]
    assert f"steps a frame instead of {taken}." in " ".join(path.read_text(encoding="utf-8").split())


def test_the_kernel_variant_example_runs(capsys):
    example = blocks(REPOSITORY / "kernels" / "README.md", "python")[0]
    exec(compile(example, "kernels/README.md", "exec"), {})
    assert "warpcloth.kernels.float64.springs" in capsys.readouterr().out


def test_the_examples_of_embedding_run_as_one_script(tmp_path):
    """From a file, as kernels need, and to the end of the program, where what shares memory is taken down."""
    script = tmp_path / "embedding.py"
    looks = """
assert env.worlds == 8
height = now.particle_q.numpy()[:, 2]
assert 0.5 < height.min() < 0.9
assert abs(height.max() - 1.0) < 1e-5
"""
    examples = blocks(REPOSITORY / "warpcloth" / "interop" / "README.md", "python")
    script.write_text("\n".join([*examples, looks]), encoding="utf-8")
    ended = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr


def test_the_gradient_examples_run(tmp_path, capsys):
    """One after the other, from a file: Warp reads the source of kernels."""
    file = tmp_path / "example.py"
    file.write_text("".join(blocks(REPOSITORY / "warpcloth" / "gradients" / "README.md", "python")), encoding="utf-8")
    names = runpy.run_path(str(file))
    assert f"({names['model'].spring_count},)" in capsys.readouterr().out
    assert names["model"].spring_stiffness.grad.numpy().any()


@pytest.mark.parametrize("path", READMES, ids=lambda path: path.relative_to(REPOSITORY).as_posix())
def test_links_lead_somewhere(path):
    links = re.findall(r"\]\(([^)#\s]+)[^)]*\)", path.read_text(encoding="utf-8"))
    local = [link for link in links if not link.startswith(("http://", "https://", "mailto:"))]
    assert not [link for link in local if not (path.parent / link).exists()]
