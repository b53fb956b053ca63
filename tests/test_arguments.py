"""What a caller may hand over by mistake: every argument answers with a sentence, none is ignored."""

import array

import numpy as np
import pytest
import trimesh
import warp as wp

import warpcloth as wc
from warpcloth.errors import InputError, MeshError
from warpcloth.gradients import Rollout
from warpcloth.interop import VectorEnv

CLOTH = wc.Cloth.grid((0.5, 0.5), (4, 4), pins="left")
BALL = trimesh.creation.icosphere(subdivisions=1)
UNEVEN = [[1], [2, 3]]
NO_LIST = np.array(1.0)


def parts(**changes):
    return {name: getattr(CLOTH, name) for name in CLOTH.__dataclass_fields__} | changes


def network(**changes):
    usual = {"masses": 1.0, "rest_lengths": 1.0, "k_s": 1.0, "k_d": 0.0} | changes
    return wc.Model.from_springs([[0, 0, 0], [1, 0, 0]], springs=[[0, 1]], **usual)


class Forgetful(wc.Hook):
    def memory(self):
        return None


def simulation(**options):
    return wc.Simulation(wc.Model.build(CLOTH, device="cpu"), "xpbd", substeps=2, **options)


def towel(**options):
    return VectorEnv([CLOTH], worlds=1, integrator="xpbd", substeps=2, device="cpu", **options)


MISTAKES = {
    "a Warp array as a name": lambda: wc.Fabric(wp.zeros(3, dtype=float, device="cpu")),
    "a Warp array as a number": lambda: wc.Fabric(friction=wp.zeros(3, dtype=float, device="cpu")),
    "an array of Python's": lambda: wc.Fabric(friction=array.array("d", [1.0])),
    "a Warp array as a size": lambda: wc.Cloth.grid(size=wp.zeros(3, dtype=float, device="cpu")),
    "a list of Warp arrays": lambda: wc.Air(wind=[wp.zeros(1, dtype=float, device="cpu")] * 3),
    "a complex number": lambda: wc.Sphere(radius=np.complex128(1.0 + 1.0j)),
    "a truth value of numpy's": lambda: wc.Sphere(radius=np.True_),
    "bytes of a number": lambda: wc.Sphere(radius=bytearray(b"1")),
    "a text in an array": lambda: wc.Sphere(radius=np.array("1")),
    "an array with axes": lambda: wc.Sphere(radius=np.array([1.0])),
    "a number that is masked": lambda: wc.Sphere(center=np.ma.array([1.0, 2.0, 3.0], mask=[0, 1, 0])),
    "uneven pins": lambda: wc.Cloth.grid(pins=wc.pin(UNEVEN)),
    "uneven masses": lambda: network(masses=UNEVEN),
    "bytes as pins": lambda: wc.Cloth.grid(pins=b"left"),
    "no pins of a cloth": lambda: wc.Cloth(**parts(pins=None)),
    "points of whole numbers without end": lambda: wc.Cloth(**parts(points=10**400)),
    "keys without axes": lambda: wc.Motion.keyframes(NO_LIST),
    "cloths without axes": lambda: wc.Model.build(NO_LIST),
    "worlds without axes": lambda: wc.Model.build_worlds(NO_LIST),
    "handles without axes": lambda: towel(handles=NO_LIST),
    "a list as a device": lambda: wc.Model.build(CLOTH, device=["cpu"]),
    "uneven gravity": lambda: simulation(gravity=UNEVEN),
    "options without names": lambda: simulation(integrator_options=3),
    "no function for frames": lambda: simulation().run(0, on_frame=3),
    "frames longer than steps may be": lambda: simulation().run(1, fps=5e-4),
    "an uneven mask": lambda: simulation().reset(UNEVEN),
    "a force of another model": lambda: simulation(forces=[wc.AppliedForce(wc.Model.build(CLOTH, device="cpu"))]),
    "a memory that is none": lambda: simulation(hooks=[Forgetful()]),
    "obstacles beside a function": lambda: VectorEnv(lambda world: ([CLOTH], []), [wc.Plane()], worlds=1),
    "a tape of numbers": lambda: wc.GrabTape([1, 2]),
    "going on with another thing": lambda: simulation().continue_from(3, [0]),
    "going on with worlds that are not there": lambda: simulation().continue_from(simulation(), [1]),
    "going on with no worlds": lambda: simulation().continue_from(simulation(), []),
    "a scene's change that is no list": lambda: wc.load_scene("flag", "frames=3"),
    "a scene's changes that are numbers": lambda: wc.load_scene("flag", [3]),
    "prims that are no list": lambda: wc.load_scene("flag", cloth="/World"),
    "an output that is no path": lambda: wc.simulate("pendulum", 5, frames=1),
    "no function for the frames of a scene": lambda: wc.simulate("pendulum", "never.usdc", frames=1, on_frame=3),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("call", MISTAKES.values(), ids=MISTAKES.keys())
def test_mistakes_are_answered_by_one_sentence(call):
    with pytest.raises(InputError, match=r"^[^\n]+\.$"):
        call()


def test_a_prim_of_a_mesh_that_has_none_is_not_ignored():
    scene = trimesh.Scene({"ball": BALL})
    for source in (BALL, wc.Cloth):
        with pytest.raises(MeshError):
            wc.Cloth.from_mesh(source, prim="/ball")
    with pytest.raises(MeshError, match="got 5"):
        wc.Cloth.from_mesh(scene, prim=5)
    assert len(wc.Cloth.from_mesh(scene, prim="/ball").points) == len(BALL.vertices)


def test_what_is_a_number_is_taken_as_one():
    numbers = wp.array([1, 2], dtype=wp.int32, device="cpu")
    assert wc.Cloth.grid(resolution=(3, 3), pins=numbers).pinned.tolist() == [1, 2]
    assert wc.Sphere(radius=np.array(2.0)).radius == wc.Sphere(radius=np.float32(2.0)).radius == 2.0


def test_numbers_of_numpy_and_devices_of_warp_simulate_a_scene(tmp_path):
    options = {"frames": np.int64(1), "substeps": np.int32(3), "device": wp.get_device("cpu")}
    result = wc.simulate("pendulum", tmp_path / "pendulum.usdc", **options)
    assert (result.frames, result.substeps, result.device) == (1, 3, "cpu")


def test_another_integrator_cannot_be_gone_on_with():
    other = wc.Simulation(wc.Model.build(CLOTH, device="cpu"), substeps=2)
    with pytest.raises(InputError, match="symplectic_euler, not xpbd"):
        simulation().continue_from(other, [0])


def test_what_a_hand_holds_cannot_be_gone_on_with():
    other = simulation()
    grab = other.grab(0)
    with pytest.raises(InputError, match="release the grabs"):
        simulation().continue_from(other, [0])
    grab.release()
    simulation().continue_from(other, [0])


def test_frames_of_rollouts_are_no_longer_than_steps_may_be():
    model = wc.Model.build(CLOTH, device="cpu", differentiable=True)
    with pytest.raises(InputError, match="Fps must be"):
        Rollout(wc.Simulation(model, "xpbd", substeps=2), 1, fps=5e-4)


class Idle(wc.UserForce):
    """A force of nothing that says ``answer`` when asked for its energy."""

    answer: object = {}

    def accumulate(self, state, time_offset):
        pass

    def energy(self, state):
        return self.answer


def test_forces_of_ones_own_are_told_what_they_lack():
    model = wc.Model.build(CLOTH, device="cpu")
    with pytest.raises(InputError, match=r"Forces\[1\], UserForce, needs a method accumulate"):
        wc.Simulation(model, forces=[Idle(), wc.UserForce()])
    force = Idle()
    sim = wc.Simulation(model, forces=[force])
    for wrong in (None, 3.0, {"idle": None}, {"idle": np.ones(2)}):
        force.answer = wrong
        with pytest.raises(InputError, match="The method energy of Idle must return a dict of numbers"):
            sim.energy()
    force.answer = {"idle": np.float32(2.0)}
    assert sim.energy()["idle"] == 2.0
