"""Whether what a model has is seen to change."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import warpcloth as wc
from warpcloth.launching import fill
from warpcloth.watch import Watch

NAMES = ("spring_rest_length", "spring_stiffness", "spring_damping")


def watched(springs: int, precision: str) -> tuple[wc.Model, Watch]:
    rng = np.random.default_rng(springs)
    ends = np.stack([np.arange(springs), np.arange(springs) + 1], axis=1)
    law = rng.uniform(1.0, 2.0, (3, springs))
    model = wc.Model.from_springs(
        rng.normal(size=(springs + 1, 3)), 1.0, ends, *law, precision=precision, device="cpu"
    )  # fmt: skip
    return model, Watch(model, *NAMES)


def changes(watch: Watch, counter: list[int]) -> bool:
    before = len(counter)
    watch.if_changed(lambda: counter.append(1))
    return len(counter) > before


@settings(max_examples=60)
@given(
    springs=st.integers(1, 400),
    name=st.sampled_from(NAMES),
    which=st.integers(0, 10**6),
    precision=st.sampled_from(["float32", "float64"]),
)
def test_the_last_bit_of_any_number_shows_and_nothing_else_does(springs, name, which, precision):
    model, watch = watched(springs, precision)
    counter: list[int] = []
    assert changes(watch, counter)  # the first time
    assert not changes(watch, counter)
    array = getattr(model, name)
    values = array.numpy().copy()
    values[which % springs] = np.nextafter(values[which % springs], values.dtype.type(9.0))
    array.assign(values)
    assert changes(watch, counter)
    assert not changes(watch, counter)
    array.assign(array.numpy())
    assert not changes(watch, counter)


@pytest.mark.parametrize("shift", [1, 8, 16])
def test_numbers_that_change_places_show(shift):
    model, watch = watched(200, "float32")
    counter: list[int] = []
    changes(watch, counter)
    values = model.spring_stiffness.numpy()
    values[:30] = np.roll(values[:30], shift)
    model.spring_stiffness.assign(values)
    assert changes(watch, counter)
    fill(model.spring_damping, 0.5)
    assert changes(watch, counter)


def test_where_there_are_gradients_everything_counts_as_changed():
    cloth = wc.Cloth.grid((0.1, 0.1), (3, 3))
    watch, counter = Watch(wc.Model.build(cloth, differentiable=True), *NAMES), []
    assert changes(watch, counter)
    assert changes(watch, counter)
