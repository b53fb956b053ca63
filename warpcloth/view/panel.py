"""The panel beside a simulation: what it says, and what can be changed."""

import functools
from collections.abc import Callable
from typing import Any

from ..fabric_library import fabrics
from ..integrators import integrators
from .energy_plot import EnergyPlot
from .session import Session
from .settings import AS_IN_SCENE
from .snapshot import Snapshot

COLORINGS = ("fabric", "strain", "speed")
PLOT_EVERY = 10  # updates
HELP = """**Drag** the cloth to pull it. **Shift-click** it to pin a point, or to free one.
Drag beside it to turn the view, scroll to zoom.

**P** play or pause · **N** next frame · **R** reset · **V** record · **T** picture"""


class Panel:
    """Buttons, settings and their keys, for a session.

    Args:
        server: of the page. session: what they act on.
        record: begins a recording, or ends it.
        picture, color_by, show_gizmos: what else there is to do, told the event, a coloring, whether.
    """

    def __init__(
        self,
        server: Any,
        session: Session,
        record: Callable[[], None],
        picture: Callable[[Any], None],
        color_by: Callable[[str], None],
        show_gizmos: Callable[[bool], None],
    ):
        self._gui, self._session, self._updates = server.gui, session, 0
        self._loop = server.get_event_loop()
        self._status = server.gui.add_markdown("")
        acts: dict[str, tuple[str, Callable[[Any], None]]] = {
            "Play": ("P", lambda _: session.toggle()),
            "Next frame": ("N", lambda _: session.single_step()),
            "Reset": ("R", lambda _: session.reset()),
            "Record": ("V", lambda _: record()),
            "Picture": ("T", picture),
        }
        self._buttons = {label: self._act(label, key, act) for label, (key, act) in acts.items()}
        self._controls = self._cloth(color_by) | self._world(show_gizmos) | self._solver()
        for name, control in self._controls.items():
            control.on_update(functools.partial(self._changed, name))
        self._plot = EnergyPlot(server)
        server.gui.add_markdown(HELP)

    def _act(self, label: str, key: Any, act: Callable[[Any], None]) -> Any:
        """A button, and a key that does the same."""
        self._gui.add_command(label, hotkey=key).on_trigger(act)
        button = self._gui.add_button(label, hint=key)
        button.on_click(act)
        return button

    def _cloth(self, color_by: Callable[[str], None]) -> dict[str, Any]:
        gui = self._gui
        with gui.add_folder("Cloth"):
            names = (AS_IN_SCENE, *fabrics())
            controls = {"fabric": gui.add_dropdown("fabric", names, initial_value=self._session.first.fabric)}
            for name in ("stiffness", "damping", "friction"):
                hint = "factor on what fabric and obstacles have"
                controls[name] = gui.add_slider(name, 0.1, 10.0, 0.1, 1.0, hint=hint)
            colors = gui.add_dropdown("colours", COLORINGS, initial_value="fabric")
            colors.on_update(lambda event: color_by(event.target.value))
        return controls

    def _world(self, show_gizmos: Callable[[bool], None]) -> dict[str, Any]:
        gui, first = self._gui, self._session.first
        with gui.add_folder("World"):
            controls = {
                "gravity": gui.add_vector3("gravity", first.gravity, step=0.1),
                "wind": gui.add_vector3("wind", first.wind, step=0.1),
            }
            gizmos = gui.add_checkbox("move obstacles", False)
            gizmos.on_update(lambda event: show_gizmos(event.target.value))
        return controls

    def _solver(self) -> dict[str, Any]:
        gui, first = self._gui, self._session.first
        with gui.add_folder("Solver"):
            return {
                "integrator": gui.add_dropdown("integrator", tuple(integrators()), initial_value=first.integrator),
                "substeps": gui.add_number(
                    "substeps", first.substeps, min=0, max=10_000, step=1, hint="per frame; 0: automatic"
                ),
            }

    async def _changed(self, name: str, event: Any) -> None:  # at once, before anything can set the control back
        if event.client is not None:  # not when we set it ourselves
            value = event.target.value
            self._session.change(**{name: int(value) if name == "substeps" else value})

    def show(self, snapshot: Snapshot) -> None:
        """Brings it up to date."""
        self._buttons["Play"].label = "Pause" if snapshot.status == "playing" else "Play"
        self._buttons["Record"].label = "Stop recording" if snapshot.recording else "Record"
        self._status.content = describe(snapshot)
        self._loop.call_soon_threadsafe(self._follow, snapshot)  # not while somebody's change is being taken
        if self._updates % PLOT_EVERY == 0:
            self._plot.show(snapshot.energies)
        self._updates += 1

    def _follow(self, snapshot: Snapshot) -> None:
        """Controls show the settings in force, e.g. after a reset or a refused change."""
        latest = snapshot.changes == self._session.changes
        if latest and snapshot.status != "playing" and snapshot.settings is not None:
            for name, control in self._controls.items():
                value = getattr(snapshot.settings, name)
                if control.value != value:
                    control.value = value


def describe(snapshot: Snapshot) -> str:
    """Status, time, pace and errors in a few words of Markdown."""
    pace = f" · {100.0 * snapshot.pace:.0f} % of real time" if snapshot.status == "playing" else ""
    lines = [f"**{snapshot.status}** · {snapshot.time:.2f} s{pace}"]
    if snapshot.substeps:
        parts = f", shown in {snapshot.slices} parts" if snapshot.slices > 1 else ""
        lines.append(f"{snapshot.substeps} substeps a frame{parts}")
    if snapshot.error:
        lines.append(f"⚠ **{snapshot.error}**" + (" Press **Reset** to go on." if snapshot.status == "failed" else ""))
    if snapshot.recording:
        lines.append(f"recording {snapshot.recording}")
    elif snapshot.message:
        lines.append(snapshot.message)
    return "\n\n".join(lines)
