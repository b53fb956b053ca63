"""Whether a USD stage has all that it refers to. This module imports ``pxr``; import it only to read USD."""

from pxr import Sdf, Usd


def incomplete(stage: Usd.Stage, prim: str | None = None) -> str | None:
    """What the stage refers to and OpenUSD did not find or could not use; None: it has everything.

    Args:
        stage: any stage.
        prim: path of a prim; then nothing is said of what is neither above nor below it. What is no such path stands
            for the whole stage.
    """
    if prim is not None and stage.GetCompositionErrors() and _is_path(prim):
        stage = Usd.Stage.OpenMasked(stage.GetRootLayer(), Usd.StagePopulationMask([prim]))
    errors = stage.GetCompositionErrors()
    if not errors:
        return None
    text = " ".join(str(errors[0]).split()).rstrip(".")
    more = f" (and {len(errors) - 1} more such problems)" if len(errors) > 1 else ""
    return f"{text[:1].lower()}{text[1:]}{more}"


def _is_path(prim: str) -> bool:
    return Sdf.Path.IsValidPathString(prim) and Sdf.Path(prim).IsAbsolutePath() and Sdf.Path(prim).IsPrimPath()
