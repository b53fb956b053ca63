"""From a scene to a cache: what is simulated is what the scene says, and what is written is what was simulated."""

import signal

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdValidation
from warpcloth.scenes import load_scene, scene_from_toml, simulate

from warpcloth import errors

NAPKIN = """
frames = 6
fps = 30.0

[simulation]
precision = "float64"
device = "cpu"

[[cloth]]
name = "napkin"
shape = "grid"
size = [0.2, 0.2]
resolution = [5, 5]
position = [0.0, 0.0, 1.0]
"""


def points(path, prim, code):
    """Points [m] of a prim in a cache at a time code."""
    stage = Usd.Stage.Open(str(path))
    return np.array(UsdGeom.PointBased.Get(stage, prim).GetPointsAttr().Get(code), float)


def test_a_free_cloth_falls_as_it_must(tmp_path):
    scene = scene_from_toml(NAPKIN.replace("frames = 6", "frames = 6\nseed = 7\nair.density = 0"))
    result = simulate(scene, tmp_path / "fall.usdc", integrator="symplectic_euler", substeps=100)
    stage = Usd.Stage.Open(str(result.output))
    mesh = UsdGeom.Mesh.Get(stage, "/World/Cloth/napkin")
    assert mesh.GetPointsAttr().GetTimeSamples() == [0, 1, 2, 3, 4, 5, 6]
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode(), stage.GetFramesPerSecond()) == (0, 6, 30)
    # n steps h of symplectic Euler from rest fall by g h² n (n + 1)/2; the file holds single precision.
    n, h = 600, 1.0 / 3000.0
    start, end = (points(result.output, "/World/Cloth/napkin", code)[:, 2] for code in (0, 6))
    np.testing.assert_allclose(start - end, 9.81 * h * h * n * (n + 1) / 2, atol=2e-7)
    facts = stage.GetRootLayer().customLayerData["warpcloth"]
    expected = {"scene": "scene", "integrator": "symplectic_euler", "seed": 7, "substeps": 100, "device": "cpu"}
    assert {key: facts[key] for key in expected} == expected


def test_the_result_says_what_was_done(tmp_path):
    seen = []
    result = simulate(
        scene_from_toml(NAPKIN),
        tmp_path / "out.usda",
        frames=3,
        substeps=60,
        on_frame=lambda frame, frames, simulation: seen.append((frame, frames, simulation.time)),
    )
    assert (result.scene, result.frames, result.substeps, result.precision, result.device) == (
        "scene", 3, 60, "float64", "cpu",
    )  # fmt: skip
    assert (result.particles, result.triangles) == (25, 32)
    assert not result.interrupted
    assert result.output == tmp_path / "out.usda"
    assert [(frame, frames) for frame, frames, _ in seen] == [(1, 3), (2, 3), (3, 3)]
    assert seen[-1][2] == pytest.approx(0.1)
    assert result.ms_per_frame > 0.0
    assert result.wall_s >= result.compile_s


def test_the_default_output_is_the_scene_in_the_current_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = simulate("hanging", frames=1, integrator="xpbd", device="cpu")
    assert result.output == tmp_path / "hanging.usdc"
    assert result.output.is_file()


def test_led_pins_and_moving_obstacles_are_where_their_keyframes_say(tmp_path):
    scene = scene_from_toml(
        NAPKIN
        + """
        pins = [{ edge = "left", motion.keys = [{ time = 0 }, { time = 0.2, position = [-0.02, 0, 0.01] }] }]
        [[obstacle]]
        name = "ball"
        shape = "sphere"
        center = [0, 0, 0]
        radius = 0.1
        motion.keys = [{ time = 0.0 }, { time = 0.2, position = [0, 0.4, 0] }]
        """
    )
    result = simulate(scene, tmp_path / "led.usdc")
    left = np.arange(5) * 5
    start, end = (points(result.output, "/World/Cloth/napkin", code)[left] for code in (0, 6))
    np.testing.assert_allclose(end - start, np.tile([-0.02, 0.0, 0.01], (5, 1)), atol=2e-7)
    stage = Usd.Stage.Open(str(result.output))
    ball = UsdGeom.Xformable.Get(stage, "/World/Obstacles/ball")
    np.testing.assert_allclose(ball.ComputeLocalToWorldTransform(3).ExtractTranslation(), [0, 0.2, 0], atol=1e-7)


def test_the_elastic_pendulum_meets_its_known_answer(tmp_path):
    """m = 0.1 kg, r = 1 m, k_s = 200 N from (1, 0) at rest: x = 0.409091381, z = −0.927079959 at 0.5 s."""
    scene = scene_from_toml(
        """
        frames = 12
        simulation = { precision = "float64", device = "cpu", substeps = 1000 }
        [network]
        positions = [[0, 0, 0], [1, 0, 0]]
        masses = 0.1
        springs = [[0, 1]]
        rest_lengths = 1.0
        k_s = 200.0
        pinned = [0]
        """
    )
    result = simulate(scene, tmp_path / "pendulum.usdc")
    end = points(result.output, "/World/Cloth/network/particles", 12)[1]
    # First order in h = 42 µs: the error is of the order of h times the acceleration's time scale, here below 1e-3.
    np.testing.assert_allclose(end, [0.409091381, 0.0, -0.927079959], atol=1e-3)
    springs = points(result.output, "/World/Cloth/network/springs", 12)
    np.testing.assert_array_equal(springs[1], end)


def test_a_network_passes_the_usd_validators(tmp_path):
    result = simulate("pendulum", tmp_path / "pendulum.usdc", frames=2, device="cpu")
    stage = Usd.Stage.Open(str(result.output))
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    assert [error.GetMessage() for error in context.Validate(stage)] == []
    for drawn in (UsdGeom.Points.Get(stage, "/World/Cloth/pendulum/particles"),
                  UsdGeom.BasisCurves.Get(stage, "/World/Cloth/pendulum/springs")):  # fmt: skip
        assert drawn.GetPointsAttr().GetTimeSamples() == drawn.GetVelocitiesAttr().GetTimeSamples() == [0, 1, 2]
        widths = drawn.GetWidthsAttr().Get()
        for code in (Usd.TimeCode.Default(), 2):
            expected = type(drawn).ComputeExtent(drawn.GetPointsAttr().Get(code), widths)
            np.testing.assert_array_equal(drawn.GetExtentAttr().Get(code), expected)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_keeps_the_frames_so_far(number, tmp_path):
    def interrupt(frame, frames, simulation):
        if frame == 2:
            signal.raise_signal(number)

    result = simulate(scene_from_toml(NAPKIN), tmp_path / "cut.usdc", on_frame=interrupt)
    assert result.interrupted
    assert result.frames == 2
    stage = Usd.Stage.Open(str(result.output))
    assert stage.GetEndTimeCode() == 2
    assert UsdGeom.Mesh.Get(stage, "/World/Cloth/napkin").GetPointsAttr().GetTimeSamples() == [0, 1, 2]
    assert [path.name for path in tmp_path.iterdir()] == ["cut.usdc"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_a_second_ctrl_c_stops_at_once(tmp_path):
    def insist(frame, frames, simulation):
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        simulate(scene_from_toml(NAPKIN), tmp_path / "cut.usdc", on_frame=insist)
    assert Usd.Stage.Open(str(tmp_path / "cut.usdc")).GetEndTimeCode() == 1


def test_a_simulation_that_diverges_leaves_no_file(tmp_path):
    scene = scene_from_toml(NAPKIN + 'pins = [{ corner = "top_left" }]\nvelocity = [0, 0, 1]\n')
    with pytest.warns(errors.StabilityWarning), pytest.raises(errors.DivergedError):
        simulate(scene, tmp_path / "boom.usdc", integrator="symplectic_euler", substeps=1, frames=50)
    assert list(tmp_path.iterdir()) == []


def test_options_reach_the_integrator_and_its_figures_the_result(tmp_path):
    text = NAPKIN.replace("[simulation]", '[simulation]\nintegrator = "xpbd"\nintegrator_options = { iterations = 3 }')
    result = simulate(scene_from_toml(text), tmp_path / "xpbd.usdc", frames=1, substeps=2)
    assert result.integrator == "xpbd"
    with pytest.raises(errors.InputError, match="'iterations'"):
        simulate(scene_from_toml(text, overrides=["simulation.integrator_options.iter=3"]), tmp_path / "x.usdc")


def test_cloth_that_starts_inside_an_obstacle_is_refused(tmp_path):
    scene = scene_from_toml(NAPKIN + '[[obstacle]]\nshape = "sphere"\ncenter = [0, 0, 1]\nradius = 0.5\n')
    with pytest.raises(errors.BadStartError, match="'napkin' starts inside"):
        simulate(scene, tmp_path / "inside.usdc")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"frames": 0}, "frames must be a whole number from 1 to 1,000,000, not 0"),
        ({"frames": 2.0}, "frames must be a whole number from 1 to 1,000,000, not 2.0"),
        ({"substeps": "many"}, "simulation.substeps must be \"auto\" or a whole number from 1 to 100,000, not 'many'"),
        ({"precision": "double"}, "simulation.precision must be 'float32' or 'float64', not 'double'"),
        (
            {"integrator": "sympletic_euler"},
            "simulation.integrator must be the name of an integrator such as 'symplectic_euler', not 'sympletic_euler'",
        ),
        ({"device": "cuda:99"}, "cuda:99"),
    ],
)
def test_wrong_options_are_explained_and_leave_no_file(options, sentence, tmp_path):
    with pytest.raises(errors.InputError) as caught:
        simulate(load_scene("hanging"), tmp_path / "x.usdc", **options)
    assert sentence in str(caught.value)
    assert list(tmp_path.iterdir()) == []


PASSING = NAPKIN.replace('device = "cpu"', 'device = "cpu"\nintegrator = "xpbd"\nsubsteps = 4\ngravity = [0, 0, 0]') + (
    """velocity = [0, 0, -3.0]

[[cloth]]
name = "towel"
shape = "grid"
size = [0.2, 0.2]
resolution = [4, 4]
position = [0.0, 0.0, 0.85]
rotation = [30.0, 0.0, 0.0]
"""
)


def test_every_frame_is_checked_on_request(tmp_path):
    """One cloth passes through the other; at the end both are apart again."""
    scene = scene_from_toml(PASSING)
    last, every = (simulate(scene, tmp_path / "out.usda", check=check) for check in ("last", "every"))
    assert (last.intersections, last.checked_frames, last.bad_frames) == (0, 1, 0)
    assert every.intersections > 0
    assert every.checked_frames == 7
    assert 0 < every.bad_frames < 7
    assert last.profile_ms == {}


def test_the_profile_has_the_stages_of_contact(tmp_path):
    scene = scene_from_toml(PASSING.replace("gravity", 'contact = "all"\ngravity'))
    result = simulate(scene, tmp_path / "out.usda", check="every", profile=True)
    assert set(result.profile_ms) == {"detect", "integrate", "respond", "guard"}
    assert all(spent > 0.0 for spent in result.profile_ms.values())
    assert result.intersections == 0
    assert result.contact["contact_impacts"] > 0
    napkin, towel = (points(result.output, f"/World/Cloth/{name}", 6)[:, 2].mean() for name in ("napkin", "towel"))
    assert napkin > towel  # it is still above
    plain = simulate(scene, tmp_path / "plain.usda")
    assert np.array_equal(*(points(r.output, "/World/Cloth/napkin", 6) for r in (result, plain)))


def test_the_profile_of_a_single_frame_is_that_frames(tmp_path):
    """As the time of a frame is; the first frame is left aside only where there are others."""
    result = simulate("pendulum", tmp_path / "out.usda", frames=1, profile=True)
    assert 0.0 < sum(result.profile_ms.values()) <= result.ms_per_frame


def test_an_interruption_before_the_first_frame_leaves_the_old_cache(tmp_path, monkeypatch):
    path = tmp_path / "napkin.usdc"
    simulate(scene_from_toml(NAPKIN), path, frames=2)
    before = path.read_bytes()

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("warpcloth.simulation.Simulation.step", interrupted)
    with pytest.raises(KeyboardInterrupt):
        simulate(scene_from_toml(NAPKIN), path)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["napkin.usdc"]


def test_cloth_too_far_out_for_single_precision_is_refused(tmp_path):
    (tmp_path / "far.obj").write_text("v 1e6 0 0\nv 1000001 0 0\nv 1e6 1 0\nf 1 2 3\n")
    text = '[[cloth]]\nshape = "mesh"\npath = "far.obj"\n[simulation]\nprecision = "float32"\n'
    scene = scene_from_toml(text, folder=tmp_path)
    with pytest.raises(errors.InputError, match="reaches 1,000,001 m from the origin"):
        simulate(scene, tmp_path / "far.usdc", frames=1)
    assert simulate(scene, tmp_path / "far.usdc", frames=1, precision="float64").max_strain < 1e-3
