"""How schemes look in all plots: a colour and a marker each, a line style per family."""

from collections.abc import Iterable
from typing import Any

from warpcloth import integrators
from warpcloth.errors import MissingExtraError

from .families import EXPLICIT, FAMILIES, IMPLICIT, ITERATED, SYMPLECTIC, family

# Hues that stay apart in print and for colour-blind readers, after Okabe and Ito (2008) and Tol (2021).
COLORS = {
    EXPLICIT: ("#888888", "#56B4E9", "#0072B2", "#1B1B6B", "#9467BD", "#17A2A2"),
    SYMPLECTIC: ("#D55E00", "#E69F00", "#8C564B"),
    IMPLICIT: ("#117733", "#66BB55", "#009E73", "#6B8E23", "#004D40", "#A6C34C"),
    ITERATED: ("#CC79A7", "#AA1155", "#7A3B8F", "#EE5599"),
}
LINES = {EXPLICIT: "-", SYMPLECTIC: (0, (6, 1.5)), IMPLICIT: (0, (4, 1.2, 1, 1.2)), ITERATED: (0, (1.2, 1.0))}
MARKERS = "osD^vP*X"
SETTINGS = {
    "figure.dpi": 100,
    "savefig.dpi": 160,
    "font.size": 11,
    "axes.titlesize": 13,
    "axes.labelsize": 12,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.7,
    "lines.markersize": 5.5,
    "legend.frameon": False,
    "legend.fontsize": 10,
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
            "Plots need matplotlib; install it with `pip install 'warpcloth[bench]'`, or ask for --no-plots."
        ) from error
    matplotlib.use("agg", force=False)
    import matplotlib.pyplot as plt

    return plt


def looks(shown: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Keywords of ``Axes.plot`` by scheme, family by family.

    They depend on a scheme's place among all schemes of its family, so that they are the same in every plot.
    """
    found: dict[str, dict[str, Any]] = {}
    known, wanted = integrators(), set(shown)
    for kind in FAMILIES:
        names = [name for name, info in known.items() if family(info) == kind]
        for place, name in [item for item in enumerate(names) if item[1] in wanted]:
            colors = COLORS[kind]
            found[name] = {
                "label": name,
                "color": colors[place % len(colors)],
                "marker": MARKERS[place % len(MARKERS)],
                "linestyle": LINES[kind],
                "markeredgecolor": "white",
                "markeredgewidth": 0.6,
            }
    return found


def legend(figure: Any, shown: Iterable[str]) -> None:
    """One legend to the right of all axes: the schemes that are shown, under the names of their families."""
    from matplotlib.lines import Line2D

    styles, known, handles = looks(shown), integrators(), []
    for kind in FAMILIES:
        members = [name for name in styles if family(known[name]) == kind]
        if members:
            handles.append(Line2D([], [], linestyle="none", label=rf"$\bf{{{kind.replace(' ', '~')}}}$"))
        handles += [Line2D([], [], **styles[name]) for name in members]
    figure.legend(handles=handles, loc="center left", bbox_to_anchor=(1.0, 0.5), handlelength=3.0)
