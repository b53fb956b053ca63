"""``warpcloth compile``: which GPUs it compiles for."""

import json

import pytest
import warp as wp

from warpcloth.batch import compilation
from warpcloth.cli import run

KNOWN = [75, 80, 90, 120]


@pytest.fixture
def asked(monkeypatch):
    """The architectures that the compiler was asked for; none of them is compiled."""
    calls = []
    monkeypatch.setattr(wp, "get_cuda_supported_archs", lambda: KNOWN)
    monkeypatch.setattr(compilation, "compile_here", lambda variants: 0)
    monkeypatch.setattr(compilation, "compile_ahead", lambda variants, found: calls.append(list(found)) or [])
    return calls


@pytest.mark.parametrize("arch", ["76", "80,76", "sm_76", "4294967296", "80,,90", "", "ampere", "-80"])
def test_architectures_that_warp_does_not_know_are_one_sentence(asked, capfd, arch):
    assert run(["compile", f"--arch={arch}", "--json"]) == 2
    out, err = capfd.readouterr()
    assert "is not a compute capability that Warp compiles for; known are 75, 80, 90, 120." in json.loads(out)["error"]
    assert err.count("\n") == 1
    assert asked == []


def test_architectures_are_taken_as_users_write_them(asked):
    assert run(["compile", "--arch", "sm_80, 90,sm120"]) == 0
    assert asked == [[80, 90, 120]]


def test_without_the_compiler_of_cuda_there_is_nothing_to_compile_ahead(asked, monkeypatch, capfd):
    monkeypatch.setattr(wp, "get_cuda_supported_archs", list)
    assert run(["compile", "--arch", "80"]) == 2
    assert "cannot compile for GPUs" in capfd.readouterr().err


@pytest.mark.parametrize(("device", "passed"), [(None, None), ("cpu", "cpu")])
def test_kernels_are_compiled_for_all_devices_of_the_machine_or_for_one(monkeypatch, device, passed):
    """To Warp no device means all of them; to `get_device` it means the current one, a GPU where there is any."""
    seen = []
    monkeypatch.setattr(compilation.wp, "force_load", lambda device, modules: seen.append((device, len(modules))))
    count = compilation.compile_here(["float32"], device)
    assert seen == [(passed if passed is None else compilation.wp.get_device(passed), count)]
