"""``warpcloth compile``: kernels before they are needed."""

import re
from typing import Annotated

import typer

from .. import validate
from ..errors import InputError
from .report import Report
from .terminal import messages, start_warp

OLDEST, NEWEST = 75, 200  # compute capabilities that are plausible at all

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
    architectures = _architectures(arch)
    variants = [precision, *([f"{precision}_grad"] if gradients else [])]
    start_warp()
    messages().print(f"Compiling {', '.join(variants)} …")
    modules = compile_here(variants)
    files = compile_ahead(variants, architectures) if architectures else []
    facts = {"cache": cache_folder(), "variants": variants, "modules": modules, "architectures": architectures}
    text = f"{modules} modules for this machine, {len(files)} binaries for GPUs that need not be here"
    return Report(facts | {"files": files}, f"{text}\n  in {cache_folder()} (set by WARP_CACHE_PATH)")


def _architectures(text: str | None) -> list[int]:
    """``"sm_80,90"`` as [80, 90]."""
    found = []
    for word in (text or "").split(","):
        match = re.fullmatch(r"(?:sm_?)?([0-9]{2,3})", word.strip())
        if match and OLDEST <= int(match[1]) <= NEWEST:
            found.append(int(match[1]))
        elif text is not None:
            raise InputError(
                f"{word.strip()!r} is not a compute capability that Warp compiles for; write for example --arch 80,90."
            )
    return found
