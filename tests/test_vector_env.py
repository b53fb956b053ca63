"""Many worlds as one environment: actions, resets, arrays of other libraries."""

import numpy as np
import pytest
import warp as wp
from host_watch import no_host

import warpcloth as wc
from warpcloth import diagnostics
from warpcloth.errors import DivergedError, InputError
from warpcloth.interop import VectorEnv

FABRIC = wc.Fabric(stretch_stiffness=50.0, shear_stiffness=10.0, damping_time=2e-3)


def towel(n: int = 5, height: float = 0.5) -> wc.Cloth:
    return wc.Cloth.grid((0.2, 0.2), (n, n), FABRIC, pins=["top_left", "top_right"], transform=(0, 0, height))


def env(worlds: int = 3, **options) -> VectorEnv:
    return VectorEnv([towel()], [wc.Plane()], worlds=worlds, integrator="xpbd", substeps=10, device="cpu", **options)


def actions(worlds: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(-0.3, 0.3, (worlds, 2, 3))


def test_handles_go_where_actions_lead_them():
    e, a = env(), actions(3)
    held = [4 * 5, 4 * 5 + 4]
    start = np.from_dlpack(e.positions)[:, held].copy()
    for _ in range(6):
        e.step(a)
    np.testing.assert_allclose(np.from_dlpack(e.positions)[:, held], start + 0.1 * a, atol=2e-6)  # 60 roundings
    np.testing.assert_allclose(np.from_dlpack(e.velocities)[:, held], a, atol=1e-7)
    strain = diagnostics.spring_strain(e.simulation.model, e.simulation.state)
    assert np.abs(strain).max() < 0.2  # the cloth came along


@pytest.mark.parametrize(
    ("scheme", "substeps"),
    [("xpbd", 4), ("vbd", 4), ("projective_dynamics", 4), ("pbd", 4), ("implicit_euler", 2), ("implicit_midpoint", 2),
     ("bdf2", 2), ("linear_implicit_euler", 2), ("velocity_verlet", 20), ("rk4", 20), ("pefrl", 20)],
)  # fmt: skip
def test_what_flies_along_with_its_handles_is_not_pulled_at(scheme, substeps):
    """At one velocity nothing is strained, to rounding: within a step handles are where they are then, and move."""
    v = np.array([1.0, 0.5, 0.2])
    cloth = wc.Cloth.grid((0.4, 0.4), (5, 5), pins=["top_left", "top_right"], transform=(0, 0, 1), velocity=v)
    options = {"integrator": scheme, "substeps": substeps, "gravity": (0, 0, 0), "precision": "float64"}
    e = VectorEnv([cloth], worlds=1, dt=0.01, device="cpu", **options)
    for _ in range(5):
        e.step(np.tile(v, (1, 2, 1)))
    np.testing.assert_allclose(e.positions.numpy()[0], cloth.points + 0.05 * v, atol=1e-12)
    assert e.simulation.metrics()["max_strain"] < 1e-12


def test_slow_handles_get_there_and_may_be_put_elsewhere():
    """By a tenth of a micrometre a step, a metre from the origin: less than float32 tells."""
    cloth = wc.Cloth.grid((0.4, 0.4), (5, 5), pins=["top_left"], transform=(1.2, 0.0, 1.2))
    e = VectorEnv([cloth], worlds=1, integrator="xpbd", substeps=40, device="cpu")
    start, a = e.positions.numpy()[0, 20].copy(), np.array([[[0.0, 0.0, 2e-4]]])
    for shift in (0.0, 0.05):
        positions = e.positions.numpy()
        start[1] += shift
        positions[0, 20] = start
        e.positions.assign(positions)
        for _ in range(60):
            e.step(a)
        np.testing.assert_allclose(e.positions.numpy()[0, 20] - start, [0.0, 0.0, 2e-4], atol=2e-7)


def test_a_world_is_what_it_would_be_alone():
    many, a = env(3), actions(3)
    for _ in range(4):
        many.step(a)
    for world in range(3):
        alone = env(1)
        for _ in range(4):
            alone.step(a[world : world + 1])
        np.testing.assert_array_equal(alone.positions.numpy()[0], many.positions.numpy()[world])


def test_masked_resets_begin_anew_and_leave_the_rest():
    e, fresh, a = env(), env(), actions(3)
    for _ in range(3):
        e.step(a)
    e.reset(np.array([False, True, False]))
    np.testing.assert_allclose(e.times.numpy(), [0.05, 0.0, 0.05])
    for _ in range(2):
        e.step(a)
        fresh.step(a)
    np.testing.assert_array_equal(e.positions.numpy()[1], fresh.positions.numpy()[1])
    assert np.abs(e.positions.numpy()[0] - fresh.positions.numpy()[0]).max() > 1e-3


def test_steps_and_resets_stay_on_the_device(monkeypatch):
    e, a = env(), wp.array(actions(3), dtype=wp.vec3, device="cpu")
    mask = wp.array([True, False, True], dtype=wp.bool, device="cpu")
    for patched in (False, True):  # the first time compiles and allocates
        if patched:
            no_host(monkeypatch)
        for _ in range(3):
            e.step(a)
        e.reset(mask)


def test_handles_may_be_groups():
    e = env(1, handles=[[20, 24]])
    e.step(np.array([[[0.0, 0.0, 0.6]]]))
    np.testing.assert_allclose(e.positions.numpy()[0, [20, 24], 2], 0.51, atol=1e-6)


def test_worlds_may_differ():
    e = VectorEnv(lambda w: ([towel(height=0.1 + 0.2 * w)], [wc.Plane()]), worlds=3, device="cpu")
    np.testing.assert_allclose(e.positions.numpy()[:, 0, 2], [0.1, 0.3, 0.5])
    e.step()


class Foreign:
    """An array of a library that has nothing but DLPack."""

    def __init__(self, array: np.ndarray):
        self.array = array

    def __dlpack__(self, **options):
        return self.array.__dlpack__()

    def __dlpack_device__(self):
        return self.array.__dlpack_device__()


def test_actions_of_any_library_are_the_same_actions():
    a = actions(3).astype(np.float32)
    given = [a, a.astype(np.float64), wp.array(a, dtype=wp.vec3, device="cpu"), wp.array(a, dtype=float, device="cpu")]
    given.append(Foreign(a))
    results = []
    for kind in given:
        e = env()
        e.step(kind)
        results.append(e.positions.numpy())
    for result in results[1:]:
        np.testing.assert_array_equal(result, results[0])


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (np.zeros((3, 3)), "Actions must be 3 × 2 × 3 numbers, got an array of shape (3, 3)."),
        (wp.zeros((3, 1), dtype=wp.vec3, device="cpu"), "Actions must have shape (3, 2), got (3, 1)."),
        (wp.zeros((3, 2), dtype=wp.vec3d, device="cpu"), "Actions must be of dtype vec3f, got vec3d."),
    ],
)
def test_actions_that_do_not_fit_are_refused(given, sentence):
    with pytest.raises(InputError) as error:
        env().step(given)
    assert str(error.value) == sentence


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        (Foreign(np.zeros((3, 2, 3), np.complex64)), r"got Foreign \(.*complex.*\)\."),
        (Foreign(np.zeros((), np.float32)), r"got Foreign \(.*\)\."),
        (Foreign(np.zeros((3, 2, 3), ">f4")), r"got Foreign \(.*byte order\)\."),
        (Foreign(np.broadcast_to(np.float32(0.0), (3, 2, 3))), r"got Foreign \(.*readonly.*\)\."),
        (Foreign, r"got type \(.*\)\."),
    ],
)
def test_actions_that_warp_cannot_take_by_dlpack_are_refused(given, reason):
    """Whatever is raised by Warp, which lacks their dtype, or by the library that they are of."""
    sentence = r"^Actions must be an array of shape \(3, 2, 3\) that Warp can take by DLPack, "
    with pytest.raises(InputError, match=sentence + reason + "$"):
        env().step(given)


def test_worlds_that_do_not_match_are_refused():
    with pytest.raises(InputError, match="as many particles as world 0, 25, got 36 in world 1"):
        VectorEnv(lambda w: ([towel(5 + w)], []), worlds=2, device="cpu")
    bare = wc.Cloth.grid((0.2, 0.2), (5, 5), FABRIC)
    with pytest.raises(
        InputError, match=r"^handles\[1\] must name still pins, got particle 24, which is none in world 1\.$"
    ):
        VectorEnv(lambda w: ([towel(), bare][w : w + 1], []), worlds=2, handles=[[], [24]], device="cpu")
    for handles, sentence in [
        ([[24], [20, 24]], r"^handles\[1\] must not name particle 24, which handles\[0\] has\.$"),
        ([[24, 24]], r"^handles\[0\] must not name particle 24, which handles\[0\] has\.$"),
        (24, r"^Handles must be a list of lists of particles, got int\.$"),
    ]:
        with pytest.raises(InputError, match=sentence):
            env(handles=handles)
    with pytest.raises(InputError, match=r"^cloths\[0\] must be a warpcloth.Cloth, got NoneType\.$"):
        VectorEnv(None, worlds=2)
    with pytest.raises(InputError, match=r"^Hooks must be a list of warpcloth.Hook, got int\.$"):
        VectorEnv([towel()], worlds=2, hooks=3, device="cpu")
    assert VectorEnv(iter([towel()]), worlds=2, device="cpu").worlds == 2
    with pytest.raises(InputError, match=r"^handles\[0\] must name particles from 0 to 24, got 25\.$"):
        env(handles=[[25]])
    with pytest.raises(InputError, match="Worlds must be a whole number from 1 to 1,000,000, got 0"):
        env(0)


def test_looking_after_replays_does_not_turn_back_time():
    e = env(2, check=True)
    for mask in ([True, False], [False, True]):
        e.step(actions(2))
        e.reset(np.array(mask))
    e.step(actions(2))
    before = e.simulation.time
    e.simulation.verify()
    assert e.simulation.time == before == pytest.approx(3.0 / 60.0)


def test_a_world_that_was_torn_is_whole_after_its_reset():
    e = VectorEnv([towel()], [wc.Plane()], worlds=2, integrator="xpbd", substeps=10, contact="all", device="cpu")
    good, bad = np.zeros(e.action_shape), np.zeros(e.action_shape)
    bad[0] = 3000.0 * np.random.default_rng(0).normal(size=bad[0].shape)
    with pytest.raises(DivergedError) as caught:  # in the first step or one of the next
        [e.step(bad) for _ in range(5)]
    assert caught.value.worlds == (0,)
    e.reset(np.array([True, False]))
    for _ in range(3):
        e.step(good)
    assert np.isfinite(e.positions.numpy()).all()
