"""What the pages have in common: the server, how it is brought up to date, pictures, the first view."""

import errno
import os
import socket
import threading
import time
from collections.abc import Callable
from io import BytesIO
from typing import Any

import numpy as np

from .. import validate
from ..errors import InputError, MissingExtraError

UPDATES = 30.0  # of a page per second, at most
PICTURE = (1280, 800)  # pixels
LAST_PORT = 65535


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


def free_port(host: str, port: int) -> int:
    """The first port from ``port`` on that a page can be at: viser waits for ever where there is none.

    Raises:
        InputError: it is no port, the address is none of this machine, or all of the next 1,000 are in use.
    """
    first = validate.integer(port, "port", minimum=1, maximum=LAST_PORT)
    last = min(first + 999, LAST_PORT)
    for candidate in range(first, last + 1):
        try:
            if _is_free(host, candidate):
                return candidate
        except (OSError, UnicodeError) as error:  # the latter of names that none can be
            reason = getattr(error, "strerror", None) or "it is no name of a machine"
            raise InputError(f"A page cannot be at the address {validate.shown(host)}: {reason}.") from None
    raise InputError(f"The ports {first} to {last} of {host} are all in use, or not yours; choose another --port.")


def _is_free(host: str, port: int) -> bool:
    """Whether no address of the host has the port in use.

    A name may have addresses of a kind that this machine has not, as ``localhost`` where there is no IPv6; servers
    leave these out.

    Raises:
        OSError: it has no others; UnicodeError: it is no name.
    """
    found, fault = False, OSError("no address")
    for family, kind, protocol, _, address in socket.getaddrinfo(host, port, type=socket.SOCK_STREAM):
        try:
            with socket.socket(family, kind, protocol) as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, os.name == "posix")
                probe.bind(address)
        except OSError as error:
            if error.errno in (errno.EADDRINUSE, errno.EACCES):
                return False
            fault = error
        else:
            found = True
    if not found:
        raise fault
    return True


def open_server(host: str, port: int) -> Any:
    """A server with an empty page, z up, its panel on the right.

    Raises:
        InputError: see :func:`free_port`.
    """
    server = viser().ViserServer(host=host, port=free_port(host, port), verbose=False)
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
