"""``warpcloth view``: a scene or a cache on a web page."""

import ipaddress
import threading
from pathlib import Path
from typing import Annotated

import typer

from ..errors import InputError
from .report import Report
from .terminal import messages, start_warp

Shown = Annotated[
    str, typer.Argument(metavar="SCENE", help="A bundled scene (see `scenes`), a .toml file or a USD stage.")
]
Host = Annotated[str, typer.Option(help="Address to listen on.")]
Public = Annotated[
    bool, typer.Option("--public", help="Allow addresses other than this machine's own: anybody there has the page.")
]
Port = Annotated[int, typer.Option(help="Port to listen on.")]
Changes = Annotated[
    list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="Change a field of the scene, see `simulate`.")
]
Fps = Annotated[float, typer.Option(metavar="N", help="Frames per simulated second.")]


def command(
    scene: Shown,
    host: Host = "127.0.0.1",
    port: Port = 8080,
    public: Public = False,
    changes: Changes = None,
    fps: Fps = 60.0,
) -> Report:
    """Show SCENE on a web page, where its cloth moves and can be taken with the mouse. Ctrl-C ends it."""
    check_host(host, public)
    from ..scenes import load_scene
    from ..view.page import Page, viser
    from ..view.session import Session

    viser()
    loaded = load_scene(scene, changes or ())
    start_warp()
    session = Session(loaded, fps)
    page = Page(session, host, port, Path())
    messages().print(f"{loaded.name} is at {page.url} until Ctrl-C.", markup=False)
    session.play()
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        messages().print("warpcloth: closing the page")
    finally:
        session.close()
        page.close()
    return Report({"scene": loaded.name, "url": page.url, "frames": session.snapshot.number}, "closed")


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
        f"warpcloth: whoever reaches {host} sees this page, can stop the simulation and write recordings here.",
        markup=False,
    )


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
