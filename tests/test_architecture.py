"""Rules of the code base that reviewers should not have to check by hand, read off the syntax trees."""

import ast
import re
from fnmatch import fnmatch
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
TOP_LEVEL = {"pyproject.toml", "README.md", "warpcloth", "kernels", "scenes", "tests", "benchmarks"}
SHIPPED = ("warpcloth", "kernels", "scenes", "benchmarks")
MAX_FILE_LINES = 350
MAX_FUNCTION_LINES = 60
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)

FILES = sorted(path for folder in (*SHIPPED, "tests") for path in (REPOSITORY / folder).rglob("*.py"))
SHIPPED_FILES = [path for path in FILES if path.relative_to(REPOSITORY).parts[0] in SHIPPED]


def name_of(path: Path) -> str:
    return path.relative_to(REPOSITORY).as_posix()


def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


every_file = pytest.mark.parametrize("path", FILES, ids=name_of)
every_shipped_file = pytest.mark.parametrize("path", SHIPPED_FILES, ids=name_of)


def test_the_rules_see_the_code():
    assert {"kernels/precision.py", "warpcloth/errors.py"} <= {name_of(path) for path in SHIPPED_FILES}


def test_top_level_has_nothing_else():
    ignored = [line.rstrip("/") for line in (REPOSITORY / ".gitignore").read_text().split()]
    entries = {path.name for path in REPOSITORY.iterdir() if not path.name.startswith(".")}
    extra = {name for name in entries - TOP_LEVEL if not any(fnmatch(name, pattern) for pattern in ignored)}
    assert not extra


@every_file
def test_size(path):
    lines = path.read_text(encoding="utf-8").count("\n")
    assert lines <= MAX_FILE_LINES, f"{lines} lines; one idea per file"
    for node in ast.walk(tree_of(path)):
        if isinstance(node, FUNCTIONS):
            body = node.body[1:] if ast.get_docstring(node) is not None else node.body
            length = body[-1].end_lineno - body[0].lineno + 1 if body else 0
            assert length <= MAX_FUNCTION_LINES, f"{node.name} has {length} lines"


@every_file
def test_no_second_copy_of_a_mapped_package(path):
    """``import kernels`` finds the folder when the repository root is on the path, and makes every module twice."""
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names = [node.module or ""]
        else:
            continue
        assert not {name.split(".")[0] for name in names} & {"kernels", "scenes", "benchmarks"}, f"line {node.lineno}"


@every_file
def test_no_swallowed_exception(path):
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.ExceptHandler):
            assert node.type is not None, f"line {node.lineno}: bare except"
            assert not all(isinstance(statement, ast.Pass) for statement in node.body), f"line {node.lineno}"


@every_shipped_file
def test_nothing_left_undone(path):
    assert not re.search(r"\b(TODO|FIXME|XXX)\b", path.read_text(encoding="utf-8"))


@every_shipped_file
def test_public_names_have_docstrings(path):
    """Device functions may speak for themselves: their formula is their body, and kernels have a rule of their own."""
    tree = tree_of(path)
    assert ast.get_docstring(tree) or not tree.body, "module docstring"
    for node in tree.body:
        device = "wp." in "".join(ast.unparse(item) for item in getattr(node, "decorator_list", []))
        if isinstance(node, (*FUNCTIONS, ast.ClassDef)) and not node.name.startswith("_") and not device:
            assert ast.get_docstring(node), f"line {node.lineno}: {node.name}"
