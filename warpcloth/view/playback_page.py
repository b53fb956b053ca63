"""A page that plays a cache back, with a timeline."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ..errors import WarpclothError
from ..obstacles import Plane
from ..render.coloring import Coloring
from ..scenes.usd.playback import Playback, PlayedCloth, PlayedNetwork
from .player import SPEEDS, Player
from .scenery import ClothShape, NetworkShape, ObstacleShape, add_plane
from .server import Ticker, look_at, open_server, send_picture, server_url

HELP = """Drag to turn the view, scroll to zoom.

**P** play or pause · **N** next frame · **B** frame before · **R** first frame · **T** picture"""


class PlaybackPage:
    """A server whose page shows a cache to any number of browsers, which share one timeline.

    Args:
        playback: the open cache.
        host, port: where to listen.

    Attributes:
        player: the timeline. coloring: what colours show. shown: the frame on the page; -1 before the first.
        updates: how often the page has been brought up to date.
    """

    def __init__(self, playback: Playback, host: str = "127.0.0.1", port: int = 8080):
        self.playback, self.player = playback, Player([playback.time(k) for k in range(playback.frames)])
        self.coloring = Coloring("fabric", playback)
        self.shown, self.updates, self._error = -1, 0, ""
        self.server = open_server(host, port)
        self._build_scene()
        self._build_panel()
        points = self._all_points()
        self.server.on_client_connect(lambda client: look_at(client, points))
        self._ticker = Ticker(self._tick)

    @property
    def url(self) -> str:
        """Where a browser finds the page."""
        return server_url(self.server)

    def close(self) -> None:
        """Stops the server."""
        self._ticker.close()
        self.server.stop()

    def _build_scene(self) -> None:
        server, play = self.server, self.playback
        self._cloths = [ClothShape(server, c.name, play.points(c, 0), c.triangles, c.color) for c in play.cloths]
        self._networks = [
            NetworkShape(
                server, net.name, play.points(net, 0), play.segments(net, 0), 2.0 * float(net.radii.max(initial=0.01)),
                (net.ball_color, net.spring_color),
            )
            for net in play.networks
        ]  # fmt: skip
        for plane in (item for item in play.obstacles if isinstance(item, Plane)):
            add_plane(server, plane)
        self._obstacles = [ObstacleShape(server, item) for item in play.obstacles if not isinstance(item, Plane)]

    def _build_panel(self) -> None:
        gui, player = self.server.gui, self.player
        self._status = gui.add_markdown("")
        self._play = gui.add_button("Play", hint="P")
        self._play.on_click(lambda _: player.toggle())
        self._slider = gui.add_slider("frame", 0, player.last, 1, 0)
        self._slider.on_update(self._sought)
        speed = gui.add_dropdown("speed", tuple(SPEEDS), initial_value="1")
        speed.on_update(lambda event: setattr(player, "speed", SPEEDS[event.target.value]))
        loop = gui.add_checkbox("loop", True)
        loop.on_update(lambda event: setattr(player, "loop", event.target.value))
        colors = gui.add_dropdown("colours", colorings(self.playback), initial_value="fabric")
        colors.on_update(lambda event: self.color_by(event.target.value))
        gui.add_button("Picture", hint="T").on_click(self._picture)
        gui.add_markdown(HELP)
        acts: list[tuple[str, Any, Callable[[Any], Any]]] = [
            ("Play or pause", "P", lambda _: player.toggle()),
            ("Next frame", "N", lambda _: player.skip(1)),
            ("Frame before", "B", lambda _: player.skip(-1)),
            ("First frame", "R", lambda _: player.seek(0)),
            ("Picture", "T", self._picture),
        ]
        for label, key, act in acts:
            gui.add_command(label, hotkey=key).on_trigger(act)

    def color_by(self, name: str) -> None:
        """Colours by fabric, or by a measure on a scale that the whole shot shares."""
        self.coloring, self.shown = Coloring(name, self.playback), -1

    async def _sought(self, event: Any) -> None:  # at once: the next tick sets the slider back
        if event.client is not None:  # not when we set it ourselves
            self.player.seek(int(event.target.value))

    def _picture(self, event: Any) -> None:
        send_picture(event.client, f"{self.playback.path.stem}_{self.player.frame}")

    def _tick(self, seconds: float) -> None:
        """Moves on, and shows what is then to be seen."""
        self.player.advance(seconds)
        frame, label = self.player.frame, "Pause" if self.player.playing else "Play"
        if frame == self.shown and label == self._play.label:
            return
        with self.server.atomic():
            if frame != self.shown:
                self.shown, self._error = frame, ""
                try:
                    self._show(frame)
                except WarpclothError as problem:  # a file that is damaged further on
                    self._error, self.player.playing = str(problem), False
            self._play.label, self._slider.value = label, frame
            self._status.content = self._describe(frame)
        self.updates += 1

    def _show(self, frame: int) -> None:
        play, coloring = self.playback, self.coloring
        for k, (shape, cloth) in enumerate(zip(self._cloths, play.cloths, strict=True)):
            colors = coloring.albedo(play, k, frame) if coloring.measured else None
            shape.show(play.points(cloth, frame), colors)
        for drawn, net in zip(self._networks, play.networks, strict=True):
            drawn.show(play.points(net, frame), play.segments(net, frame))
        for obstacle in self._obstacles:
            obstacle.show_at(play.time(frame))

    def _describe(self, frame: int) -> str:
        """Frame, time, scale of colours and errors in a few words of Markdown."""
        measured, play = self.coloring.measured, self.playback
        lines = [f"**{play.path.name}** · frame {frame} of {self.player.last} · {play.time(frame):.2f} s"]
        if measured is not None:
            lines.append(
                f"colours: {measured.title}, from 0 (dark) to {measured.factor * self.coloring.top:.3g} (light)"
            )
        if self._error:
            lines.append(f"⚠ **{self._error}**")
        return "\n\n".join(lines)

    def _all_points(self) -> np.ndarray:
        """What a browser should see first [m], shape [n, 3]."""
        play, ends = self.playback, (0, self.playback.frames - 1)
        items: list[PlayedCloth | PlayedNetwork] = [*play.cloths, *play.networks]
        return np.concatenate([play.points(item, k) for item in items for k in ends])


def colorings(playback: Playback) -> tuple[str, ...]:
    """What colours can show of a cache: the fabric, strain of cloth, and speed where velocities are in it."""
    if not playback.cloths:
        return ("fabric",)
    return ("fabric", "strain", *(["speed"] if all(map(playback.has_velocities, playback.cloths)) else []))
