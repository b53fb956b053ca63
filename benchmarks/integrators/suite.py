"""The whole benchmark: all schemes on all problems, in one run, as one dictionary ready for JSON."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any

import warpcloth as wc
from warpcloth import validate

from ..machine import describe_machine
from . import energy_drift, iterations, stability_limit
from .families import family
from .problems import PROBLEMS, Problem
from .reference import reference
from .runs import compile_seconds, mean_strain
from .scene import scene_problem
from .work_precision import as_rows, observed_order, sweep

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Effort:
    """How much time [s] each part may take, per scheme; references per problem.

    Attributes:
        sweep: of the work–precision runs. reference: of a reference solution. drift: of a long run, drift_share of its
        full duration. iterations: of one scheme's approach to Newton. halvings: most halvings of a stable step.
    """

    sweep: float = 0.8
    reference: float = 8.0
    drift: float = 4.0
    drift_share: float = 1.0
    iterations: float = 3.0
    halvings: int = 16


QUICK = Effort(sweep=0.3, reference=1.0, drift=0.5, drift_share=0.2, iterations=0.5, halvings=8)


@dataclass(frozen=True, eq=False)
class Selection:
    """What is to be run; made by :func:`select` or :func:`select_scene`.

    ``properties`` says whether stability and the approach to Newton's step, which are no problem's own, belong to it.
    """

    schemes: tuple[str, ...]
    problems: tuple[Problem, ...]
    effort: Effort
    properties: bool = True


def select(
    schemes: Iterable[str] | None = None, problems: Iterable[str] | None = None, effort: Effort | None = None
) -> Selection:
    """The named schemes and problems; all where None.

    Raises:
        InputError: an unknown name; the sentence lists what there is and proposes the closest.
    """
    chosen = [validate.choice(name, PROBLEMS, "problem") for name in (PROBLEMS if problems is None else problems)]
    return Selection(_schemes(schemes), tuple(PROBLEMS[name]() for name in _once(chosen)), effort or Effort())


def select_scene(
    scene: str, schemes: Iterable[str] | None = None, effort: Effort | None = None, frames: int | None = None
) -> Selection:
    """The named schemes (all where None) on a scene: its name or path, and how many of its frames.

    Raises:
        InputError: an unknown scheme or scene, an invalid scene, frames out of range.
    """
    return Selection(_schemes(schemes), (scene_problem(scene, frames),), effort or Effort(), properties=False)


def _schemes(names: Iterable[str] | None) -> tuple[str, ...]:
    known = wc.integrators()
    return _once([validate.choice(name, known, "integrator") for name in (known if names is None else names)])


def run_suite(selection: Selection, progress: Progress = lambda text: None) -> dict[str, Any]:
    """All measurements of a selection.

    Args:
        selection: schemes, problems and effort.
        progress: called with a few words before each measurement.

    Returns:
        ``date``, ``machine``, ``effort``, ``schemes`` (traits by name), ``problems`` (work–precision), ``drift``,
        ``stability``, ``iterations``; times in seconds, errors relative.
    """
    known = wc.integrators()
    traits = {name: {**asdict(known[name]), "family": family(known[name])} for name in selection.schemes}
    return {
        "benchmark": "integrators",
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": describe_machine(),
        "effort": asdict(selection.effort),
        "schemes": traits,
        "problems": {problem.name: _precision(problem, selection, progress) for problem in selection.problems},
        "drift": {p.name: _drift(p, selection, progress) for p in selection.problems if p.drift_end > 0.0},
        "stability": _stability(selection.schemes, progress) if selection.properties else {},
        "iterations": _iterations(selection, progress) if selection.properties else {},
    }


def measurements(selection: Selection) -> int:
    """How often :func:`run_suite` will report progress."""
    per_scheme = len(selection.problems) + sum(p.drift_end > 0.0 for p in selection.problems)
    general = len(_iterated(selection.schemes)) + len(stability_limit.SYSTEMS) * len(_fixed(selection.schemes))
    return len(selection.schemes) * per_scheme + len(selection.problems) + general * selection.properties


def _precision(problem: Problem, selection: Selection, progress: Progress) -> dict[str, Any]:
    progress(f"{problem.title}: reference")
    truth = reference(problem, selection.effort.reference)
    known, rows = wc.integrators(), {}
    for name in selection.schemes:
        progress(f"{problem.title}: {name}")
        compile_s = compile_seconds(problem, name)
        runs = sweep(problem, name, truth, selection.effort.sweep, selection.effort.halvings)
        order = None if known[name].adaptive else observed_order(runs, truth)
        rows[name] = {"compile_s": compile_s, "order": order, "runs": as_rows(runs)}
    model = problem.build(True)
    strain = mean_strain(model, truth.solution[0])
    return {
        "title": problem.title,
        "end": problem.end,
        "particles": model.particle_count,
        "springs": model.spring_count,
        "reference": {"method": truth.method, "uncertainty": truth.uncertainty, "strain": strain},
        "schemes": rows,
    }


def _drift(problem: Problem, selection: Selection, progress: Progress) -> dict[str, Any]:
    end = problem.drift_end * selection.effort.drift_share
    rows = {}
    for name in selection.schemes:
        progress(f"{problem.title}, energy: {name}")
        found = energy_drift.drift(problem, name, selection.effort.drift, end)
        rows[name] = {**asdict(found), "largest": found.largest, "trend": found.trend}
    return {"title": problem.title, "end": end, "step": problem.drift_step, "schemes": rows}


def _stability(schemes: Sequence[str], progress: Progress) -> dict[str, Any]:
    rows: dict[str, Any] = {system: {} for system in stability_limit.SYSTEMS}
    for system in rows:
        for name in _fixed(schemes):
            progress(f"Largest stable step, {system}: {name}")
            rows[system][name] = stability_limit.as_row(stability_limit.limit(system, name))
    return rows


def _fixed(schemes: Sequence[str]) -> list[str]:
    known = wc.integrators()
    return [name for name in schemes if not known[name].adaptive]


def _iterated(schemes: Sequence[str]) -> list[str]:
    return iterations.iterative_schemes(list(schemes)) if iterations.TRUTH in wc.integrators() else []


def _iterations(selection: Selection, progress: Progress) -> dict[str, Any]:
    names = _iterated(selection.schemes)
    if not names:
        return {}
    problem = PROBLEMS["swinging_cloth"]()
    step, rows = iterations.OneStep(problem), {}
    for name in names:
        progress(f"One implicit step: {name}")
        rows[name] = iterations.as_rows(iterations.approach(step, name, selection.effort.iterations))
    return {"title": problem.title, "step": iterations.STEP, "truth": iterations.TRUTH, "schemes": rows}


def _once(names: list[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(names))
