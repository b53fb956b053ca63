"""The page of a simulation: shows a session, and passes on what people do."""

import functools
from pathlib import Path
from typing import Any

import numpy as np

from ..obstacles import Plane
from ..render.coloring import color_scale, vertex_strain
from .panel import Panel
from .scenery import ClothShape, NetworkShape, ObstacleShape, add_plane, rotation_vector
from .server import Ticker, look_at, open_server, send_picture, server_url
from .session import Session
from .snapshot import Snapshot

TOP_STRAIN, TOP_SPEED = 0.05, 2.0  # at the light end of the scale, and [m/s]
BALL, BALL_COLOR, SPRING_COLOR = 6.0, (0.70, 0.10, 0.08), (0.25, 0.27, 0.30)  # of networks; size in widths of springs


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
        self.server = open_server(host, port)
        self.coloring, self._shown = "fabric", -1
        self._build_scene()
        self._panel = Panel(
            self.server, session, self.toggle_recording, self._picture, self._color_by, self._show_gizmos
        )
        self.server.on_client_connect(lambda client: look_at(client, self._all_points()))
        self.server.on_client_disconnect(lambda client: self.session.release(client.client_id))
        self._ticker = Ticker(self._tick)

    @property
    def url(self) -> str:
        """Where a browser finds the page."""
        return server_url(self.server)

    def close(self) -> None:
        """Stops the server."""
        self._ticker.close()
        self.server.stop()

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

    def _build_scene(self) -> None:
        scene, snapshot, stage = self.server.scene, self.session.snapshot, self.session.stage
        self._cloths, self._rests = {}, {}
        for cloth in stage.built.cloths:
            shape = ClothShape(
                self.server, cloth.name, snapshot.points[cloth.name], cloth.triangles, cloth.fabric.color
            )
            shape.mesh.on_drag("left")(self._drag)
            shape.mesh.on_click(modifier="shift")(self._pin)
            self._cloths[cloth.name] = shape
            self._rests[cloth.name] = (cloth.points, cloth.triangles)
        self._network, net = None, stage.built.network
        if net is not None:
            points = snapshot.points[net.name]
            self._network = NetworkShape(
                self.server, net.name, points, points[net.springs], BALL * net.width, (BALL_COLOR, SPRING_COLOR)
            )
        self._pins = scene.add_point_cloud(
            "/pins", snapshot.pinned, np.array((200, 40, 40), np.uint8), point_size=0.02, point_shape="circle"
        )
        self._obstacles = {}
        for item in stage.built.obstacles:
            if isinstance(item, Plane):
                add_plane(self.server, item)
            elif item.name in stage.led:
                lead = functools.partial(self._lead, item.name)
                self._obstacles[item.name] = ObstacleShape(self.server, stage.led[item.name].original, lead)
            else:
                self._obstacles[item.name] = ObstacleShape(self.server, item)

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
        still = item.original.motion is None
        self.session.lead(
            name, gizmo.position - item.own_center(self.session.snapshot.time),
            rotation_vector(gizmo.wxyz) if still else np.zeros(3),
        )  # fmt: skip

    def _color_by(self, name: str) -> None:
        self.coloring, self._shown = name, -1

    def _show_gizmos(self, wanted: bool) -> None:
        for shape in self._obstacles.values():
            if shape.gizmo is not None:
                shape.gizmo.visible = wanted

    def _picture(self, event: Any) -> None:
        send_picture(event.client, self.session.stage.scene.name)

    def _tick(self, seconds: float) -> None:
        """Shows the latest snapshot, if it is new; those that nobody has time for are left out."""
        snapshot = self.session.snapshot
        if snapshot.number != self._shown:
            self._shown = snapshot.number
            with self.server.atomic():
                self._show(snapshot)
            self.updates += 1

    def _show(self, snapshot: Snapshot) -> None:
        for name, shape in self._cloths.items():
            shape.show(snapshot.points[name], self._colors(name, snapshot))
        net = self.session.stage.built.network
        if self._network is not None and net is not None:
            points = snapshot.points[net.name]
            self._network.show(points, points[net.springs])
        self._pins.points = snapshot.pinned
        for name, obstacle in self._obstacles.items():
            if name in snapshot.obstacles:
                obstacle.show(*snapshot.obstacles[name])
            else:
                obstacle.show_at(snapshot.time)
        self._panel.show(snapshot)

    def _colors(self, name: str, snapshot: Snapshot) -> np.ndarray | None:
        """Linear colours of a cloth's vertices; None for its fabric's."""
        if self.coloring == "fabric":
            return None
        if self.coloring == "speed":
            return color_scale(snapshot.speeds[name] / TOP_SPEED)
        rest, triangles = self._rests[name]
        return color_scale(vertex_strain(rest, snapshot.points[name].astype(float), triangles) / TOP_STRAIN)

    def _all_points(self) -> np.ndarray:
        return np.concatenate(list(self.session.snapshot.points.values()))
