"""Every fault a cache can have, put into a good one by itself, is found by the check."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom, Vt
from shot_files import small_shot
from usd_shots import FPS, LAST, write_shot
from warpcloth.scenes import export_scene, simulate
from warpcloth.scenes.usd import check_cache
from warpcloth.scenes.usd.playback import Playback

from warpcloth import Plane, load_scene
from warpcloth.errors import InputError, UsdError

FLAG = "/World/Cloth/red_flag"


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    return write_shot(tmp_path_factory.mktemp("faults") / "shot.usdc", [Plane((0.0, 0.0, -5.0))])


def flag(stage: Usd.Stage) -> UsdGeom.Mesh:
    return UsdGeom.Mesh(stage.GetPrimAtPath(FLAG))


def edit_samples(
    name: str, change: Callable[[np.ndarray], np.ndarray | None], frames=(7,)
) -> Callable[[Usd.Stage], None]:
    def edit(stage: Usd.Stage) -> None:
        attribute = flag(stage).GetPrim().GetAttribute(name)
        for frame in frames:
            attribute.Set(Vt.Vec3fArray.FromNumpy(change(np.array(attribute.Get(frame)))), frame)

    return edit


def poke(value: float) -> Callable[[np.ndarray], np.ndarray]:
    def change(array: np.ndarray) -> np.ndarray:
        array[3, 1] = value
        return array

    return change


def authored(path: str, **metadata: object) -> Callable[[Usd.Stage], None]:
    """Removes metadata (None) or sets it, on the pseudo-root or a prim."""

    def edit(stage: Usd.Stage) -> None:
        thing = stage.GetPrimAtPath(path) if path else stage.GetPseudoRoot()
        for key, value in metadata.items():
            thing.ClearMetadata(key) if value is None else thing.SetMetadata(key, value)

    return edit


def remove_attribute(name: str) -> Callable[[Usd.Stage], None]:
    return lambda stage: flag(stage).GetPrim().RemoveProperty(name) and None


def at_default(name: str, value: object) -> Callable[[Usd.Stage], None]:
    return lambda stage: flag(stage).GetPrim().GetAttribute(name).Set(value) and None


def drop_sample(name: str, frame: float) -> Callable[[Usd.Stage], None]:
    return lambda stage: flag(stage).GetPrim().GetAttribute(name).ClearAtTime(frame) and None


def shift_samples(stage: Usd.Stage) -> None:
    """A frame is missing from everything."""
    for name in ("points", "velocities", "normals", "extent"):
        flag(stage).GetPrim().GetAttribute(name).ClearAtTime(7)


def sample_topology(stage: Usd.Stage) -> None:
    indices = flag(stage).GetFaceVertexIndicesAttr()
    indices.Set(indices.Get(), 3)


def out_of_range(stage: Usd.Stage) -> None:
    indices = flag(stage).GetFaceVertexIndicesAttr()
    values = np.array(indices.Get())
    values[5] = 35
    indices.Set(Vt.IntArray.FromNumpy(values))


def freeze_points(stage: Usd.Stage) -> None:
    """Velocities say that it moves."""
    for name in ("points", "normals", "extent"):
        attribute = flag(stage).GetPrim().GetAttribute(name)
        for code in attribute.GetTimeSamples():
            attribute.Set(attribute.Get(0), code)


def drop_provenance(stage: Usd.Stage) -> None:
    stage.GetRootLayer().customLayerData = {}


def clear_rest(stage: Usd.Stage) -> None:
    flag(stage).GetPointsAttr().ClearDefault()


def clear_all_samples(stage: Usd.Stage) -> None:
    for name in ("points", "velocities", "normals", "extent"):
        attribute = flag(stage).GetPrim().GetAttribute(name)
        for code in attribute.GetTimeSamples():
            attribute.ClearAtTime(code)


def flip_winding(stage: Usd.Stage) -> None:
    flag(stage).GetOrientationAttr().Set("leftHanded")


def unbind_material(stage: Usd.Stage) -> None:
    stage.RemovePrim("/World/Materials")


EVERY = range(LAST + 1)
FAULTS = {
    "NaN point": (edit_samples("points", poke(np.nan)), "has points that are not finite at frame 7"),
    "infinite point": (edit_samples("points", poke(np.inf), EVERY), "not finite at 13 frames, first 0"),
    "NaN velocity": (edit_samples("velocities", poke(np.nan)), "has velocities that are not finite at frame 7"),
    "NaN normal": (edit_samples("normals", poke(np.nan)), "has normals that are not finite at frame 7"),
    "NaN rest": (lambda s: edit_default(s, poke(np.nan)), "has points that are not finite in its default value"),
    "no rest": (clear_rest, "has no rest pose"),
    "short points": (edit_samples("points", lambda a: a[:-1]), "has 34 points for 35 points at frame 7"),
    "short velocities": (edit_samples("velocities", lambda a: a[:-1]), "has 34 velocities for 35 points at frame 7"),
    "short normals": (edit_samples("normals", lambda a: a[:-1]), "has 34 normals for 35 points at frame 7"),
    "no velocities": (remove_attribute("velocities"), "has no velocities at its frames"),
    "no normals": (remove_attribute("normals"), "has no normals at its frames"),
    "no extent": (remove_attribute("extent"), "has no extent"),
    "missing velocity": (drop_sample("velocities", 7), "has velocities at 12 frames that are not the 13"),
    "missing normals": (drop_sample("normals", 7), "has normals at 12 frames"),
    "missing extent": (drop_sample("extent", 7), "has extent at 12 frames"),
    "missing frame": (shift_samples, "is not sampled at every frame"),
    "no samples": (clear_all_samples, "has no sampled points"),
    "wrong extent": (edit_samples("extent", lambda a: a * np.float32(1.001)), "has a wrong extent at frame 7"),
    "wrong rest extent": (at_default("extent", [(0, 0, 0), (1, 1, 1)]), "has a wrong extent in its default value"),
    "flipped normals": (edit_samples("normals", np.negative), "do not fit the winding of its faces at frame 7"),
    "one flipped normal": (edit_samples("normals", lambda a: a * flip_one(a)), "do not fit the winding"),
    "long normals": (edit_samples("normals", lambda a: a * np.float32(1.01)), "not of unit length at frame 7"),
    "flipped winding": (flip_winding, "do not fit the winding"),
    "velocities per frame": (edit_samples("velocities", lambda a: a / np.float32(FPS), EVERY), "0.042 times the rate"),
    "reversed velocities": (edit_samples("velocities", np.negative, EVERY), "-1 times the rate of change"),
    "zero velocities": (edit_samples("velocities", np.zeros_like, EVERY), "0 times the rate of change"),
    "shuffled velocities": (edit_samples("velocities", lambda a: np.roll(a, 1, axis=1), EVERY), "0 times the rate"),
    "frozen points": (freeze_points, "has velocities, but its points do not move"),
    "sampled topology": (sample_topology, "has a sampled faceVertexIndices"),
    "invalid topology": (out_of_range, "has invalid faces"),
    "no counts": (remove_attribute("faceVertexCounts"), "has no faceVertexCounts"),
    "no scheme": (remove_attribute("subdivisionScheme"), "has no subdivisionScheme"),
    "no up axis": (authored("", upAxis=None), "The stage has no upAxis."),
    "no length unit": (authored("", metersPerUnit=None), "The stage has no metersPerUnit."),
    "no mass unit": (authored("", kilogramsPerUnit=None), "The stage has no kilogramsPerUnit."),
    "no time codes": (authored("", timeCodesPerSecond=None), "The stage has no timeCodesPerSecond."),
    "no frame rate": (authored("", framesPerSecond=None), "The stage has no framesPerSecond."),
    "other frame rate": (authored("", framesPerSecond=25.0), "24 time codes and 25 frames per second"),
    "no start": (authored("", startTimeCode=None), "The stage has no startTimeCode."),
    "no end": (authored("", endTimeCode=None), "The stage has no endTimeCode."),
    "wrong end": (authored("", endTimeCode=99.0), "says frames 0 to 99, but is sampled from 0 to 12"),
    "no default prim": (authored("", defaultPrim=None), "The stage has no defaultPrim."),
    "no kind": (authored("/World", kind=None), "The default prim /World has no kind."),
    "no provenance": (drop_provenance, "has no provenance"),
    "no materials": (unbind_material, "material"),
}


def flip_one(array: np.ndarray) -> np.ndarray:
    signs = np.ones((len(array), 1), np.float32)
    signs[4] = -1.0
    return signs


def edit_default(stage: Usd.Stage, change: Callable[[np.ndarray], np.ndarray]) -> None:
    points = flag(stage).GetPointsAttr()
    points.Set(Vt.Vec3fArray.FromNumpy(change(np.array(points.Get()))))


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_found(good, tmp_path, fault):
    damage, words = FAULTS[fault]
    path = Path(shutil.copy(good, tmp_path / "shot.usdc"))
    stage = Usd.Stage.Open(str(path))
    damage(stage)
    stage.GetRootLayer().Save()
    del stage
    report = check_cache(path)
    assert [error for error in report.usd_errors if words in error], report.usd_errors
    assert not report.ok
    assert report.finite == ("NaN" not in fault and "infinite" not in fault)
    assert "NOT sound" in str(report)


def test_what_is_no_path_is_said_to_be_none():
    for call in (check_cache, lambda path: export_scene(load_scene("hanging"), path)):
        for path in (5, None, b"shot.usdc"):
            with pytest.raises(InputError, match="Path must be the path of a file, got"):
                call(path)


@pytest.mark.parametrize("ending", ["usda", "usdc"])
def test_what_is_only_a_part_of_a_shot_says_what_to_open(tmp_path, ending):
    """The layer of frames alone has no meshes, and the shot without its stage has none either."""
    shot = simulate(small_shot(tmp_path / "shot.usda"), tmp_path / f"out.{ending}", frames=1, device="cpu").output
    (layer,) = tmp_path.glob("*.cache.usdc")
    with pytest.raises(UsdError, match=rf"nothing to play in .*{layer.name}: .* open out.{ending}, which has both\."):
        Playback(layer)
    renamed = layer.rename(tmp_path / "frames.usdc")
    with pytest.raises(UsdError, match=r"Nothing to check in .*frames.usdc: .* a sublayer over shot.usda\."):
        check_cache(renamed)
    with pytest.raises(UsdError, match=rf"Nothing to check in .*: it is incomplete: could not load .*{layer.name}@"):
        check_cache(shot)
