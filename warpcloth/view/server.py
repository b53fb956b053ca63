"""What the pages have in common: the server, how it is brought up to date, pictures, the first view."""

import threading
import time
from collections.abc import Callable
from io import BytesIO
from typing import Any

import numpy as np

from ..errors import MissingExtraError

UPDATES = 30.0  # of a page per second, at most
PICTURE = (1280, 800)  # pixels


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


def open_server(host: str, port: int) -> Any:
    """A server with an empty page, z up, its panel on the right."""
    server = viser().ViserServer(host=host, port=port, verbose=False)
    server.gui.configure_theme(show_share_button=False)
    server.gui.main_panel.dock_right()
    server.scene.set_up_direction("+z")
    return server


def server_url(server: Any) -> str:
    """Where a browser finds the page."""
    return f"http://{server.get_host()}:{server.get_port()}"


def look_at(client: Any, points: np.ndarray) -> None:
    """Puts a browser's camera where it sees all points [m], shape [n, 3]."""
    center, size = 0.5 * (points.min(axis=0) + points.max(axis=0)), float(np.linalg.norm(np.ptp(points, axis=0)))
    client.camera.position = center + size * np.array([0.65, -1.1, 0.42])
    client.camera.look_at = center - (0.0, 0.0, 0.1 * size)


def send_picture(client: Any, name: str) -> None:
    """Lets a browser draw what it shows once more, and keep it as a PNG."""
    from PIL import Image

    image = client.get_render(height=PICTURE[1], width=PICTURE[0])
    data = BytesIO()
    Image.fromarray(np.asarray(image)[..., :3]).save(data, "PNG")
    client.send_file_download(f"{name}.png", data.getvalue(), save_immediately=True)


class Ticker:
    """Does something again and again in a thread of its own, :data:`UPDATES` times per second at most.

    Args:
        act: what to do; it is told the time since it was last called [s].
    """

    def __init__(self, act: Callable[[float], None]):
        self._act, self._closing = act, threading.Event()
        self._thread = threading.Thread(target=self._work, name="warpcloth page", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends the thread."""
        self._closing.set()
        self._thread.join()

    def _work(self) -> None:
        before = time.perf_counter()
        while not self._closing.is_set():
            begun = time.perf_counter()
            self._act(begun - before)
            before = begun
            self._closing.wait(max(0.002, begun + 1.0 / UPDATES - time.perf_counter()))
