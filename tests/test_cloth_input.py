"""Values that are no cloth: one sentence each, for any value."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from warpcloth.cloth import Cloth, Pin, SpringNetwork, pin, pin_box, pin_nearest
from warpcloth.errors import InputError
from warpcloth.fabric import Fabric

GRID = Cloth.grid((1, 1), (3, 3))
SPRING = ([[0, 1]], [1.0], [1.0], [0.0], [0])


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: Cloth.grid((1, 1), (1, 5), name="flag"), r"^Cloth .flag.: resolution must be at least 2 × 2 .*1, 5\)"),
        (lambda: Cloth.grid((1, 1), (10**9, 10**9)), "at most 16,777,216 vertices"),
        (lambda: Cloth.grid((1, 1), (4.5, 4)), r"two whole numbers, got \(4.5, 4\)"),
        (lambda: Cloth.grid((1, 1), 8), r"resolution must be \(vertices along x, vertices along y\), got 8"),
        (lambda: Cloth.grid((1, -1)), "height must be a number greater than 0, got -1"),
        (lambda: Cloth.grid((1, 1e-7)), "height must be at least 1e-06 m"),
        (lambda: Cloth.grid((float("nan"), 1)), "width must be"),
        (lambda: Cloth.grid("ab"), "size must be"),
        (lambda: Cloth.grid(name=""), "name must be a non-empty"),
        (lambda: Cloth.grid(diagonals="alternat"), "did you mean 'alternate'"),
        (lambda: Cloth.grid(fabric="silk"), "fabric must be a Fabric, got str"),
        (lambda: Cloth.grid(velocity=(0, 0, float("inf"))), "velocity must be finite"),
        (lambda: Cloth.grid(transform=np.diag([2.0, 2, 2, 1])), "change the size instead of scaling"),
        (lambda: Cloth.grid(transform=np.diag([-1.0, 1, 1, 1])), "must only turn and move"),
        (lambda: Cloth.grid(pins="top_lft"), "did you mean 'top_left'"),
        (lambda: Cloth.grid((1, 1), (3, 3), pins=9), "vertex 9 is not one of 0 to 8"),
        (lambda: Cloth.grid((1, 1), (3, 3), pins=-1), "vertex -1 is not one of 0 to 8"),
        (lambda: Cloth.grid(pins=3.5), "got float"),
        (lambda: Cloth.grid(pins=pin_box((9, 9, 9), (10, 10, 10))), "no vertex lies between"),
        (lambda: Cloth.grid(pins=pin("left", "up")), "motion must be a Motion or None, got str"),
        (lambda: pin_box((1, 0, 0), (0, 1, 1)), "must not exceed"),
        (lambda: pin_nearest(np.zeros((0, 3))), "at least one point"),
        (lambda: Cloth.disc(0.0), "radius must be"),
        (lambda: Cloth.disc(0.5, 0), "resolution must be a whole number from 1 to 2,048"),
        (lambda: Cloth.disc(pins="left"), "must be one of 'rim', 'center'"),
        (lambda: Cloth.from_mesh(trimesh.creation.box(), pins="left"), "need a grid or disc"),
        (lambda: Fabric(areal_density=0), "Fabric 'plain': areal_density must be a number greater than 0, got 0"),
        (lambda: Fabric(bend_stiffness=-1), "bend_stiffness must be a number of at least 0"),
        (lambda: Fabric(friction="high"), "friction must be"),
        (lambda: Fabric(name=3), "name must be"),
        (lambda: replace(GRID, masses=np.zeros(9)), "vertex 0 has no mass"),
        (lambda: replace(GRID, triangles=[[0, 1, 9]], uvs=None, uv_indices=None), "refers to vertex 9"),
        (lambda: replace(GRID, points=GRID.points * np.nan), "9 vertices are not finite"),
        (lambda: replace(GRID, uv_indices=None), "must be given together"),
        (lambda: replace(GRID, uv_indices=GRID.uv_indices + 1), "outside 0 to 8"),
        (lambda: replace(GRID, springs=None), "springs must be a SpringNetwork"),
        (lambda: replace(GRID, pins=(Pin([9]),)), "pins refer to vertices outside"),
        (lambda: replace(GRID, pins=("left",)), "must be a Pin, got str"),
        (lambda: replace(GRID, springs=SpringNetwork([[0, 9]], [1], [1], [0], [0])), "refers to vertex 9"),
        (lambda: Pin([]), "at least one vertex"),
        (lambda: Pin([1, 1]), "named twice"),
        (lambda: SpringNetwork([[1, 1]], *SPRING[1:]), "spring 0 joins a particle to itself"),
        (lambda: SpringNetwork(SPRING[0], [0.0], *SPRING[2:]), "rest length"),
        (lambda: SpringNetwork(*SPRING[:2], [-1.0], *SPRING[3:]), "stiffness"),
        (lambda: SpringNetwork(*SPRING[:3], [-1.0], [0]), "damping"),
        (lambda: SpringNetwork(*SPRING[:4], [3]), "unknown kind"),
        (lambda: SpringNetwork(SPRING[0], [1.0, 2.0], *SPRING[2:]), "rest_lengths must be 1 numbers"),
    ],
)  # fmt: skip
def test_bad_cloth_is_one_sentence(build, words):
    with pytest.raises(InputError, match=words) as caught:
        build()
    assert str(caught.value).endswith(".")
    assert "\n" not in str(caught.value)


texts = st.sampled_from(["", "a", "left", "1", "\n", "\0", "nan", "rim"])
scalar = st.one_of(st.none(), st.booleans(), st.integers(-5, 20), st.integers(), st.floats(), texts)
junk = st.one_of(
    scalar, st.lists(scalar, max_size=4), st.tuples(scalar, scalar), st.just({}), st.just(b"x"), st.just(np.zeros(2))
)
small = st.tuples(st.integers(-1, 20), st.integers(-1, 20))


@pytest.mark.filterwarnings("ignore::warpcloth.errors.FabricWarning")
@given(st.data())
def test_any_value_gives_cloth_or_one_sentence(data):
    build, names = data.draw(
        st.sampled_from(
            [
                (Cloth.grid, ("size", "pins", "transform", "name", "velocity", "diagonals", "fabric")),
                (Cloth.disc, ("radius", "pins", "transform", "name", "velocity", "fabric")),
                (Cloth.from_mesh, ("source", "pins", "transform", "name", "velocity", "prim")),
                (Fabric, tuple(Fabric.__dataclass_fields__)),
            ]
        )
    )
    values = {name: data.draw(junk) for name in names if name == "source" or data.draw(st.booleans())}
    if build is Cloth.grid:
        values["resolution"] = data.draw(st.one_of(small, scalar, st.tuples(scalar, st.floats())))
    if build is Cloth.disc:
        values["resolution"] = data.draw(st.one_of(st.integers(-1, 20), st.floats(), texts))
    message = "."
    try:
        build(**values)
    except InputError as error:
        message = str(error)
    assert message.endswith(".")
    assert "\n" not in message
