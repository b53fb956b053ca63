"""What is on disk is what gets installed, and importing it stays light."""

import subprocess
import sys
import tomllib
from fnmatch import fnmatch
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
SETUPTOOLS = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["tool"]["setuptools"]
FOLDERS = {folder: package for package, folder in SETUPTOOLS["package-dir"].items()}
HEAVY = ("pxr", "scipy", "matplotlib", "trimesh", "pydantic", "typer", "rich", "pyvista", "viser", "ray", "newton")


def _files(suffix: str | None = None) -> list[Path]:
    files = [path for folder in FOLDERS for path in (REPOSITORY / folder).rglob("*") if path.is_file()]
    files = [path for path in files if not {"__pycache__", ".ruff_cache", ".mypy_cache"} & set(path.parts)]
    return [path for path in files if suffix is None or path.suffix == suffix]


def _package(path: Path) -> str:
    folder, *rest = path.parent.relative_to(REPOSITORY).parts
    return ".".join([FOLDERS[folder], *rest])


def test_the_four_folders_are_mapped():
    assert set(FOLDERS) == {"warpcloth", "kernels", "scenes", "benchmarks"}


def test_every_python_folder_is_a_listed_package():
    on_disk = {_package(path) for path in _files(".py")}
    assert on_disk == set(SETUPTOOLS["packages"])


@pytest.mark.parametrize("package", SETUPTOOLS["packages"])
def test_every_package_has_an_init(package):
    folder, *rest = next(
        (REPOSITORY / name, *package.removeprefix(mapped).strip(".").split("."))
        for name, mapped in sorted(FOLDERS.items(), key=lambda item: -len(item[1]))
        if package == mapped or package.startswith(mapped + ".")
    )
    assert folder.joinpath(*rest, "__init__.py").is_file()


def test_every_data_file_is_packaged():
    missing = []
    for path in _files():
        if path.suffix == ".py":
            continue
        owner = next(parent for parent in path.parents if (parent / "__init__.py").is_file())
        patterns = SETUPTOOLS["package-data"].get(_package(owner / "__init__.py"), [])
        if not any(fnmatch(path.relative_to(owner).as_posix(), pattern) for pattern in patterns):
            missing.append(str(path.relative_to(REPOSITORY)))
    assert not missing


def _run(code: str, folder: Path) -> str:
    return subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=True).stdout


def test_importing_warpcloth_stays_light(tmp_path):
    loaded = _run("import sys, warpcloth; print(*{name.split('.')[0] for name in sys.modules})", tmp_path).split()
    assert "warpcloth" in loaded
    assert not set(HEAVY) & set(loaded)


def test_importing_warpcloth_changes_nothing_in_warp(tmp_path):
    code = """
import warp as wp, warp.config as config
before = {k: v for k, v in vars(config).items() if not k.startswith("__")}
import warpcloth
after = {k: v for k, v in vars(config).items() if not k.startswith("__")}
assert before == after
assert wp._src.context.runtime is None, "Warp was initialised"
"""
    assert _run(code, tmp_path) == ""
