"""A scene of the user's as a problem of the benchmark."""

from warpcloth.scenes import Scene, load_scene
from warpcloth.scenes.built import BuiltScene

from warpcloth import Model, validate

from .problems import Problem


def scene_problem(name_or_path: str, frames: int | None = None) -> Problem:
    """The scene as it is, its air included, in float64 on the CPU, up to its last frame or to ``frames``.

    Raises:
        InputError: there is no such scene, it is not valid, or frames is out of range.
    """
    scene = load_scene(name_or_path)
    count = scene.frames if frames is None else validate.integer(frames, "frames", minimum=1, maximum=scene.frames)
    options = scene.simulation
    _model(scene)  # what is wrong with it is said now
    return Problem(
        scene.name, f"Scene {scene.name}", lambda damped: _model(scene), count / scene.fps, 1.0 / scene.fps,
        gravity=options.gravity, contact=options.contact, air=scene.air.build(scene.seed),
    )  # fmt: skip


def _model(scene: Scene) -> Model:
    built = BuiltScene.of(scene)
    net = built.network
    if net is None:
        return Model.build(built.cloths, built.obstacles, precision="float64", device="cpu")
    laws = (net.springs, net.rest_lengths, net.k_s, net.k_d)
    return Model.from_springs(net.points, net.masses, *laws, net.pinned, precision="float64", device="cpu")
