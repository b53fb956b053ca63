"""Kernels compiled before they are needed: once per machine, or ahead of time for GPUs that are elsewhere."""

import contextlib
import pkgutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import warp as wp

from .. import kernels
from ..kernels import KernelSet
from .extra import needed


def kernel_modules(variant: str) -> list[Any]:
    """All Warp modules of a variant that have kernels."""
    names = sorted(info.name for info in pkgutil.iter_modules(kernels.__path__))
    modules = [wp.get_module(getattr(KernelSet(variant), name).__name__) for name in names]
    return [module for module in modules if module.kernels]


def compile_here(variants: Sequence[str], device: str | None = None) -> int:
    """Compiles kernels for a device of this machine, or for all of them, or takes them from the cache.

    Returns the number of modules.

    Processes wait for each other: the first one compiles, the others find its work.
    """
    modules = [module for variant in variants for module in kernel_modules(variant)]
    with _one_at_a_time():
        wp.force_load(device=None if device is None else wp.get_device(device), modules=modules)
    return len(modules)


def compile_ahead(variants: Sequence[str], architectures: Sequence[int]) -> list[Path]:
    """Compiles kernels for GPUs that this machine need not have, into the kernel cache.

    Args:
        variants: see :data:`warpcloth.kernels.VARIANTS`.
        architectures: compute capabilities, e.g. 90 for sm_90.

    Returns:
        The binaries, one for each module and architecture.
    """
    files: list[Path] = []
    with _one_at_a_time():
        for variant in variants:
            for module in kernel_modules(variant):
                files += wp.compile_aot_module(module, arch=list(architectures), use_ptx=False)
    return files


def cache_folder() -> Path:
    """Where Warp keeps compiled kernels."""
    wp.init()
    return Path(str(wp.config.kernel_cache_dir))


@contextlib.contextmanager
def _one_at_a_time() -> Iterator[None]:
    folder = cache_folder()
    folder.mkdir(parents=True, exist_ok=True)
    with needed("filelock").FileLock(folder / ".warpcloth.lock"):
        yield
