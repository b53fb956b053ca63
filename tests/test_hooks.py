"""Forces, kernels and obstacles of the caller's own, and frames in graphs of the caller's own."""

import contextlib
import threading
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from embedding_kernels import Lowest, Pull, Slope, track_lowest
from host_watch import no_host
from integrator_problems import NAMES

import warpcloth as wc
from warpcloth.contact.pair_list import PairList
from warpcloth.errors import InputError, SimulationError
from warpcloth.integrators import INTEGRATORS
from warpcloth.worlds import world_mask

SOFT = wc.Fabric(stretch_stiffness=20.0, shear_stiffness=5.0, damping_time=1e-3, friction=0.3)
FRAME = 1.0 / 60.0
CAPTURABLE = [name for name in NAMES if INTEGRATORS[name].capturable]


def model(height: float = 0.02, **options) -> wc.Model:
    cloth = wc.Cloth.grid((0.2, 0.2), (6, 6), SOFT, pins="left", transform=(0.0, 0.0, height))
    return wc.Model.build([cloth], [wc.Sphere((0.05, 0.0, -0.1), 0.1)], device="cpu", **options)


def embedded(m: wc.Model, name: str = "symplectic_euler", **options) -> wc.Simulation:
    own = {"forces": [Pull(m, (0.1, 0.0, -0.2), 0.01)], "hooks": [Slope(m, (0, 0, -0.03), (0.1, 0, 1), 0.2), Lowest(m)]}
    return wc.Simulation(m, name, substeps=20, **own, **options)


def phase(sim: wc.Simulation) -> np.ndarray:
    return np.hstack([sim.state.particle_q.numpy(), sim.state.particle_qd.numpy()])


def test_an_applied_force_acts_like_gravity():
    m = model()
    weight = np.outer(m.particle_mass.numpy(), (0.0, 0.0, -9.81)).astype(np.float32)
    force = wc.AppliedForce(m, wp.array(weight, dtype=wp.vec3, device="cpu"))
    pushed, fallen = (
        wc.Simulation(m, substeps=20, gravity=g, forces=f) for g, f in [((0, 0, 0), [force]), ((0, 0, -9.81), [])]
    )
    for sim in (pushed, fallen):
        sim.run(5)
    assert np.abs(fallen.state.particle_q.numpy() - m.particle_q.numpy()).max() > 0.01
    np.testing.assert_allclose(phase(pushed), phase(fallen), rtol=0, atol=2e-5)  # sums are rounded in another order
    force.force.zero_()  # seen by the captured frame
    before = pushed.state.particle_qd.numpy()[:, 2].mean()
    pushed.run(1)
    fallen.run(1)
    assert pushed.state.particle_qd.numpy()[:, 2].mean() > fallen.state.particle_qd.numpy()[:, 2].mean()
    assert before < 0.0


@pytest.mark.parametrize("name", CAPTURABLE)
def test_a_frame_in_the_callers_graph_is_the_frame(name):
    """Together with kernels of the caller's before and after it; bitwise."""
    plain = embedded(model(), name, graph=False, contact="all")
    caught = embedded(model(), name, contact="all", check=False)
    seen = [wp.full(36, 1e9, dtype=float, device="cpu") for _ in range(2)]
    for sim, lowest in ((plain, seen[0]), (caught, seen[1])):
        sim.step(FRAME)
        wp.launch(track_lowest, 36, [sim.state.particle_q], [lowest], device="cpu")
    with wp.ScopedCapture(device="cpu") as capture:
        caught.step(FRAME)
        wp.launch(track_lowest, 36, [caught.state.particle_q], [seen[1]], device="cpu")
    for _ in range(4):
        plain.step(FRAME)
        wp.launch(track_lowest, 36, [plain.state.particle_q], [seen[0]], device="cpu")
        wp.capture_launch(capture.graph)
    assert caught.time == pytest.approx(FRAME)
    caught.verify()
    assert caught.time == pytest.approx(plain.time)
    np.testing.assert_array_equal(phase(caught), phase(plain))
    np.testing.assert_array_equal(seen[1].numpy(), seen[0].numpy())
    np.testing.assert_array_equal(caught.hooks[1].lowest.numpy(), plain.hooks[1].lowest.numpy())
    assert seen[0].numpy().min() < 0.0


def test_pairs_missed_in_replays_are_reported(monkeypatch):
    """And after that there is room for them."""
    usual = PairList.__init__
    monkeypatch.setattr(PairList, "__init__", lambda self, model, capacity: usual(self, model, 1))
    layers = [wc.Cloth.grid((0.2, 0.2), (6, 6), SOFT, transform=(0, 0, z), name=f"at {z}") for z in (0.1, 0.1021)]
    layered = wc.Model.build(layers, device="cpu")
    sim = wc.Simulation(layered, substeps=20, contact="all", check=False)
    missed = 0
    while missed < 9:  # one list after the other grows
        sim.reset()
        with wp.ScopedCapture(device="cpu") as capture:
            sim.step(FRAME)
        wp.capture_launch(capture.graph)
        try:
            sim.verify()
            break
        except SimulationError:
            missed += 1
    assert 0 < missed < 9
    plain = wc.Simulation(layered, substeps=20, contact="all")
    plain.step(FRAME)
    np.testing.assert_array_equal(phase(sim), phase(plain))


def test_frames_of_the_simulations_own_use_the_room_made_for_replays(monkeypatch):
    """They had been recorded before there was need of it."""
    usual = PairList.__init__
    monkeypatch.setattr(PairList, "__init__", lambda self, model, capacity: usual(self, model, 1))
    layered = wc.Model.build(
        [wc.Cloth.grid((0.2, 0.2), (6, 6), SOFT, transform=(0, 0, z), name=f"at {z}") for z in (0.1, 0.5)], device="cpu"
    )
    close = layered.particle_q.numpy() - np.where(np.arange(72) < 36, 0.0, 0.3985)[:, None] * (0.0, 0.0, 1.0)
    sim, plain = (wc.Simulation(layered, substeps=20, contact="all", check=False) for _ in range(2))
    for _ in range(2):
        sim.step(FRAME)
    for _ in range(9):
        sim.reset()
        sim.state.particle_q.assign(close)
        with wp.ScopedCapture(device="cpu") as capture:
            sim.step(FRAME)
        wp.capture_launch(capture.graph)
        with contextlib.suppress(SimulationError):
            sim.verify()
            break
    else:
        pytest.fail("room never was enough")
    for one in (sim, plain):
        one.reset()
        one.state.particle_q.assign(close)
        one.step(FRAME)
    np.testing.assert_array_equal(phase(sim), phase(plain))


def test_verified_time_is_that_of_the_world_that_has_gone_on_longest():
    sim = wc.Simulation(
        wc.Model.build_worlds(2 * [([wc.Cloth.grid((0.2, 0.2), (3, 3))], [])]), substeps=20, check=False
    )
    sim.step(FRAME)
    with wp.ScopedCapture(device="cpu") as capture:
        sim.step(FRAME)
    wp.capture_launch(capture.graph)
    sim.reset([True, False])
    wp.capture_launch(capture.graph)
    sim.verify()
    assert sim.time == pytest.approx(3 * FRAME)


def test_the_simulations_own_graph_has_forces_and_hooks_in_it():
    plain, graph = embedded(model(), graph=False), embedded(model())
    for sim in (plain, graph):
        sim.run(5)
    assert graph._frames.recorded
    np.testing.assert_array_equal(phase(graph), phase(plain))


@pytest.mark.parametrize("graph", [False, True])
@pytest.mark.parametrize("name", CAPTURABLE)
def test_a_step_does_not_look_back_to_the_host(name, graph, monkeypatch):
    sim = embedded(model(), name, check=False, graph=graph)
    sim.step(FRAME)
    with monkeypatch.context() as patch:
        no_host(patch)
        sim.step(FRAME)
        sim.step(FRAME)
    with wp.ScopedCapture(device="cpu"), monkeypatch.context() as patch:
        no_host(patch)
        sim.step(FRAME)


class Once(wc.Hook):
    """Does something in the middle of one substep."""

    def __init__(self, substep: int, act):
        self.left, self.act = substep, act

    def after_step(self, start: wc.State, end: wc.State, dt: float) -> None:
        self.left -= 1
        if self.left == 0:
            self.act()


def fail() -> None:
    raise ZeroDivisionError


@pytest.mark.parametrize("name", ["symplectic_euler", "imex", "bdf2", "dormand_prince"])
@pytest.mark.parametrize("contact", ["obstacles", "all"])
@pytest.mark.parametrize("frame", [0, 1])
def test_a_frame_in_which_a_hook_raises_has_not_been(frame, contact, name):
    """Neither one that runs at once, the first, nor one that is being recorded, the second; whatever schemes keep."""
    hooks = [Once(20 * frame + 9, act) for act in (fail, lambda: None)]
    sims = [wc.Simulation(model(), name, substeps=20, hooks=[hook], contact=contact) for hook in hooks]
    for sim in sims:
        grab = sim.grab(35)
        for number in range(3):
            grab.move((0.1, 0.1, 0.02 + 0.01 * number))
            if sim is sims[0] and number == frame:
                before, figures = phase(sim), sim.integrator.metrics()
                with pytest.raises(ZeroDivisionError):
                    sim.step(FRAME)
                np.testing.assert_array_equal(phase(sim), before)
                assert sim.integrator.metrics() == figures
                assert sim.state.world_time.numpy()[0] == pytest.approx(sim.time) == pytest.approx(number * FRAME)
            sim.step(FRAME)
    np.testing.assert_array_equal(phase(sims[0]), phase(sims[1]))


def test_a_frame_that_has_not_been_is_not_counted():
    def count_and_fail() -> None:
        sim.contact.cloths.counts.fill_(5)
        fail()

    sim = wc.Simulation(model(), substeps=20, hooks=[Once(9, count_and_fail)], contact="all")
    with pytest.raises(ZeroDivisionError):
        sim.step(FRAME)
    assert set(sim.contact.metrics().values()) == {0}


def test_simulations_in_other_threads_wait_while_a_frame_is_recorded():
    """And none is recorded in the middle of a frame of theirs: Warp would put their launches into the graph. What runs
    without being recorded keeps nobody waiting."""
    plain, ready = wc.Simulation(model(), substeps=20), []

    def make() -> None:
        ready.append(wc.Simulation(model(), substeps=20))
        ready[-1].run(2)

    other = threading.Thread(target=make)

    def begin() -> None:
        assert sim.model.device.is_capturing
        other.start()
        other.join(0.3)

    sim = wc.Simulation(model(), substeps=20, hooks=[Once(29, begin)])
    sim.run(2)
    other.join()

    def step_the_other() -> None:
        thread = threading.Thread(target=within.run, args=(1,))
        thread.start()
        thread.join()

    def make_another() -> None:
        thread = threading.Thread(target=make)
        thread.start()
        thread.join(10.0)
        assert not thread.is_alive()

    within = wc.Simulation(model(), substeps=20, hooks=[Once(29, make_another)])
    within.run(1)

    slow = wc.Simulation(model(), substeps=20, hooks=[Once(9, step_the_other)])
    slow.run(2)
    assert not within._frames.recorded
    plain.run(2)
    for each in (sim, *ready, within, slow):
        np.testing.assert_array_equal(phase(each), phase(plain))
        assert each.time == pytest.approx(2.0 * FRAME)


def test_the_test_for_round_trips_can_fail(monkeypatch):
    sim = embedded(model(), check=True)
    sim.step(FRAME)
    no_host(monkeypatch)
    with pytest.raises(AssertionError, match="read something back"):
        sim.step(FRAME)


def test_an_obstacle_of_the_callers_own_acts_like_a_built_in_one():
    """Sliding down 30° with friction: s = ½ g (sin θ − μ cos θ) t²."""
    normal = (0.5, 0.0, np.sqrt(0.75))
    cloth = wc.Cloth.grid((0.1, 0.1), (4, 4), SOFT, transform=_on_slope(30.0, 0.5 * SOFT.thickness))
    bare = wc.Model.build([cloth], device="cpu")
    own = wc.Simulation(bare, "xpbd", substeps=20, hooks=[Slope(bare, (0, 0, 0), normal, 0.3)])
    own.run(30)
    moved = own.state.particle_q.numpy() - bare.particle_q.numpy()
    along = moved @ np.array([np.sqrt(0.75), 0.0, -0.5])
    assert along.mean() == pytest.approx(0.294536, rel=5e-3)
    assert np.abs(moved @ np.array(normal)).max() < 1e-5


def _on_slope(angle: float, height: float) -> np.ndarray:
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    turn = np.eye(4)
    turn[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    turn[:3, 3] = height * turn[:3, 2]
    return turn


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"hooks": [3]}, r"hooks\[0\] must be a warpcloth.Hook, got int."),
        ({"hooks": Lowest}, "Hooks must be a list of warpcloth.Hook, got type."),
        ({"forces": [Lowest]}, r"forces\[0\] must be a warpcloth.UserForce, got type."),
        ({"forces": 1}, "Forces must be a list of warpcloth.UserForce, got int."),
    ],
)
def test_what_is_no_hook_is_refused(options, sentence):
    with pytest.raises(InputError, match=f"^{sentence}$"):
        wc.Simulation(model(), **options)


@pytest.mark.parametrize(
    ("array", "sentence"),
    [
        (np.zeros((36, 3)), "Force must be a warp.array, got ndarray."),
        (wp.zeros(35, dtype=wp.vec3, device="cpu"), r"Force must have shape \(36,\), got \(35,\)."),
        (wp.zeros(36, dtype=wp.vec3d, device="cpu"), "Force must be of dtype vec3f, got vec3d."),
        (wp.zeros((36, 2), dtype=wp.vec3, device="cpu")[:, 0], r"Force must be contiguous, got strides \(24,\)."),
    ],
)
def test_arrays_that_do_not_fit_are_refused(array, sentence):
    with pytest.raises(InputError, match=f"^{sentence}$"):
        wc.AppliedForce(model(), array)


@pytest.mark.parametrize("what", [None, "model"])
def test_applied_forces_need_a_model(what):
    with pytest.raises(InputError, match=rf"^AppliedForce needs a Model, got {type(what).__name__}\.$"):
        wc.AppliedForce(what)


def test_arrays_on_another_device_are_refused():
    """As there may be no second device here, the model only says that it is on one."""
    elsewhere = SimpleNamespace(device="cuda:0", vec3=wp.vec3, particle_count=36, world_count=1)
    force, mask = (wp.zeros(n, dtype=t, device="cpu") for n, t in ((36, wp.vec3), (1, wp.bool)))
    with pytest.raises(InputError, match=r"^Force must be on device cuda:0, got an array on cpu\.$"):
        wc.AppliedForce(elsewhere, force)
    with pytest.raises(InputError, match=r"^World mask must be on device cuda:0, got an array on cpu\.$"):
        world_mask(mask, elsewhere)


def test_what_cannot_be_recorded_says_why():
    for options, sentence in [
        ({"integrator": "dormand_prince", "substeps": 2}, "dormand_prince chooses its steps on the host"),
        ({"substeps": "auto"}, 'substeps="auto" is not known yet'),
    ]:
        sim = wc.Simulation(model(), check=False, **options)
        with pytest.raises(InputError, match=sentence), wp.ScopedCapture(device="cpu"):
            sim.step(FRAME)
