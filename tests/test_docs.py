"""Examples in docstrings can be run, and what is public is there, described and typed."""

import doctest
import importlib
import inspect
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
FOLDERS = {"warpcloth": "warpcloth", "scenes": "warpcloth.scenes", "benchmarks": "warpcloth.benchmarks"}


def modules() -> list[str]:
    """Names of all modules whose text has an example."""
    found = []
    for folder, package in FOLDERS.items():
        for path in sorted((REPOSITORY / folder).rglob("*.py")):
            if ">>> " in path.read_text(encoding="utf-8"):
                parts = path.relative_to(REPOSITORY / folder).with_suffix("").parts
                found.append(".".join([package, *(part for part in parts if part != "__init__")]))
    return found


@pytest.mark.parametrize("name", modules())
def test_examples_in_docstrings_run(name):
    result = doctest.testmod(importlib.import_module(name), raise_on_error=False)
    assert result.attempted > 0
    assert result.failed == 0


PUBLIC = ("warpcloth", "warpcloth.interop", "warpcloth.interop.newton")


@pytest.mark.parametrize("module", PUBLIC)
def test_public_names_are_described_and_typed(module):
    package = importlib.import_module(module)
    for name in package.__all__:
        thing = getattr(package, name)
        if inspect.ismodule(thing):
            continue
        assert inspect.getdoc(thing), name
        functions = (
            [thing] if inspect.isfunction(thing) else [getattr(thing, key) for key in vars(thing) if key[0] != "_"]
        )
        for function in filter(inspect.isfunction, functions):
            assert inspect.getdoc(function), f"{name}.{function.__name__}"
            for key, parameter in inspect.signature(function).parameters.items():
                assert key == "self" or parameter.annotation is not parameter.empty, (
                    f"{name}.{function.__name__}: {key}"
                )
