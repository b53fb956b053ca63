"""Rules of device code, read off the syntax trees of ``kernels/``: argument order, outputs, no host calls."""

import ast
import re
from pathlib import Path

import pytest

KERNELS = Path(__file__).resolve().parents[1] / "kernels"
SECTIONS = ["Model", "State in", "Out"]
HOST_CALLS = {
    *("launch", "launch_tiled", "capture_launch", "synchronize", "synchronize_device", "init", "force_load"),
    *("array", "zeros", "zeros_like", "empty", "empty_like", "full", "full_like", "ones", "clone", "copy"),
    *("from_numpy", "from_torch", "Mesh", "Bvh", "HashGrid", "Volume", "ScopedDevice", "ScopedTimer", "Tape"),
}
PYTHON_CALLS = {"open", "print", "input", "exec", "eval"}
ALLOWED_IMPORTS = {"sys", "warp"}
WRITES = {f"atomic_{what}" for what in ("add", "sub", "min", "max", "and", "or", "xor", "exch", "cas")}

FILES = sorted(path for path in KERNELS.rglob("*.py") if path.name != "__init__.py")
every_file = pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)


def decorated(tree: ast.Module, what: str) -> list[ast.FunctionDef]:
    """Functions under ``@wp.kernel`` or ``@wp.func``, with or without arguments."""
    return [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
        and any(re.fullmatch(rf"wp\.{what}(\(.*\))?", ast.unparse(item)) for item in node.decorator_list)
    ]


def sections(function: ast.FunctionDef, lines: list[str]) -> list[tuple[str, list[str]]]:
    """The signature as (comment, argument names) pairs in the order of the text; names before any comment under ''."""
    found: list[tuple[str, list[str]]] = [("", [])]
    by_line = {argument.lineno: argument.arg for argument in function.args.args}
    for number in range(function.lineno, function.body[0].lineno):
        comment = re.fullmatch(r"\s*# (.+)", lines[number - 1])
        if comment:
            found.append((comment[1].strip(), []))
        elif number in by_line:
            found[-1][1].append(by_line[number])
    return found if found[0][1] else found[1:]


def written_names(function: ast.FunctionDef) -> set[str]:
    """Base names of everything the body writes through: ``a[i] = …``, ``a[i].x += …``, ``wp.atomic_add(a, …)``."""
    names = set()
    for node in ast.walk(function):
        targets: list[ast.expr] = []
        if isinstance(node, ast.Assign):
            targets = node.targets
        elif isinstance(node, ast.AugAssign | ast.AnnAssign):
            targets = [node.target]
        elif isinstance(node, ast.Call) and ast.unparse(node.func).removeprefix("wp.") in WRITES:
            names.add(ast.unparse(node.args[0]).split(".")[0].split("[")[0])
        names |= {ast.unparse(t).split(".")[0].split("[")[0] for t in targets if isinstance(t, ast.Subscript)}
    return names


def array_arguments(function: ast.FunctionDef) -> set[str]:
    return {a.arg for a in function.args.args if a.annotation and "array" in ast.unparse(a.annotation)}


def host_calls(tree: ast.Module) -> list[str]:
    """Calls that belong on the host, outside annotations (``wp.array(dtype=…)`` is a type there)."""
    annotations = {
        id(inner)
        for node in ast.walk(tree)
        for part in [getattr(node, "annotation", None), getattr(node, "returns", None)]
        if part is not None
        for inner in ast.walk(part)
    }
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and id(node) not in annotations]
    names = [ast.unparse(call.func) for call in calls]
    wrong = {f"wp.{name}" for name in HOST_CALLS} | PYTHON_CALLS
    return [name for name in names if name in wrong or name.endswith((".numpy", ".assign", ".fill_", ".zero_"))]


def test_rules_recognise_a_bad_kernel():
    """The checks below find what they are for."""
    code = """
@wp.kernel
def bad(
    # Out
    force: wp.array(dtype=vec3),
    # Model
    mass: wp.array(dtype=real),
):
    i = wp.tid()
    force[i] = vec3()
    wp.atomic_add(mass, i, real(1.0))
    buffer = wp.zeros(3)
"""
    tree = ast.parse(code)
    (kernel,) = decorated(tree, "kernel")
    assert sections(kernel, code.splitlines()) == [("Out", ["force"]), ("Model", ["mass"])]
    assert written_names(kernel) & array_arguments(kernel) == {"force", "mass"}
    assert host_calls(tree) == ["wp.zeros"]


@every_file
def test_argument_order(path):
    text = path.read_text(encoding="utf-8")
    for kernel in decorated(ast.parse(text), "kernel"):
        found = sections(kernel, text.splitlines())
        titles = [title for title, _ in found]
        where = f"{kernel.name}: sections {titles}"
        assert titles == [title for title in SECTIONS if title in titles], where
        assert "Out" in titles, where
        assert all(names for _, names in found), where
        assert sum(len(names) for _, names in found) == len(kernel.args.args), f"{kernel.name}: one argument a line"
        for title, names in found:
            wrong = [name for name in names if name.endswith("_out") != (title == "Out")]
            assert not wrong, f"{kernel.name}: {wrong} under # {title}"


@every_file
def test_only_outputs_are_written(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for function in decorated(tree, "kernel") + decorated(tree, "func"):
        written = written_names(function) & array_arguments(function)
        assert all(name.endswith("_out") for name in written), f"{function.name} writes {written}"


@every_file
def test_no_host_calls(path):
    assert not host_calls(ast.parse(path.read_text(encoding="utf-8")))


@every_file
def test_imports_only_warp_and_siblings(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            assert {alias.name for alias in node.names} <= ALLOWED_IMPORTS, f"line {node.lineno}"
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 1, f"line {node.lineno}: only from .sibling"


@every_file
def test_kernel_files_set_module_options(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    if decorated(tree, "kernel"):
        calls = [ast.unparse(node) for node in tree.body if isinstance(node, ast.Expr)]
        options = [
            f"wp.set_module_options({name}, module=sys.modules[__name__])" for name in ("OPTIONS", "FORWARD_ONLY")
        ]
        assert sum(calls.count(option) for option in options) == 1


@every_file
def test_kernels_have_docstrings(path):
    for kernel in decorated(ast.parse(path.read_text(encoding="utf-8")), "kernel"):
        assert ast.get_docstring(kernel), kernel.name
