"""Every kernel module builds for NVIDIA GPUs, on a machine that has none: NVRTC is inside Warp's wheel.

Modules are found on disk, so a new file in ``kernels/`` is covered without an entry here. In single precision they are
built for every architecture; the other variants differ from it in code, not in what they ask of a device, so the oldest
architecture stands for all.
"""

from pathlib import Path

import pytest
import warp as wp
from warpcloth.kernels import VARIANTS, KernelSet

KERNELS = Path(__file__).resolve().parents[1] / "kernels"
MODULES = sorted(path.stem for path in KERNELS.glob("*.py") if "@wp.kernel" in path.read_text(encoding="utf-8"))
ARCHITECTURES = {"float32": [75, 90, 100], "float64": [75], "float32_grad": [75], "float64_grad": [75]}


def test_every_variant_is_built():
    assert set(ARCHITECTURES) == set(VARIANTS)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", MODULES)
def test_cross_compiles(name, variant, tmp_path):
    module = wp.get_module(getattr(KernelSet(variant), name).__name__)
    assert module.kernels
    cubins = wp.compile_aot_module(module, arch=ARCHITECTURES[variant], module_dir=tmp_path, use_ptx=False)
    names = [path.name.partition(".sm")[2] for path in cubins]
    assert names == [f"{architecture}.cubin" for architecture in ARCHITECTURES[variant]]
    assert all(path.read_bytes()[:4] == b"\x7fELF" for path in cubins)
