"""Scenes one after the other, each watched; as one dictionary ready for JSON."""

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from warpcloth.scenes import load_scene
from warpcloth.scenes.schema import Scene

import warpcloth as wc
from warpcloth import validate
from warpcloth.errors import InputError

from ..machine import describe_machine
from .random_scene import LAST_SEED, random_scene
from .resolution import with_resolution
from .watch import DEEPEST, watch


@dataclass(frozen=True)
class Case:
    """A scene to watch, and the arguments of ``warpcloth bench contact`` that lead to it and to no other."""

    scene: Scene
    arguments: str


def random_cases(
    seed: int,
    count: int,
    schemes: Iterable[str] | None = None,
    frames: int | None = None,
    resolution: int | None = None,
) -> list[Case]:
    """Random scenes of seeds from ``seed`` on, with their own integrators or with each of ``schemes``.

    Args:
        seed: the first. count: how many scenes. schemes: integrators. frames: so many of each scene.
        resolution: each cloth has about as many vertices as a square grid with so many along a side.

    Raises:
        InputError: a number out of range, an unknown scheme.
    """
    seed = validate.integer(seed, "seed", minimum=0, maximum=LAST_SEED)
    count = validate.integer(count, "count", minimum=1, maximum=LAST_SEED + 1 - seed)
    chosen = _schemes(schemes)
    scenes = [(random_scene(number), f"--seed {number} --count 1") for number in range(seed, seed + count)]
    return _cases(scenes, chosen, frames, resolution)


def given_cases(
    names: Sequence[str], schemes: Iterable[str] | None = None, frames: int | None = None, resolution: int | None = None
) -> list[Case]:
    """The scenes of these names or paths; other arguments as for :func:`random_cases`.

    Raises:
        InputError: an unknown scene or scheme, an invalid scene, a number out of range.
    """
    return _cases([(load_scene(name), f"--scene {name}") for name in names], _schemes(schemes), frames, resolution)


def run_cases(
    cases: Sequence[Case],
    seconds: float | None = None,
    kept: Sequence[dict[str, Any]] = (),
    progress: Callable[[dict[str, Any], dict[str, Any]], None] = lambda results, row: None,
) -> dict[str, Any]:
    """Watches all cases.

    Args:
        cases: what to watch.
        seconds: processor time for one scene [s]; what is not finished by then counts as unfinished.
        kept: rows of an earlier run, of these cases or others; those that are among them are not run again.
        progress: called after each case with the results so far, all kept ones included, and the case's row.

    Returns:
        ``date``, ``machine``, ``rows`` (an ``Outcome`` each, with how to see it again) and ``summary``.
    """
    rows = {row["arguments"]: row for row in kept}
    others = [row for arguments, row in rows.items() if arguments not in {case.arguments for case in cases}]
    for case in cases:
        if case.arguments not in rows:
            rows[case.arguments] = _watched(case, seconds)
        progress(_results([*others, *_in_order(cases, rows)]), rows[case.arguments])
    return _results([*others, *_in_order(cases, rows)])


def kept_rows(path: Path) -> list[dict[str, Any]]:
    """The finished rows of an earlier run; none where there is no such file.

    Raises:
        InputError: the file is not the result of an earlier run.
    """
    if not path.is_file():
        return []
    try:
        results = json.loads(path.read_text(encoding="utf-8"))
        return [row for row in results["rows"] if row["arguments"] and row["finished"]]
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(f"{path} is not the result of `warpcloth bench contact`, so nothing can be resumed.") from None


def summarise(rows: Iterable[dict[str, Any]]) -> dict[str, int]:
    """How many of the cases are how; ``clean`` ones are finished and nothing failed, locked or not."""
    rows = list(rows)
    return {
        "scenes": len(rows),
        "clean": sum(row["finished"] and not row["failures"] for row in rows),
        "crossing": sum(row["intersections"] + row["obstacle_intersections"] > 0 for row in rows),
        "penetrating": sum(row["penetration_m"] > DEEPEST for row in rows),
        "stopped": sum(row["stopped"] for row in rows),
        "torn": sum(row["torn"] for row in rows),
        "unfinished": sum(not row["finished"] and not row["stopped"] for row in rows),
        "locked": sum(row["locked"] for row in rows),
        "pinched": sum(row["pinched"] > 0 for row in rows),
        "frames": sum(row["frames"] for row in rows),
    }


def _in_order(cases: Sequence[Case], rows: dict[str, dict[str, Any]]) -> list[dict[str, Any]]:
    return [rows[case.arguments] for case in cases if case.arguments in rows]


def _watched(case: Case, seconds: float | None) -> dict[str, Any]:
    facts = {"scene": case.scene.name, "title": case.scene.title, "integrator": case.scene.simulation.integrator}
    return {**facts, "arguments": case.arguments, **watch(case.scene, seconds).as_dict()}


def _results(rows: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "benchmark": "contact",
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": describe_machine(),
        "summary": summarise(rows),
        "rows": rows,
    }


def _schemes(names: Iterable[str] | None) -> list[str | None]:
    """Integrators, or a None for a scene's own."""
    known = wc.integrators()
    return [None] if names is None else [validate.choice(name, known, "integrator") for name in names]


def _cases(
    scenes: list[tuple[Scene, str]], schemes: list[str | None], frames: int | None, resolution: int | None
) -> list[Case]:
    cases = []
    for original, name in scenes:
        scene, arguments = original.changed({"simulation.contact": "all"}), name
        if resolution is not None:
            scene, arguments = with_resolution(scene, resolution), f"{arguments} --resolution {resolution}"
        if frames is not None:
            scene, arguments = scene.changed({"frames": frames}), f"{arguments} --frames {frames}"
        for scheme in schemes:
            if scheme is None:
                cases.append(Case(scene, arguments))
                continue
            other = {"simulation.integrator": scheme, "simulation.integrator_options": {}}
            cases.append(Case(scene.changed(other), f"{arguments} --integrators {scheme}"))
    return cases
