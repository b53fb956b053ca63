"""The two scenes in Blender, as a program of its own: Blender wants a Python and a NumPy that warpcloth need not have.

Its input begins with a scene in JSON (see ``scene`` in ``blender_peer.py``). It prints Blender's version when the scene
is ready, and then answers words, one a line: ``frame`` with the processor time used so far [s], when the next frame is
computed; ``points`` with positions as bytes, float64, row by row. It ends with its input.
"""

import json
import os
import sys
import time
from typing import Any

import bpy
import numpy as np

# Blender's cloth knows nothing of the scene's frame rate: one of its frames is √0.001 s (as gravity moves cloth there).
BLENDER_FRAME = 0.001**0.5  # [s]


def build(scene: dict[str, Any]) -> Any:
    """The cloth, an object of Blender's, with all that is around it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    world = bpy.context.scene
    world.gravity = scene["gravity"]
    world.frame_end = scene["frames"] + 1
    if scene["sphere"]:
        centre, radius = scene["sphere"]
        bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=scene["sphere_subdivisions"], radius=radius, location=centre)
        _stop_cloth(bpy.context.object, scene)
        bpy.ops.mesh.primitive_plane_add(size=4.0)
        _stop_cloth(bpy.context.object, scene)
    mesh = bpy.data.meshes.new("cloth")
    mesh.from_pydata(scene["points"], [], scene["quads"])
    cloth = bpy.data.objects.new("cloth", mesh)
    world.collection.objects.link(cloth)
    _make_cloth(cloth, scene)
    world.frame_set(1)
    return cloth


def _make_cloth(cloth: Any, scene: dict[str, Any]) -> None:
    modifier = cloth.modifiers.new("Cloth", "CLOTH")
    modifier.settings.quality = scene["substeps"]
    modifier.settings.time_scale = scene["dt"] / BLENDER_FRAME
    modifier.settings.air_damping = 0.0
    if scene["pinned"]:
        cloth.vertex_groups.new(name="pins").add(scene["pinned"], 1.0, "REPLACE")
        modifier.settings.vertex_group_mass = "pins"
    contact = modifier.collision_settings
    contact.use_collision = contact.use_self_collision = bool(scene["sphere"])
    contact.distance_min, contact.self_distance_min = scene["distance"], scene["self_distance"]


def _stop_cloth(thing: Any, scene: dict[str, Any]) -> None:
    thing.modifiers.new("Collision", "COLLISION")
    thing.collision.thickness_outer = scene["distance"]


def points(cloth: Any) -> np.ndarray:
    """Positions in this frame [m], shape [3 n²]."""
    data = cloth.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    flat = np.empty(3 * len(data.vertices), np.float32)
    data.vertices.foreach_get("co", flat)
    return flat.astype(np.float64)


def main() -> None:
    """Answers until there are no more questions."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what Blender itself prints is no answer
    cloth = build(json.loads(sys.stdin.readline()))
    answers.write(f"{bpy.app.version_string}\n".encode())
    answers.flush()
    for word in map(str.strip, sys.stdin):
        if word == "frame":
            bpy.context.scene.frame_set(bpy.context.scene.frame_current + 1)
            answers.write(f"{time.process_time()}\n".encode())
        else:
            answers.write(points(cloth).tobytes())
        answers.flush()


if __name__ == "__main__":
    main()
