"""Which meshes of a file with several are meant."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ..errors import MeshError
from ..validate import did_you_mean
from .trianglemesh import TriangleMesh

SHOWN = 6


@dataclass(frozen=True)
class Part:
    """One mesh in a file: its path, such as "/root/bunny", and how to read it."""

    path: str
    read: Callable[[], TriangleMesh]


def chosen(parts: Sequence[Part], name: str, prim: str | None, join: bool) -> TriangleMesh:
    """The mesh with path or last name ``prim``, or all meshes below it joined; without ``prim`` the only one.

    Args:
        parts: all meshes of the file.
        name: what to call the file.
        prim: path or name, or None.
        join: whether several meshes, none of them chosen, are joined rather than refused.

    Raises:
        MeshError: when nothing fits, or several do and ``join`` is false; the message lists them.
    """
    if not parts:
        raise MeshError(f"'{name}' holds no triangle mesh.")
    if prim is None:
        if len(parts) > 1 and not join:
            listed = _listed(parts)
            raise MeshError(f"'{name}' holds {len(parts)} meshes ({listed}); choose one, or a parent of some, by prim.")
        return TriangleMesh.joined([part.read() for part in parts], name if len(parts) > 1 else _leaf(parts[0].path))
    path = prim.rstrip("/")
    found = [part for part in parts if part.path == path or part.path.startswith(f"{path}/")]
    if not found and "/" not in path:
        found = [part for part in parts if _leaf(part.path) == path]
        if len(found) > 1:
            raise MeshError(
                f"'{name}' holds {len(found)} meshes named '{path}' ({_listed(found)}); give the whole path."
            )
    if not found:
        known = [part.path for part in parts]
        hint = did_you_mean(prim, known) or f"; it holds {_listed(parts)}"
        raise MeshError(f"'{name}' holds no mesh '{prim}'{hint}.")
    return TriangleMesh.joined([part.read() for part in found], _leaf(path) or name)


def _listed(parts: Sequence[Part]) -> str:
    names = ", ".join(part.path for part in parts[:SHOWN])
    return names if len(parts) <= SHOWN else f"{names} and {len(parts) - SHOWN} more"


def _leaf(path: str) -> str:
    return path.rsplit("/", 1)[-1]
