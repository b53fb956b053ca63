"""Results as pictures."""

from pathlib import Path
from typing import Any

from ..errors import MissingExtraError
from .result import AREA, POINTS, Panel, Result

COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS = "osD^vP"
SETTINGS = {
    "figure.dpi": 100,
    "savefig.dpi": 150,
    "font.size": 11,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
}


def pyplot() -> Any:
    """Matplotlib's figure module, drawing to files.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    try:
        import matplotlib
    except ImportError as error:
        raise MissingExtraError(
            "Plots need matplotlib; install it with `pip install 'warpcloth[lab]'`, or ask for --no-plots."
        ) from error
    matplotlib.use("agg", force=False)
    import matplotlib.pyplot as plt

    return plt


def write_plot(result: Result, folder: Path) -> list[Path]:
    """The panels of a result in one PNG file; its path, or nothing if there is nothing to draw."""
    if not result.panels:
        return []
    plt, path = pyplot(), folder / f"{result.test}.png"
    with plt.rc_context(SETTINGS):
        figure, axes = plt.subplots(
            1, len(result.panels), figsize=(6.2 * len(result.panels), 4.8), squeeze=False, layout="constrained"
        )
        for ax, panel in zip(axes[0], result.panels, strict=True):
            draw(ax, panel)
        figure.suptitle(f"{result.title}: {result.setup['fabric']}", fontsize=13)
        figure.savefig(path, facecolor="white")
        plt.close(figure)
    return [path]


def draw(ax: Any, panel: Panel) -> None:
    """One panel: references as lines, measurements as points; all curves without a label look the same."""
    for number, curve in enumerate(panel.curves):
        number = number if curve.label else int(curve.style == POINTS)
        color = COLORS[number % len(COLORS)]
        if curve.style == POINTS:
            look = {"marker": MARKERS[number % len(MARKERS)], "markersize": 6 if curve.label else 4}
            ax.plot(curve.x, curve.y, linestyle="none", color=color, label=curve.label, markeredgecolor="white", **look)
        elif curve.style == AREA:
            ax.fill(curve.x, curve.y, color="#555555", alpha=0.6, label=curve.label)
        else:
            ax.plot(curve.x, curve.y, "-", color=color, label=curve.label, linewidth=1.8)
    for axis in panel.log:
        getattr(ax, f"set_{axis}scale")("log")
    if panel.equal:
        ax.set_aspect("equal")
    ax.set_xlabel(panel.xlabel)
    ax.set_ylabel(panel.ylabel)
    if any(curve.label for curve in panel.curves):
        ax.legend()
