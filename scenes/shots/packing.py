"""Whether a stage can be packed into a .usdz file with all that it refers to."""

import os

from pxr import Ar, Sdf, Usd, UsdUtils

from warpcloth.errors import UsdError

from ..usd.failures import as_usd_error, quietly


def refuse_unpackable(stage: Usd.Stage, file: str, package: str) -> None:
    """Refuses a stage that refers to files without which OpenUSD makes no package, such as textures.

    Args:
        stage: any stage that is in a file.
        file: name of the stage, for messages.
        package: name of the package, for messages.

    Raises:
        UsdError: naming the first of these files.
    """
    with as_usd_error(f"Cannot write {package}"), quietly():
        _, assets, unresolved = UsdUtils.ComputeAllDependencies(Sdf.AssetPath(stage.GetRootLayer().realPath))
    missing = sorted({*filter(_is_needed, unresolved), *filter(os.path.isdir, assets)})
    if not missing:
        return
    others = len(missing) - 1
    more = f" and {others} more file{'s' if others > 1 else ''}" if others else ""
    fault, them = ("there are no such files", "them") if others else ("there is no such file", "it")
    rule = f"put {them} there, or write .usda or .usdc instead"
    raise UsdError(f"Cannot write {package}: {file} refers to {missing[0]}{more}, and {fault}; {rule}.")


def _is_needed(path: str) -> bool:
    """Not layers, say of a variant that is not chosen, and not what lacks in a package: OpenUSD packs without them."""
    package, inside = Ar.SplitPackageRelativePathOuter(path)
    return not os.path.isfile(package) if inside else Sdf.FileFormat.FindByExtension(path) is None
