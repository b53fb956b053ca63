"""The page: shows a session, and passes on what people do."""

import functools
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import MissingExtraError
from ..fabric_library import fabrics
from ..integrators import integrators
from ..obstacles import MeshObstacle, Plane
from ..render.coloring import color_scale, vertex_strain
from ..render.solids import SolidShape
from .session import Session, Snapshot
from .settings import AS_IN_SCENE

UPDATES = 30.0  # of the page per second, at most
PLOT_EVERY = 10  # updates
COLORINGS = ("fabric", "strain", "speed")
TOP_STRAIN, TOP_SPEED = 0.05, 2.0  # at the light end of the scale, and [m/s]
HELP = """**Drag** the cloth to pull it. **Shift-click** it to pin a point, or to free one.
Drag beside it to turn the view, scroll to zoom.

**P** play or pause · **N** next frame · **R** reset · **V** record · **T** picture"""


def viser() -> Any:
    """The library, which comes with the extra ``view``.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        import viser
    except ImportError as error:
        raise MissingExtraError(
            'The viewer needs viser, which is not installed; install the extra with: pip install "warpcloth[view]".'
        ) from error
    return viser


class Page:
    """A server whose page shows a session to any number of browsers.

    Args:
        session: what is shown.
        host, port: where to listen.
        folder: where recordings go.

    Attributes:
        updates: how often the page has been brought up to date.
    """

    def __init__(self, session: Session, host: str = "127.0.0.1", port: int = 8080, folder: Path = Path()):
        self.session, self.folder, self.updates = session, folder, 0
        self.server = viser().ViserServer(host=host, port=port, verbose=False)
        self.server.gui.configure_theme(show_share_button=False)
        self.server.gui.main_panel.dock_right()
        self.server.scene.set_up_direction("+z")
        self.coloring = "fabric"
        self._build_scene()
        self._build_panel()
        self._build_commands()
        self.server.on_client_connect(self._greet)
        self.server.on_client_disconnect(lambda client: self.session.release(client.client_id))
        self._shown, self._closing = -1, threading.Event()
        self._thread = threading.Thread(target=self._publish, name="warpcloth page", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Where a browser finds the page."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    def close(self) -> None:
        """Stops the server."""
        self._closing.set()
        self._thread.join()
        self.server.stop()

    def _build_scene(self) -> None:
        scene, snapshot, stage = self.server.scene, self.session.snapshot, self.session.stage
        self._meshes, self._dots, self._rests = {}, {}, {}
        for cloth in stage.built.cloths:
            points = snapshot.points[cloth.name]
            mesh = scene.add_mesh_simple(
                f"/cloth/{cloth.name}", points, cloth.triangles, color=_srgb(cloth.fabric.color), side="double"
            )
            mesh.on_drag("left")(self._drag)
            mesh.on_click(modifier="shift")(
                lambda event: self.session.toggle_pin((event.ray_origin, event.ray_direction))
            )
            self._meshes[cloth.name] = mesh
            size = float(np.sqrt(cloth.area / len(points)))
            self._dots[cloth.name] = scene.add_point_cloud(
                f"/colors/{cloth.name}", points, np.zeros((len(points), 3), np.uint8), point_size=1.2 * size,
                point_shape="rounded", visible=False,
            )  # fmt: skip
            self._rests[cloth.name] = (cloth.points, cloth.triangles)
        self._pins = scene.add_point_cloud(
            "/pins", snapshot.pinned, np.array((200, 40, 40), np.uint8), point_size=0.02, point_shape="circle"
        )
        self._obstacles = {}
        for item in stage.led.values():
            self._add_obstacle(item.original, snapshot)

    def _add_obstacle(self, obstacle: Any, snapshot: Snapshot) -> None:
        scene, color = self.server.scene, _srgb(obstacle.color)
        center, turn = snapshot.obstacles[obstacle.name]
        placed = {"position": center, "wxyz": _quaternion(turn)}
        if isinstance(obstacle, Plane):
            scene.add_grid(
                "/floor", plane="xy", position=(0.0, 0.0, float(center[2])), infinite_grid=True, shadow_opacity=0.3
            )
            return
        solid = SolidShape(obstacle)
        points = solid.points - obstacle.centre
        frame = scene.add_frame(f"/obstacles/{obstacle.name}", show_axes=False, **placed)
        scene.add_mesh_simple(f"/obstacles/{obstacle.name}/shape", points, solid.triangles, color=color)
        gizmo = scene.add_transform_controls(f"/gizmos/{obstacle.name}", scale=0.25, visible=False, **placed)
        gizmo.on_update(functools.partial(self._lead, obstacle.name))
        self._obstacles[obstacle.name] = (frame, gizmo, isinstance(obstacle, MeshObstacle))

    def _build_panel(self) -> None:
        gui, session, first = self.server.gui, self.session, self.session.first
        self._status = gui.add_markdown("")
        self._play = gui.add_button("Play", hint="P")
        self._play.on_click(lambda _: session.toggle())
        for label, act in (("Next frame", session.single_step), ("Reset", session.reset)):
            gui.add_button(label).on_click(functools.partial(_ignoring, act))
        self._record_button = gui.add_button("Record")
        self._record_button.on_click(lambda _: self.toggle_recording())
        gui.add_button("Picture").on_click(self._picture)
        with gui.add_folder("Cloth"):
            self._fabric = gui.add_dropdown("fabric", (AS_IN_SCENE, *fabrics()), initial_value=first.fabric)
            self._factors = {
                name: gui.add_slider(name, 0.1, 10.0, 0.1, 1.0, hint="factor on what fabric and obstacles have")
                for name in ("stiffness", "damping", "friction")
            }
            self._colors = gui.add_dropdown("colours", COLORINGS, initial_value="fabric")
        with gui.add_folder("World"):
            self._gravity = gui.add_vector3("gravity", first.gravity, step=0.1)
            self._wind = gui.add_vector3("wind", first.wind, step=0.1)
            self._gizmos = gui.add_checkbox("move obstacles", False)
        with gui.add_folder("Solver"):
            self._integrator = gui.add_dropdown("integrator", tuple(integrators()), initial_value=first.integrator)
            self._substeps = gui.add_number("substeps", first.substeps, min=0, max=10_000, step=1, hint="0: automatic")
        with gui.add_folder("Energy [J]"):
            self._plot: Any = None
            self._plot_folder = gui.add_markdown("after a few frames")
        gui.add_markdown(HELP)
        controls = {
            "fabric": self._fabric, "gravity": self._gravity, "wind": self._wind, "integrator": self._integrator,
            "substeps": self._substeps, **self._factors,
        }  # fmt: skip
        for name, control in controls.items():
            control.on_update(functools.partial(self._changed, name))
        self._controls = controls
        self._colors.on_update(lambda event: self._set_coloring(event.target.value))
        self._gizmos.on_update(lambda event: self._show_gizmos(event.target.value))

    def _build_commands(self) -> None:
        acts: list[tuple[str, Any, Callable[[], Any]]] = [
            ("Play or pause", "P", self.session.toggle),
            ("Next frame", "N", self.session.single_step),
            ("Reset", "R", self.session.reset),
            ("Record", "V", self.toggle_recording),
        ]
        for label, key, act in acts:
            self.server.gui.add_command(label, hotkey=key).on_trigger(functools.partial(_ignoring, act))
        self.server.gui.add_command("Picture", hotkey="T").on_trigger(self._picture)

    def toggle_recording(self) -> None:
        """Begins a recording under a free name, or ends it."""
        if self.session.snapshot.recording:
            self.session.stop_recording()
            return
        number = 1
        name = self.session.stage.scene.name
        while (path := self.folder / f"{name}_{number}.usdc").exists():
            number += 1
        self.session.record(path)

    def _greet(self, client: Any) -> None:
        points = np.concatenate(list(self.session.snapshot.points.values()))
        center, size = 0.5 * (points.min(axis=0) + points.max(axis=0)), float(np.linalg.norm(np.ptp(points, axis=0)))
        client.camera.position = center + size * np.array([0.75, -1.25, 0.45])
        client.camera.look_at = center - (0.0, 0.0, 0.1 * size)

    def _drag(self, event: Any) -> None:
        who = event.client_id
        if event.phase == "start":
            eye = np.asarray(event.client.camera.position)
            self.session.grab(who, (eye, np.asarray(event.start_position) - eye))
        elif event.phase == "end":
            self.session.release(who)
            return
        self.session.move(who, event.end_position)

    def _pin(self, event: Any) -> None:
        self.session.toggle_pin((event.ray_origin, event.ray_direction))

    def _lead(self, name: str, event: Any) -> None:
        gizmo, item = event.target, self.session.stage.led[name]
        own = item.pose(self.session.snapshot.time)[0] - item.place[:3] - item.original.centre
        turn = np.zeros(3) if np.any(item.original.motion is not None) else _rotation_vector(gizmo.wxyz)
        self.session.lead(name, gizmo.position - item.original.centre - own, turn)

    def _changed(self, name: str, event: Any) -> None:
        if event.client is not None:  # not when we set it ourselves
            value = event.target.value
            self.session.change(**{name: int(value) if name == "substeps" else value})

    def _set_coloring(self, name: str) -> None:
        self.coloring, self._shown = name, -1
        for dots in self._dots.values():
            dots.visible = name != "fabric"

    def _show_gizmos(self, wanted: bool) -> None:
        for _, gizmo, _ in self._obstacles.values():
            gizmo.visible = wanted

    def _picture(self, event: Any) -> None:
        client = event.client
        image = client.get_render(height=800, width=1280)
        from io import BytesIO

        from PIL import Image

        data = BytesIO()
        Image.fromarray(np.asarray(image)[..., :3]).save(data, "PNG")
        client.send_file_download(f"{self.session.stage.scene.name}.png", data.getvalue())

    def _publish(self) -> None:
        """Brings the page up to date whenever there is something new; frames that nobody has time for are left out."""
        while not self._closing.wait(0.0):
            begun = time.perf_counter()
            snapshot = self.session.snapshot
            if snapshot.number != self._shown:
                self._shown = snapshot.number
                with self.server.atomic():
                    self._show(snapshot)
                self.updates += 1
            self._closing.wait(max(0.002, begun + 1.0 / UPDATES - time.perf_counter()))

    def _show(self, snapshot: Snapshot) -> None:
        for name, mesh in self._meshes.items():
            points = snapshot.points[name]
            if np.isfinite(points).all():
                mesh.vertices = points
                if self.coloring != "fabric":
                    self._dots[name].points = points
                    self._dots[name].colors = self._measured(name, snapshot)
        self._pins.points = snapshot.pinned
        for name, (frame, gizmo, _) in self._obstacles.items():
            center, turn = snapshot.obstacles[name]
            frame.position, frame.wxyz = center, _quaternion(turn)
            if not gizmo.visible:
                gizmo.position, gizmo.wxyz = center, _quaternion(turn)
        self._play.label = "Pause" if snapshot.status == "playing" else "Play"
        self._record_button.label = "Stop recording" if snapshot.recording else "Record"
        self._status.content = describe(snapshot)
        self._follow(snapshot)
        if self.updates % PLOT_EVERY == 0 and len(snapshot.energies.get("time", ())) > 1:
            self._draw_energies(snapshot.energies)

    def _follow(self, snapshot: Snapshot) -> None:
        """Controls show the settings in force, e.g. after a reset or a refused change."""
        if snapshot.status != "playing" and snapshot.settings is not None:
            for name, control in self._controls.items():
                value = getattr(snapshot.settings, name)
                if control.value != value:
                    control.value = value

    def _measured(self, name: str, snapshot: Snapshot) -> np.ndarray:
        if self.coloring == "speed":
            values = snapshot.speeds[name] / TOP_SPEED
        else:
            rest, triangles = self._rests[name]
            values = vertex_strain(rest, snapshot.points[name].astype(float), triangles) / TOP_STRAIN
        return np.round(255.0 * color_scale(values) ** (1.0 / 2.2)).astype(np.uint8)

    def _draw_energies(self, energies: dict[str, np.ndarray]) -> None:
        uplot = viser().uplot
        names = [name for name in energies if name != "time" and np.abs(energies[name]).max() > 1e-12]
        colors = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#8c564b", "#17becf", "#7f7f7f")
        data = (energies["time"], *(energies[name] for name in names))
        series = (uplot.Series(label="t [s]"), *(
            uplot.Series(label=name, stroke=color, width=1.5) for name, color in zip(names, colors, strict=False)
        ))  # fmt: skip
        if self._plot is not None and len(self._plot.data) == len(data):
            self._plot.data = data
            return
        if self._plot is not None:
            self._plot.remove()
        with self._energy_folder():
            self._plot = self.server.gui.add_uplot(data, series, aspect=1.6)

    def _energy_folder(self) -> Any:
        if self._plot_folder is not None and not hasattr(self._plot_folder, "__enter__"):
            self._plot_folder.remove()
            self._plot_folder = self.server.gui.add_folder("Energies of the last seconds [J]")
        return self._plot_folder


def describe(snapshot: Snapshot) -> str:
    """Status, time and errors in a few words of Markdown."""
    lines = [f"**{snapshot.status}** · {snapshot.time:.2f} s · {100.0 * snapshot.pace:.0f} % of real time"]
    if snapshot.error:
        lines.append(f"⚠ **{snapshot.error}**" + (" Press **Reset** to go on." if snapshot.status == "failed" else ""))
    if snapshot.recording:
        lines.append(f"recording {snapshot.recording}")
    elif snapshot.message:
        lines.append(snapshot.message)
    return "\n\n".join(lines)


def _ignoring(act: Callable[[], Any], event: Any) -> None:
    act()


def _srgb(color: Any) -> tuple[int, int, int]:
    red, green, blue = (round(255.0 * float(channel) ** (1.0 / 2.2)) for channel in color)
    return red, green, blue


def _quaternion(turn: np.ndarray) -> tuple[float, float, float, float]:
    """(w, x, y, z) of a rotation vector [rad]."""
    angle = float(np.linalg.norm(turn))
    share = np.sin(0.5 * angle) / angle if angle > 1e-12 else 0.5
    x, y, z = (float(share * component) for component in turn)
    return float(np.cos(0.5 * angle)), x, y, z


def _rotation_vector(wxyz: np.ndarray) -> np.ndarray:
    """Rotation vector [rad] of a unit quaternion (w, x, y, z)."""
    w, axis = wxyz[0], np.asarray(wxyz[1:])
    sine = float(np.linalg.norm(axis))
    return 2.0 * np.arctan2(sine, w) / sine * axis if sine > 1e-12 else np.zeros(3)
