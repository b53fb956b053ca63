"""What is seen of each frame when it is done: rest, steps that are too long, cloth that is locked."""

import warnings

import pytest

import warpcloth as wc
from warpcloth.errors import ContactWarning, StabilityWarning


def sheet(n: int, **options) -> wc.Cloth:
    return wc.Cloth.grid(size=(0.4, 0.4), resolution=(n, n), **options)


@pytest.mark.parametrize("fps", [25.0, 100.0])
def test_rest_is_a_speed_whatever_the_frame_rate(fps):
    """0.01 m/s for 0.25 s, of which the first frame tells nothing of before; each world by itself."""
    worlds = [([sheet(4, velocity=(speed, 0.0, 0.0))], []) for speed in (0.009, 0.011)]
    sim = wc.Simulation(wc.Model.build_worlds(worlds), gravity=(0.0, 0.0, 0.0))
    sim.run(int(0.24 * fps), fps)
    assert sim.settled_worlds().tolist() == [False, False]
    sim.run(int(0.06 * fps + 1), fps)
    assert sim.settled_worlds().tolist() == [True, False]


def test_too_few_substeps_are_warned_of_once_and_again_only_for_longer_steps():
    """At rest and without weight, from the start each time, so that nothing happens."""
    sim = wc.Simulation(wc.Model.build(sheet(30)), gravity=(0.0, 0.0, 0.0), substeps=2)
    counts = []
    for dt in (1 / 60, 1 / 60, 1 / 120, 1 / 50, 1 / 50):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            sim.step(dt)
        sim.reset()
        counts.append([item.category for item in caught].count(StabilityWarning))
    assert counts == [1, 0, 0, 1, 0]


def test_cloth_held_back_in_ten_frames_on_end_is_said_to_be_locked(monkeypatch):
    """Over a tenth of it in each of them, told once."""
    sim, held = wc.Simulation(wc.Model.build(sheet(10)), gravity=(0.0, 0.0, 0.0)), [0]
    monkeypatch.setattr(sim.contact, "metrics", lambda: {"contact_held": sum(held)})
    told = []
    for frame, count in enumerate([*[10] * 12, *[11] * 9, 10, *[11] * 25], 1):
        held.append(count)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            sim.step(1 / 60)
        told += [(frame, str(item.message)) for item in caught if item.category is ContactWarning]
    ((frame, sentence),) = told
    assert frame == 32
    assert sentence.startswith("Cloth is locked at t = 0.533333 s: over 10% of it is held back in every frame")
