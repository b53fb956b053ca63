"""What may be pickled and copied, and comes out as it went in, and what may not."""

import copy
import pickle
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import pytest

import warpcloth as wc

CLOTH = wc.Cloth.grid((0.2, 0.2), (3, 3), pins=wc.pin("left", motion=wc.Motion.spin((0, 0, 1), 1.0)))
BALL = wc.Sphere((0, 0, -0.3), 0.1, motion=wc.Motion.still())


def arrays(value: Any) -> Iterator[np.ndarray]:
    """All that a dataclass holds, however deep."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, tuple):
        for item in value:
            yield from arrays(item)
    elif is_dataclass(value):
        for field in fields(value):
            yield from arrays(getattr(value, field.name))


@pytest.mark.parametrize("again", [lambda thing: pickle.loads(pickle.dumps(thing)), copy.deepcopy, copy.copy])
@pytest.mark.parametrize("thing", [CLOTH, BALL, wc.Air(), wc.Box((0, 0, 0), (1, 1, 1)), wc.library_fabric("silk")])
def test_copies_are_as_they_were_and_read_only(thing, again):
    copied = again(thing)
    own, others = list(arrays(copied)), list(arrays(thing))
    assert len(own) == len(others)
    for mine, other in zip(own, others, strict=True):
        assert np.array_equal(mine, other)
        assert not mine.flags.writeable


@pytest.mark.parametrize("again", [pickle.dumps, copy.deepcopy, copy.copy])
def test_what_is_on_a_device_says_that_it_cannot_be_copied(again):
    sim = wc.Simulation(wc.Model.build(CLOTH, BALL))
    for thing, name in ((sim, "Simulation"), (sim.model, "Model"), (sim.state, "State")):
        with pytest.raises(TypeError, match=f"A {name} is made of arrays on a device and can be neither pickled"):
            again(thing)


@pytest.mark.parametrize("again", [lambda thing: pickle.loads(pickle.dumps(thing)), copy.deepcopy, copy.copy])
def test_copies_of_a_tape_are_of_no_simulation(again):
    sim = wc.Simulation(wc.Model.build(CLOTH))
    grab = sim.grab(4)
    grab.move((0.1, 0.1, 0.1))
    copied = again(sim.tape)
    grab.release()
    assert [event.act for event in copied.events] == ["take", "move"]
    assert copied.events == sim.tape.events[:2]
    assert copied.hands == []
