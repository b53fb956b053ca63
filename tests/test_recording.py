"""What recording a frame takes: time and memory, whatever the number of substeps."""

import ctypes
import mmap
import platform
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from test_program import KERNELS, THREADS, count_down, crowd, mark, numbers

import warpcloth as wc
from warpcloth.launching import copy, fill, launch, recording, repeat, repeat_while
from warpcloth.program import ProgramWriter, record_program


@pytest.mark.parametrize("threads", THREADS)
@pytest.mark.parametrize("count", [0, 1, 2, 3, 100])
def test_what_repeats_is_a_loop(threads, count):
    """One in another, with a loop of its own and a first time that is not like the others; run twice."""
    left, three, done, values = numbers([0]), numbers([3]), numbers([0]), numbers(np.zeros(1000))
    times = []

    def inside():
        copy(left, three)
        repeat_while(left, lambda: launch(count_down, 1, [left], [done]))
        launch(mark, 1000, [1], [values])

    def outside():
        if not times:
            launch(mark, 1000, [1000], [values])
        times.append(None)
        repeat(5, inside)

    recorded = record_program(lambda: repeat(count, outside), KERNELS, threads)
    assert len(times) == min(count, 3)  # once it was the same as the time before
    for runs in (1, 2):
        recorded.run()
        assert done.numpy()[0] == runs * count * 5 * 3
        assert (values.numpy() == runs * (count * 5 + 1000 * (count > 0))).all()


def test_loops_are_written_out_where_nothing_is_recorded():
    times = []
    repeat(3, lambda: times.append(None))
    assert len(times) == 3


@pytest.mark.parametrize("name", ["symplectic_euler", "velocity_verlet", "pefrl", "xpbd", "implicit_euler", "bdf2"])
def test_recording_a_frame_takes_no_longer_for_more_substeps(name, monkeypatch):
    asked = []
    monkeypatch.setattr(ProgramWriter, "launch", lambda self, *_: asked.append(None))
    counts = []
    for substeps in (32, 320):
        simulation = crowd(1, name, substeps=substeps, check=False)
        asked.clear()
        simulation.step(1e-4)
        counts.append(len(asked))
    assert counts[0] == counts[1] > 0


def test_vectors_are_told_apart_by_what_is_in_them():
    writer = ProgramWriter(KERNELS, 1)
    targets = [wp.zeros(3, dtype=wp.vec3, device="cpu") for _ in range(2)]
    with recording(writer):
        for target, height in zip(targets, (1.0, 2.0), strict=True):
            fill(target, wp.vec3(0.0, 0.0, height))
    writer.program().run()
    assert [target.numpy()[:, 2].tolist() for target in targets] == [[1.0] * 3, [2.0] * 3]


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the C library is not glibc")
def test_memory_that_building_has_freed_is_given_back():
    def resident() -> int:
        return int(Path("/proc/self/statm").read_text().split()[1]) * mmap.PAGESIZE

    model = wc.Model.build([wc.Cloth.grid((1.0, 1.0), (128, 128))], device="cpu")
    sim = wc.Simulation(model, "xpbd", contact="all", substeps=2)
    sim.step(1e-3)
    before = resident()
    ctypes.CDLL(None).malloc_trim(0)
    assert before - resident() < 100 * model.particle_count  # ten times as much where nothing is given back
