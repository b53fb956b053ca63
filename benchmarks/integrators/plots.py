"""Results as figures, one file each."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .families import FAMILIES
from .style import SETTINGS, legend, looks, pyplot

PATCH = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0}
WORST = 2.0  # relative errors beyond this are left out: nothing is right there
LOWEST_ENERGY, HIGHEST_ENERGY = 1e-9, 3.0  # ends of the energy axis


def write_plots(results: dict[str, Any], folder: Path) -> list[Path]:
    """All figures of a run as PNG files in ``folder``; their paths.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    plt = pyplot()
    schemes, written = results["schemes"], []
    with plt.rc_context(SETTINGS):
        for name, found in results["problems"].items():
            written.append(_save(plt, _work_precision(plt, found, schemes), folder / f"work_precision_{name}.png"))
        for name, found in results["drift"].items():
            written.append(_save(plt, _energy(plt, found, schemes), folder / f"energy_{name}.png"))
        if results["stability"]:
            written.append(_save(plt, _stability(plt, results["stability"], schemes), folder / "stability.png"))
        if results["iterations"]:
            written.append(_save(plt, _iterations(plt, results["iterations"]), folder / "iterations.png"))
    return written


def _save(plt: Any, figure: Any, path: Path) -> Path:
    figure.savefig(path, bbox_inches="tight", facecolor="white")
    plt.close(figure)
    return path


def _work_precision(plt: Any, found: dict[str, Any], schemes: dict[str, Any]) -> Any:
    figure, axes = plt.subplots(1, 3, figsize=(15, 5.2), sharey=True, layout="constrained")
    work = "force evaluations and solver iterations"
    columns = (("step", "step [ms]", 1e3), ("work", work, 1.0), ("wall_s", "wall time [ms]", 1e3))
    shown = []
    for name, style in looks(schemes).items():
        runs = [run for run in found["schemes"].get(name, {"runs": []})["runs"] if run["position_error"] < WORST]
        shown += [name] if runs else []
        for ax, (column, _, scale) in zip(axes, columns, strict=True):
            ax.loglog([scale * run[column] for run in runs], [run["position_error"] for run in runs], **style)
    for ax, (_, label, _) in zip(axes, columns, strict=True):
        ax.set_xlabel(label)
        _mark_uncertainty(ax, found["reference"]["uncertainty"])
    _mark_real_time(axes[2], 1e3 * found["end"])
    axes[0].invert_xaxis()
    axes[0].set_ylabel("relative error of positions")
    _slopes(axes[0], schemes, shown)
    figure.suptitle(f"{found['title']}: error at {found['end']:g} s", fontsize=15)
    legend(figure, shown)
    return figure


def _mark_uncertainty(ax: Any, uncertainty: float) -> None:
    """Grey where the reference itself is not known."""
    bottom, top = ax.get_ylim()
    if bottom < uncertainty < top:
        ax.axhspan(bottom, uncertainty, color="#EEEEEE", zorder=0)
    ax.set_ylim(bottom, top)


def _mark_real_time(ax: Any, milliseconds: float) -> None:
    """A line where a run takes as long as what it simulates."""
    left, right = ax.get_xlim()
    if left < milliseconds < right:
        ax.axvline(milliseconds, color="#999999", linewidth=1.0)
        ax.annotate(
            "real time", (milliseconds, 1.01), xycoords=("data", "axes fraction"), fontsize=9, color="#777777",
            ha="center", va="bottom",
        )  # fmt: skip


def _slopes(ax: Any, schemes: dict[str, Any], shown: Sequence[str]) -> None:
    """Thin grey lines with the slopes of the orders that are there, from the upper left corner; numbers at their ends,
    where they have spread the most."""
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()  # the axis of steps runs from large to small
    orders = sorted({schemes[name]["order"] for name in shown} - {0})
    lowest = bottom * (top / bottom) ** 0.02
    for order in orders:
        x = np.array([left, right])
        ax.plot(x, 0.5 * top * (x / left) ** order, color="#AAAAAA", linewidth=0.9, linestyle=":", zorder=1)
        height = max(lowest, 0.5 * top * (right / left) ** order)
        place = left * (height / (0.5 * top)) ** (1.0 / order)
        ax.annotate(str(order), (place, height), color="#777777", fontsize=9, ha="right", va="bottom", bbox=PATCH)
    if orders:
        note = {"xycoords": "axes fraction", "ha": "right", "va": "bottom", "color": "#777777", "fontsize": 9}
        ax.annotate("dotted: slopes of orders " + ", ".join(map(str, orders)), (1.0, 1.01), **note)
    ax.set_xlim(left, right)
    ax.set_ylim(bottom, top)


def _energy(plt: Any, found: dict[str, Any], schemes: dict[str, Any]) -> Any:
    """Envelopes of |change|, which stay level where energy only oscillates, in a panel for each family."""
    present = [kind for kind in FAMILIES if any(traits["family"] == kind for traits in schemes.values())]
    size = (3.9 * len(present) + 1.0, 4.8)
    figure, axes = plt.subplots(1, len(present), figsize=size, sharey=True, layout="constrained", squeeze=False)
    for name, style in looks(schemes).items():
        row, ax = found["schemes"][name], axes[0][present.index(schemes[name]["family"])]
        envelope = _envelope(row["energy"])
        ax.semilogy(row["times"], envelope, **{**style, "marker": None, "linestyle": "-"})
        end = {"marker": _tendency(row), "markersize": 9, "clip_on": False, "zorder": 5}
        if LOWEST_ENERGY <= envelope[-1] <= HIGHEST_ENERGY:
            ax.plot(row["times"][-1], envelope[-1], **{**style, **end, "label": None})
    for ax, kind in zip(axes[0], present, strict=True):
        ax.set(ylim=(LOWEST_ENERGY, HIGHEST_ENERGY), xlim=(0.0, found["end"]), title=kind, xlabel="time [s]")
    axes[0][0].set_ylabel("|change of total energy|, relative")
    figure.suptitle(
        f"{found['title']}, undamped, all steps {1e3 * found['step']:g} ms (▲ gains, ▼ loses energy)", fontsize=15
    )
    legend(figure, schemes)
    return figure


def _envelope(energy: np.ndarray) -> np.ndarray:
    """Largest |change| within a twentieth of the run."""
    size = np.nan_to_num(np.abs(energy), nan=1e9, posinf=1e9)
    width = max(1, len(size) // 20)
    return np.array([size[max(0, k - width) : k + 1].max() for k in range(len(size))])


def _tendency(row: dict[str, Any]) -> str:
    """Marker: up or down where the mean at the end is most of the change, else a dot."""
    if abs(row["trend"]) < 0.4 * row["largest"]:
        return "o"
    return "^" if row["trend"] > 0.0 else "v"


def _stability(plt: Any, systems: dict[str, Any], schemes: dict[str, Any]) -> Any:
    figure, axes = plt.subplots(
        1, len(systems), figsize=(13, 1.4 + 0.36 * len(schemes)), sharey=True, layout="constrained", squeeze=False
    )
    styles = looks(schemes)
    names = [name for name in styles if not schemes[name]["adaptive"]][::-1]
    titles = {"spring": "one spring, damping ratio 0.05", "sheet": "sheet of 9 × 9 vertices"}
    for ax, (system, rows) in zip(axes[0], systems.items(), strict=True):
        finite = [rows[name]["omega_dt"] for name in names if 0.0 < rows[name]["omega_dt"] < math.inf]
        right = 4.0 * max([4.0, *finite])
        for place, name in enumerate(names):
            _bar(ax, place, rows[name], styles[name]["color"], right)
        ax.set_ylim(-0.6, len(names) - 0.4)
        ax.set_xscale("log")
        ax.set_xlim(0.03, right)
        ax.set_yticks(range(len(names)), names)
        ax.grid(axis="y", visible=False)
        ax.set_xlabel(r"largest stable step $\omega_{\max}\,\Delta t$")
        ax.set_title(titles[system])
    figure.suptitle("Stability: bars measured by bisection, black lines from theory", fontsize=15)
    return figure


def _bar(ax: Any, place: int, row: dict[str, Any], color: str, right: float) -> None:
    """A bar to the measured limit with its value; to the edge, with an arrow, where there is none."""
    limit = row["omega_dt"]
    ax.barh(place, min(limit, right), color=color, height=0.66)
    theory = row["omega"] * row["theory"]
    if math.isfinite(limit):
        ax.text(max(limit, 0.033) * 1.06, place, f"{limit:.3f}", va="center", fontsize=9.5)
    else:
        ax.text(right * 0.93, place, "no limit ▸", va="center", ha="right", fontsize=9.5, color="white")
    if 0.0 < theory < right:
        ax.plot([theory, theory], [place - 0.42, place + 0.42], color="black", linewidth=2.2, solid_capstyle="butt")


def _iterations(plt: Any, found: dict[str, Any]) -> Any:
    figure, axes = plt.subplots(1, 2, figsize=(11, 5.0), sharey=True, layout="constrained")
    styles = looks(found["schemes"])
    for name, rows in found["schemes"].items():
        errors = [row["error"] for row in rows]
        axes[0].loglog([row["iterations"] for row in rows], errors, **styles[name])
        axes[1].loglog([1e3 * row["wall_s"] for row in rows], errors, **styles[name])
    axes[0].set_xlabel("iterations in the step")
    axes[1].set_xlabel("wall time of the step [ms]")
    axes[0].set_ylabel("distance from Newton's solution, relative")
    figure.suptitle(f"{found['title']}: one implicit step of {1e3 * found['step']:.3g} ms", fontsize=15)
    legend(figure, found["schemes"])
    return figure
