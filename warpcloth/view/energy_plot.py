"""The energies of the last seconds, plotted on a page."""

from typing import Any

import numpy as np

from .server import viser

COLORS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#8c564b", "#17becf", "#7f7f7f")


class EnergyPlot:
    """A folder of the panel with a plot, once there is something to plot.

    Args:
        server: of the page.
    """

    def __init__(self, server: Any):
        self._server = server
        self._folder = server.gui.add_folder("Energy [J]")
        with self._folder:
            self._plot: Any = server.gui.add_markdown("after a few frames")
        self._names: list[str] = []

    def show(self, energies: dict[str, np.ndarray]) -> None:
        """Plots energies [J] by name over ``time`` [s], shape [k] each; those that are nothing are left out."""
        if len(energies.get("time", ())) < 2:
            return
        names = [name for name in energies if name != "time" and np.abs(energies[name]).max() > 1e-12]
        data = (energies["time"], *(energies[name] for name in names))
        if names == self._names:
            self._plot.data = data
            return
        self._names = names
        lines = zip(names, COLORS, strict=False)
        uplot = viser().uplot
        series = [uplot.Series(label=name, stroke=color, width=1.5) for name, color in lines]
        self._plot.remove()
        with self._folder:
            self._plot = self._server.gui.add_uplot(data, (uplot.Series(label="t [s]"), *series), aspect=1.6)
