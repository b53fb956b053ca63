"""``warpcloth view``: a scene or a cache on a web page."""

import ipaddress
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import InputError
from .report import Report
from .terminal import messages, start_warp

if TYPE_CHECKING:
    from ..view.page import Page
    from ..view.playback_page import PlaybackPage

Shown = Annotated[
    str,
    typer.Argument(metavar="SCENE|CACHE", help="A bundled scene (see `scenes`), a .toml file, a USD stage or cache."),
]
Host = Annotated[str, typer.Option(help="Address to listen on.")]
Public = Annotated[
    bool, typer.Option("--public", help="Allow addresses other than this machine's own: anybody there has the page.")
]
Port = Annotated[int, typer.Option(help="Port to listen on.")]
Changes = Annotated[
    list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="Change a field of the scene, see `simulate`.")
]
Fps = Annotated[float | None, typer.Option(metavar="N", help="Frames per simulated second.  [default: 60]")]
FPS = 60.0


def command(
    scene: Shown,
    host: Host = "127.0.0.1",
    port: Port = 8080,
    public: Public = False,
    changes: Changes = None,
    fps: Fps = None,
) -> Report:
    """Show SCENE on a web page, where its cloth moves and can be pulled; or play CACHE there. Ctrl-C ends it."""
    check_host(host, public)
    from ..view.server import viser

    viser()
    if not _is_cache(scene):
        return _simulate(scene, host, port, changes or [], FPS if fps is None else fps)
    if changes or fps is not None:
        raise InputError(f"--set and --fps change how a scene is simulated; {Path(scene).name} is a cache.")
    return _play(scene, host, port)


def _is_cache(shown: str) -> bool:
    """Whether it is a USD file with motion in it; a stage without any is a scene.

    Raises:
        UsdError: the file cannot be read.
    """
    from ..scenes.load import STAGES

    if Path(shown).suffix not in STAGES:
        return False
    from ..scenes.usd.playback import can_play

    return can_play(shown)


def _simulate(scene: str, host: str, port: int, changes: list[str], fps: float) -> Report:
    from ..scenes import load_scene
    from ..view.page import Page
    from ..view.session import Session

    loaded = load_scene(scene, changes)
    start_warp()
    session = Session(loaded, fps)
    try:
        page = Page(session, host, port, Path())
        session.play()
        _wait(loaded.name, page)
    finally:
        session.close()
    return Report({"scene": loaded.name, "url": page.url, "updates": page.updates}, "closed")


def _play(cache: str, host: str, port: int) -> Report:
    from ..scenes.usd.playback import Playback
    from ..view.playback_page import PlaybackPage

    page = PlaybackPage(Playback(cache), host, port)
    page.player.toggle()
    _wait(Path(cache).name, page)
    return Report({"cache": Path(cache), "url": page.url, "updates": page.updates}, "closed")


def _wait(name: str, page: "Page | PlaybackPage") -> None:
    """Until Ctrl-C."""
    messages().print(f"{name} is at {page.url} until Ctrl-C.")
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        messages().print("warpcloth: closing the page")
    finally:
        page.close()


def check_host(host: str, public: bool) -> None:
    """Loopback is fine; other addresses only if asked for, with a warning.

    Raises:
        InputError: another address without ``public``.
    """
    if _is_loopback(host):
        return
    if not public:
        raise InputError(f"{host} can be reached from other machines; add --public if that is what you want.")
    messages().print(
        f"warpcloth: whoever reaches {host} sees this page, can stop the simulation and write recordings here."
    )


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
