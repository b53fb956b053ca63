"""The schema of sweep files."""

import math
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from ..scenes.schema.table import Choice, Table, choice, field
from ..scenes.schema.values import Number, Rows, Text, Vector, positive, refuse

MOST_SAMPLES = 10_000_000
ANY = Number("", -1e12, 1e12)
SHARE = positive("", 1e12)
Bounds = Vector("low high", ANY)


class ParameterTable(Choice):
    """A field of the scene that differs between samples; say how in exactly one way."""

    path: Annotated[str, Text(r"[^\s.]+(\.[^\s.]+)*", "the dotted path of a field, e.g. 'cloth.0.position.2'", 500)] = (
        field(..., "Field of the scene, as for `--set`: `cloth.0.fabric`, `obstacle.ball.radius`, `seed`.")
    )
    values: Annotated[list[Any], Field(min_length=1, max_length=1_000_000)] | None = choice(
        "These values, equally often on average; whole tables, too, such as an obstacle, or names of fabrics."
    )
    range: Annotated[tuple[float, float, float], Vector("first last count", ANY)] | None = choice(
        "So many values from first to last, evenly spaced."
    )
    uniform: Annotated[tuple[float, float], Bounds] | None = choice("Uniformly distributed between two bounds.")
    log_uniform: Annotated[tuple[float, float], Vector("low high", SHARE)] | None = choice(
        "So distributed that the logarithm is uniform; for stiffnesses and sizes."
    )
    normal: Annotated[tuple[float, float], Vector("mean deviation", ANY)] | None = choice(
        "Normally distributed, at most four standard deviations from the mean."
    )
    glob: Annotated[str, Text("", "a pattern of file names such as 'meshes/*.obj'", 4096)] | None = choice(
        "Files that match a pattern, relative to the sweep file; each is a value, in the order of their names."
    )
    weights: Annotated[tuple[float, ...], Rows(SHARE)] | None = field(
        None, "How often each of `values` comes, relative to others."
    )
    whole: bool = field(False, "Whether to round what is drawn, or a range, to whole numbers.")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        wrong = next((i for i, value in enumerate(self.values or ()) if not _is_finite(value)), None)
        if wrong is not None:
            raise refuse(f"must have only finite numbers among its values, and item {wrong} is not")
        bounds = self.uniform or self.log_uniform
        if bounds is not None and not bounds[0] < bounds[1]:
            raise refuse(f"must have a lower bound below the upper one, not [{bounds[0]:g}, {bounds[1]:g}]")
        if self.range is not None and not (1 <= self.range[2] <= MOST_SAMPLES and self.range[2].is_integer()):
            most = f"from 1 to {MOST_SAMPLES:,}, not {self.range[2]:g}"
            raise refuse(f"must have a whole number of values in its range, {most}")
        if self.normal is not None and self.normal[1] < 0.0:
            raise refuse(f"must have a standard deviation of 0 or more, not {self.normal[1]:g}")
        if self.weights is not None and len(self.weights) != len(self.values or ()):
            raise refuse(f"must have as many weights as values, not {len(self.weights)} for {len(self.values or ())}")
        if self.whole and self.chosen in ("values", "glob"):
            raise refuse(f"must not have 'whole' beside {self.chosen!r}, which are taken as they are; leave it out")
        return self


def _is_finite(value: Any) -> bool:
    """Whether a TOML value is, or holds, no number that JSON does not have."""
    if isinstance(value, dict | list):
        return all(map(_is_finite, value.values() if isinstance(value, dict) else value))
    return not isinstance(value, float) or math.isfinite(value)


class LimitsTable(Table):
    """What a single sample may take; one that takes more fails, and the others go on."""

    seconds: Annotated[float, positive("s", 1e7)] | None = field(None, "Wall time.")
    memory_mib: Annotated[float, positive("MiB", 1e9)] | None = field(
        None, "Memory of the process that simulates it; by default all but a tenth of the machine's."
    )


class SweepTable(Table):
    """A sweep: a scene, what differs between samples, how many there are, and what is kept of each."""

    title: Annotated[str, Text(most=200)] = field("", "One line for people.")
    scene: Annotated[str, Text("", "the name of a bundled scene or the path of a scene file", 4096)] = field(
        ..., "Bundled scene, or scene file relative to the sweep file."
    )
    count: Annotated[int, Number("", 1, MOST_SAMPLES, whole=True)] | None = field(
        None, "Number of samples; by default once each combination of a grid."
    )
    design: Literal["random", "sobol", "latin_hypercube", "grid"] = field(
        "random",
        "How parameters are combined: at random, in a scrambled Sobol sequence, in a Latin hypercube, or all values "
        "with all others (distributions are then drawn at random).",
    )
    seed: Annotated[int, Number("", 0, 2**32 - 1, whole=True)] = field(
        0, "Seed of all draws; each scene gets a seed of its own from it."
    )
    outputs: list[Literal["pose", "frames", "strain", "preview"]] = field(
        ["pose"],
        "What is kept besides scene and metrics: last frame, all frames, strain of each spring (of woven "
        "triangles, too), a picture.",
    )
    stop_at_rest: bool = field(True, "Whether a sample ends when its cloth rests, even before its last frame.")
    check: bool = field(
        False, "Whether what was written is checked as by `warpcloth check`; a sample that fails is failed."
    )
    limits: LimitsTable = field(LimitsTable(), "What a sample may take.")
    parameter: list[ParameterTable] = Field([], description="What differs between samples.", max_length=1000)

    @model_validator(mode="after")
    def _counted(self) -> Self:
        if self.design != "grid" and self.count is None:
            raise refuse("must have a count unless its design is 'grid'")
        posed = bool({"pose", "frames"} & set(self.outputs))
        if "preview" in self.outputs and not posed:
            raise refuse("must have 'pose' or 'frames' among its outputs for a 'preview' to show")
        if self.check and not posed:
            raise refuse("must have 'pose' or 'frames' among its outputs for its 'check' to look at")
        paths = [parameter.path for parameter in self.parameter]
        twice = next((path for path in paths if paths.count(path) > 1), None)
        if twice is not None:
            raise refuse(f"must have only one [[parameter]] for {twice!r}")
        for number, path in enumerate(paths):  # they apply in this order
            whole = next((later for later in paths[number:] if path.startswith(f"{later}.")), None)
            if whole is not None:
                raise refuse(f"must have its [[parameter]] for {path!r} after that for {whole!r}, which would undo it")
        return self
