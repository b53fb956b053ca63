"""The files that a sample is made from, and whether they are still what they were."""

import hashlib
import os
from functools import lru_cache
from pathlib import Path

from pxr import Tf, UsdUtils

from ..scenes import Scene
from ..scenes.load import STAGES


def input_hashes(scene: Scene) -> dict[str, str]:
    """SHA-256 by path of each mesh and stage that a scene reads, with all layers of the latter."""
    tables = [*scene.cloth, *scene.obstacle, *([scene.stage] if scene.stage is not None else [])]
    paths = [path for table in tables if isinstance(path := getattr(table, "path", None), str)]
    roots = [str(scene.folder / path) for path in paths]
    files = {file for root in roots for file in _layers(root, *_state(root))}
    return {file: digest for file in sorted(files) if (digest := hash_of(file))}


def hash_of(file: str) -> str:
    """SHA-256 of a file; empty where there is none, or none that can be read."""
    return _hash(file, *_state(file))


def _state(file: str) -> tuple[int, int]:
    """Size and time of a file: what tells, without reading it, that it may have changed."""
    try:
        found = os.stat(file)
    except OSError:
        return 0, 0
    return found.st_size, found.st_mtime_ns


@lru_cache(maxsize=65_536)
def _hash(file: str, size: int, time: int) -> str:
    try:
        return hashlib.sha256(Path(file).read_bytes()).hexdigest()
    except OSError:  # whoever reads it for what is in it says so
        return ""


@lru_cache(maxsize=65_536)
def _layers(root: str, size: int, time: int) -> tuple[str, ...]:
    """A file, and what a stage is composed of."""
    if Path(root).suffix not in STAGES:
        return (root,)
    try:
        layers = UsdUtils.ComputeAllDependencies(root)[0]
    except Tf.ErrorException:  # whoever reads the stage says what is wrong with it
        return (root,)
    return (root, *(layer.realPath for layer in layers if layer.realPath))
