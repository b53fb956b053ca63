"""``warpcloth compile``: kernels before they are needed."""

import re
from typing import Annotated

import typer

from .. import validate
from ..errors import InputError
from .report import Report
from .terminal import messages, start_warp

Arch = Annotated[
    str | None,
    typer.Option("--arch", metavar="80,90,…", help="GPUs to compile for, by compute capability; none need be here."),
]
Precision = Annotated[str, typer.Option(help="float32 or float64.")]
Gradients = Annotated[bool, typer.Option("--gradients", help="The kernels with adjoints, too.")]


def command(arch: Arch = None, precision: Precision = "float32", gradients: Gradients = False) -> Report:
    """Compile all kernels into the kernel cache: for this machine's devices, and for the GPUs asked for."""
    from ..batch.compilation import cache_folder, compile_ahead, compile_here

    validate.choice(precision, ("float32", "float64"), "precision")
    variants = [precision, *([f"{precision}_grad"] if gradients else [])]
    start_warp()
    architectures = _architectures(arch)
    messages().print(f"Compiling {', '.join(variants)} …")
    modules = compile_here(variants)
    files = compile_ahead(variants, architectures) if architectures else []
    facts = {"cache": cache_folder(), "variants": variants, "modules": modules, "architectures": architectures}
    text = f"{modules} modules for this machine, {len(files)} binaries for GPUs that need not be here"
    return Report(facts | {"files": files}, f"{text}\n  in {cache_folder()} (set by WARP_CACHE_PATH)")


def _architectures(text: str | None) -> list[int]:
    """``"sm_80,90"`` as [80, 90]."""
    import warp as wp

    if text is None:
        return []
    known = sorted(wp.get_cuda_supported_archs())  # none where Warp comes without CUDA's compiler
    if not known:
        raise InputError("This Warp cannot compile for GPUs, as it comes without CUDA; leave --arch out.")
    found = []
    for word in map(str.strip, text.split(",")):
        match = re.fullmatch(r"(?:sm_?)?([0-9]{2,3})", word)
        if match is None or int(match[1]) not in known:
            listed = ", ".join(map(str, known))
            raise InputError(f"{word!r} is not a compute capability that Warp compiles for; known are {listed}.")
        found.append(int(match[1]))
    return found
