"""Frames as programs on the CPU: the same bits as launched one by one, with any number of threads."""

import ast
import threading

import numpy as np
import pytest
import trimesh
import warp as wp
from test_kernel_rules import FILES, decorated
from warpcloth.kernels import KernelSet

import warpcloth as wc
from warpcloth import program
from warpcloth.errors import InputError
from warpcloth.integrators import INTEGRATORS
from warpcloth.interop.handles import Handles
from warpcloth.launching import copy, fill, launch, only_if, recording, repeat_while
from warpcloth.program import ProgramWriter, record_program

KERNELS = KernelSet("float32")
THREADS = [1, 2, 3]


@wp.kernel
def count_step(
    # Out
    steps_out: wp.array(dtype=wp.int32),
):
    wp.atomic_add(steps_out, 0, 1)


def numbers(values, dtype=wp.int32) -> wp.array:
    return wp.array(np.array(values), dtype=dtype, device="cpu")


def crowd(threads: int | None, integrator="xpbd", contact="all", **options) -> wc.Simulation:
    """Two cloths thrown at each other above a ball that turns, one with bending."""
    fabrics = wc.Fabric(bending_rigidity=2e-6, bending_hysteresis=0.1), wc.Fabric(areal_density=0.3)
    starts = [{"transform": (0.01 * k, 0.0, 0.16 + 0.02 * k), "velocity": (0.0, 0.0, -4.0 * k)} for k in range(2)]
    cloths = [
        wc.Cloth.grid((0.3, 0.3), (11, 11), fabric, name=f"c{k}", **starts[k]) for k, fabric in enumerate(fabrics)
    ]
    spin = wc.Motion(times=[0.0, 1.0], positions=np.zeros((2, 3)), rotations=[[0, 0, 0], [0, 0, 6.0]])
    model = wc.Model.build(cloths, [wc.Sphere((0, 0, 0.05), 0.1, motion=spin), wc.Plane()], device="cpu")
    return wc.Simulation(model, integrator, contact=contact, threads=threads, **options)


def played(simulation: wc.Simulation, frames: int) -> list[np.ndarray]:
    simulation.run(frames, fps=60)
    return [simulation.state.particle_q.numpy().copy(), simulation.state.particle_qd.numpy().copy()]


@pytest.fixture(scope="module")
def launched():
    """The crowd after 12 frames, launch by launch."""
    return played(crowd(1, graph=False), 12)


@pytest.mark.parametrize("threads", [1, 2, 3, 7])
def test_contact_is_the_same_to_the_last_bit_with_any_number_of_threads(launched, threads):
    simulation = crowd(threads)
    assert simulation.threads == threads
    for ours, theirs in zip(played(simulation, 12), launched, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert simulation.contact.metrics()["contact_impacts"] > 0


@pytest.mark.parametrize("name", [name for name, scheme in INTEGRATORS.items() if scheme.capturable])
def test_every_scheme_is_the_same_to_the_last_bit(name):
    options = {"integrator": name, "contact": "obstacles", "substeps": 80}
    plain = played(crowd(1, graph=False, **options), 3)
    for threads in THREADS:
        for ours, theirs in zip(played(crowd(threads, **options), 3), plain, strict=True):
            np.testing.assert_array_equal(ours, theirs)


def test_properties_of_springs_may_change_between_frames():
    """Copies that the rows keep are brought up to date in recorded frames, too."""
    results = []
    for assembly in ("scatter", "gather"):
        simulation = crowd(2, "symplectic_euler", "obstacles", assembly=assembly, substeps=80)
        simulation.run(6)
        stiffness = simulation.model.spring_stiffness
        stiffness.assign(0.1 * stiffness.numpy())
        results.append(played(simulation, 4)[0])
    unchanged = played(crowd(2, "symplectic_euler", "obstacles", substeps=80), 10)[0]
    effect = np.abs(results[0] - unchanged).max()
    assert np.abs(results[0] - results[1]).max() < 0.01 * effect


def test_obstacles_that_deform_are_recorded(deforming_ball):
    results = []
    for graph in (False, True):
        cloth = wc.Cloth.grid((0.3, 0.3), (9, 9), transform=(0, 0, 0.13))
        model = wc.Model.build(cloth, deforming_ball, device="cpu")
        results.append(played(wc.Simulation(model, "xpbd", substeps=20, graph=graph, threads=2), 10)[0])
    np.testing.assert_array_equal(*results)


@pytest.fixture
def deforming_ball():
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    samples = np.stack([mesh.vertices, mesh.vertices * [1.0, 1.0, 1.3]])
    return wc.MeshObstacle(mesh.vertices, mesh.faces, sample_times=[0.0, 0.1], sample_points=samples)


@wp.kernel(enable_backward=False)
def count_down(left: wp.array(dtype=wp.int32), total: wp.array(dtype=wp.int32)):
    """One less left; counts how often that was."""
    left[0] = left[0] - 1
    total[0] = total[0] + 1


@wp.kernel(enable_backward=False)
def mark(thread_offset: int, value: int, out: wp.array(dtype=wp.int32)):
    """Adds to every element."""
    i = thread_offset + wp.tid()
    out[i] = out[i] + value


@pytest.mark.parametrize("threads", THREADS)
def test_loops_and_branches(threads):
    """A loop in a loop, with a branch, ranges and copies in it; run twice."""
    outer, inner, three, done, flag = (numbers([v]) for v in (4, 0, 3, 0, 0))
    values, copied = numbers(np.zeros(1000)), numbers(np.zeros(1000))

    def inside():
        launch(count_down, 1, [inner], [done])
        launch(mark, 1000, [1], [values])

    def outside():
        copy(inner, three)
        repeat_while(inner, inside)
        only_if(flag, lambda: fill(values, 7), lambda: launch(mark, 1000, [100], [values]))
        launch(count_down, 1, [outer], [done])
        fill(flag, 0)
        only_if(outer, lambda: copy(flag, numbers([0])))

    def frame():
        fill(outer, 4)
        fill(done)
        repeat_while(outer, outside)
        copy(copied, values, 500)

    recorded = record_program(frame, KERNELS, threads)
    assert not values.numpy().any()
    for times in (1, 2):
        recorded.run()
        assert outer.numpy()[0] == 0
        assert done.numpy()[0] == 4 * 4
        assert (values.numpy() == times * 4 * (3 + 100)).all()
        assert (copied.numpy()[:500] == values.numpy()[0]).all()
        assert not copied.numpy()[500:].any()


def test_launches_with_less_to_do_than_threads_are_run_once():
    """Between long ones: a helper that has nothing to do in one must not take its part of the next twice."""
    few, many = numbers(np.zeros(2)), numbers(np.zeros(4000))

    def frame():
        for _ in range(200):
            launch(mark, 2, [1], [few])
            launch(mark, 4000, [1], [many])

    recorded = record_program(frame, KERNELS, 4)
    for times in range(1, 501):
        recorded.run()
        assert (few.numpy() == 200 * times).all()
        assert (many.numpy() == 200 * times).all()


@pytest.mark.parametrize("threads", [2, 3])
def test_nobody_waits_for_a_thread_that_was_given_up(threads, monkeypatch):
    values = numbers(np.zeros(10))
    recorder = ProgramWriter(KERNELS, threads)
    with recording(recorder):
        for _ in range(3):
            launch(mark, 10, [1], [values])
    broken = recorder.program()

    def interrupted():
        raise KeyboardInterrupt

    first = broken._run.launch
    monkeypatch.setattr(broken._run, "launch", interrupted)
    with pytest.raises(KeyboardInterrupt):
        broken.run()
    monkeypatch.setattr(broken._run, "launch", first)
    fill(values)
    broken.run()
    assert (values.numpy() == 3).all()


def test_simulations_run_beside_each_other():
    """Each with two threads, from two threads of the caller's: they take turns."""
    alone = played(crowd(1), 6)
    found = [[], []]

    def play(k):
        found[k] = played(crowd(2), 6)

    callers = [threading.Thread(target=play, args=(k,)) for k in range(2)]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join(timeout=300)
        assert not caller.is_alive()
    for result in found:
        for ours, theirs in zip(result, alone, strict=True):
            np.testing.assert_array_equal(ours, theirs)


def test_simulations_of_one_model_run_beside_each_other():
    """At other times, so that its obstacle is elsewhere in each of them."""
    cloth = wc.Cloth.grid((0.5, 0.5), (20, 20), pins=["top_left", "top_right"], transform=(0, 0, 0.5))
    ball = wc.Sphere((0, 0, 0.35), 0.1, motion=wc.Motion.keyframes([(0, (0, 0, 0)), (0.5, (0, 0, 0.3))]))
    ends = []
    for beside in (False, True):
        model = wc.Model.build([cloth], [ball], device="cpu")
        pair = [wc.Simulation(model, "xpbd", substeps=20, threads=1) for _ in range(2)]
        pair[1].run(10)
        callers = [threading.Thread(target=one.run, args=(15,)) for one in pair]
        for caller in callers:
            caller.start()
            if not beside:
                caller.join()
        for caller in callers:
            caller.join(timeout=300)
            assert not caller.is_alive()
        ends.append([one.state.particle_q.numpy() for one in pair])
    np.testing.assert_array_equal(*ends)


def test_only_contiguous_arrays_are_copied():
    strided = wp.zeros((4, 4), dtype=wp.int32, device="cpu")[:, 1]
    with recording(ProgramWriter(KERNELS, 1)), pytest.raises(ValueError, match="contiguous"):
        copy(strided, numbers(np.zeros(4)))


def test_small_models_take_one_thread_and_large_ones_no_more_than_there_are(monkeypatch):
    monkeypatch.setattr(program, "cores", lambda: 4)
    assert [program.default_threads(n) for n in (0, 100, 2000, 9000, 10**6)] == [1, 1, 2, 4, 4]


def test_another_warp_replays_graphs(monkeypatch):
    """Where recorded launches cannot be taken apart, frames are Warp's own graphs, to the same result."""
    assert program.programs_work()
    expected = played(crowd(1), 4)
    monkeypatch.setattr("warpcloth.frames.programs_work", lambda: False)
    simulation = crowd(2)
    assert simulation.threads == 1
    for ours, theirs in zip(played(simulation, 4), expected, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_threads_out_of_range_are_refused():
    for bad in (0, -1, 1.5, 10**6):
        with pytest.raises(InputError, match="Threads"):
            crowd(bad)


def test_frames_with_hooks_take_one_thread():
    assert crowd(2, hooks=[wc.Hook()]).threads == 1


def test_a_hook_built_on_one_that_is_recorded_has_launches_of_its_own():
    """What a class says of its launches it does not say of those that others add to it."""

    class Counting(Handles):
        def after_step(self, start, end, dt):
            super().after_step(start, end, dt)
            wp.launch(count_step, 1, inputs=[], outputs=[steps], device="cpu")

    steps = wp.zeros(1, dtype=wp.int32, device="cpu")
    cloth = wc.Cloth.grid((0.2, 0.2), (4, 4), pins="left")
    model = wc.Model.build([cloth], device="cpu")
    sim = wc.Simulation(model, "xpbd", substeps=4, hooks=[Counting(model, None)])
    sim.run(5)
    assert steps.numpy()[0] == 20


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_what_runs_in_ranges_has_no_additions_that_threads_could_lose(path):
    """Warp's atomics are plain on the CPU; and a range has to know where it begins."""
    for kernel in decorated(ast.parse(path.read_text(encoding="utf-8")), "kernel"):
        code = ast.unparse(kernel)
        if "thread_offset" in code:
            assert kernel.args.args[0].arg == "thread_offset", kernel.name
            assert code.count("thread_offset + wp.tid()") == code.count("wp.tid()") == 1, kernel.name
            assert "wp.atomic" not in code, kernel.name
