"""Cloth against itself and other cloth: free of intersections in, free of intersections out."""

import functools

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st

import warpcloth as wc
from warpcloth.contact import ContactStage, cloth_contact
from warpcloth.contact.intervals import intervals_needed
from warpcloth.errors import BadStartError, DivergedError, StabilityWarning
from warpcloth.intersections import count_intersections, intersections
from warpcloth.state import State
from warpcloth.surface import owned_features

SOFT = wc.Fabric(stretch_stiffness=60.0, shear_stiffness=12.0, bend_stiffness=0.5, thickness=0.004)
touching = functools.partial(wc.Simulation, contact="all")
INTEGRATORS = ("symplectic_euler", "xpbd")


def sheet(name="cloth", n=16, size=0.4, fabric=SOFT, **options) -> wc.Cloth:
    return wc.Cloth.grid(size=(size, size), resolution=(n, n), fabric=fabric, name=name, **options)


def assert_never_intersects(sim: wc.Simulation, frames: int) -> None:
    for frame in range(frames):
        sim.step(1 / 60)
        crossing = intersections(sim.model, sim.state).sum()
        assert crossing == 0, f"{crossing} pairs in frame {frame}"


def tilted(z: float, angle: float) -> np.ndarray:
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    turn[2, 3] = z
    return turn


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_drape_on_a_sphere_folds_without_crossing(integrator):
    model = wc.Model.build(sheet(n=20, transform=(0, 0, 0.24)), [wc.Sphere((0, 0, 0.12), 0.1), wc.Plane()])
    sim = touching(model, integrator=integrator, substeps=60)
    assert_never_intersects(sim, 60)
    without = touching(model, integrator=integrator, substeps=60, contact="obstacles")
    crossed = 0
    for _ in range(60):
        without.step(1 / 60)
        crossed += int(intersections(model, without.state).sum())
    assert crossed > 0  # otherwise this scene would prove nothing


@pytest.mark.parametrize("integrator", ["xpbd", "vbd"])
def test_few_sweeps_drape_stiff_cloth_without_shaking_it(integrator):
    """What contact does to a particle must not throw it across its sheet, as it did with `vbd`."""
    linen = sheet(n=32, size=1.2, fabric=wc.library_fabric("linen"), transform=(0, 0, 0.72))
    sim = touching(wc.Model.build(linen, [wc.Sphere((0, 0, 0.35), 0.35)]), integrator=integrator)
    for _ in range(24):
        sim.step(1 / 24)
        found = sim.metrics()
        assert found["mean_strain"] < 0.02  # 0.08 without
    assert found["contact_impacts"] < 10_000  # 100,000


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_sheets_thrown_at_each_other_do_not_pass(integrator):
    upper = sheet("upper", 14, transform=tilted(0.15, 0.4), velocity=(0, 0, -15))
    lower = sheet("lower", 11, transform=(0, 0, -0.15), velocity=(0.3, 0, 15))
    model = wc.Model.build([upper, lower])
    sim = touching(model, integrator=integrator, substeps=40, gravity=(0, 0, 0))
    before = momentum(sim)
    assert_never_intersects(sim, 12)
    x = sim.state.particle_q.numpy()
    assert x[: 14 * 14, 2].mean() > x[14 * 14 :, 2].mean()
    # What the guard stops loses its momentum: at these speeds up to two per cent of what each sheet brought.
    assert np.allclose(momentum(sim), before, atol=0.02 * 0.032 * 15)


def momentum(sim: wc.Simulation) -> np.ndarray:
    return (sim.model.particle_mass.numpy()[:, None] * sim.state.particle_qd.numpy()).sum(axis=0)


def test_response_alone_conserves_momentum():
    """Slow enough for the guard to have nothing to do."""
    upper = sheet("upper", 12, transform=tilted(0.01, 0.3), velocity=(0.2, 0, -0.4))
    lower = sheet("lower", 9, transform=(0, 0, -0.01))
    sim = touching(wc.Model.build([upper, lower], precision="float64"), gravity=(0, 0, 0), substeps=60)
    before = momentum(sim)
    assert_never_intersects(sim, 12)
    assert sim.metrics()["contact_held"] == 0
    assert np.abs(sim.state.particle_qd.numpy()[12 * 12 :]).max() > 0.01  # they did meet
    assert np.abs(momentum(sim) - before).max() < 1e-12


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_violent_folds_are_parted_and_nothing_is_held_back(integrator):
    """A sheet hung by two corners is thrown down at 12 m/s: layers meet faster than the response can part them."""
    upright = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0.5], [0, 0, 0, 1.0]])
    cloth = sheet(n=20, transform=upright, pins=["top_left", "top_right"], velocity=(0, 4, -12))
    model = wc.Model.build(cloth, wc.Plane((0, 0, 0.1)))
    sim = touching(model, integrator=integrator, substeps=30)
    assert_never_intersects(sim, 25)
    assert sim.metrics()["contact_impacts"] > 100
    assert sim.metrics()["contact_held"] == 0


def test_a_pile_comes_to_rest():
    layers = [sheet(f"layer {k}", 9, size=0.2, transform=tilted(0.02 + 0.02 * k, 0.5 * k)) for k in range(4)]
    sim = touching(wc.Model.build(layers, [wc.Plane()]), integrator="xpbd", substeps=20)
    assert_never_intersects(sim, 150)
    assert sim.settled
    heights = [sim.state.particle_q.numpy()[c.start : c.stop, 2].mean() for c in sim.model.cloths]
    assert np.all(np.diff(heights) > 0.002)  # layers keep their thickness


def test_worlds_do_not_meet():
    model = wc.Model.build_worlds([([sheet(n=6)], []), ([sheet(n=6, transform=(0, 0, -0.05))], [])])
    sim = touching(model, substeps=40)
    sim.run(30)
    z = sim.state.particle_q.numpy()[:, 2]
    assert np.allclose(z[:36] - z[36:], 0.05, atol=1e-5)


def test_contact_is_repeatable_and_the_same_in_a_graph():
    def result(graph: bool) -> np.ndarray:
        model = wc.Model.build(sheet(n=14, transform=(0, 0, 0.24)), [wc.Sphere((0, 0, 0.12), 0.1), wc.Plane()])
        sim = touching(model, substeps=50, graph=graph)
        sim.run(30)
        return sim.state.particle_q.numpy()

    captured = result(True)
    assert np.array_equal(captured, result(True))
    assert np.array_equal(captured, result(False))


def test_lists_that_are_too_short_grow_and_lose_nothing():
    """Nor is what the guard did counted again in a frame that is done again."""

    def result(capacity: int | None) -> tuple[np.ndarray, dict]:
        upper = sheet("a", 10, transform=tilted(0.02, 0.3), velocity=(0, 0, -25))
        model = wc.Model.build([upper, sheet("b", 10)], [wc.Plane((0, 0, -0.05))])
        sim = touching(model, substeps=40)
        if capacity is not None:
            sim.contact.cloths.pairs._allocate(capacity)
        sim.run(20)
        return sim.state.particle_q.numpy(), sim.contact.cloths.metrics()

    (short, counted_again), (long, counted) = result(1), result(None)
    assert np.array_equal(short, long)
    assert counted_again == counted  # a frame without room for pairs had hundreds of impacts


def test_an_intersecting_start_is_refused():
    upright = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])
    with pytest.raises(BadStartError, match=r"starts intersecting: .* 'flat', 'upright'"):
        touching(wc.Model.build([sheet("flat", 5), sheet("upright", 6, transform=upright)]))


@settings(max_examples=30)
@given(columns=st.integers(2, 9), rows=st.integers(2, 9))
def test_every_vertex_and_edge_has_one_owner(columns, rows):
    triangles = wc.Cloth.grid(size=(columns - 1, rows - 1), resolution=(columns, rows)).triangles
    owned = owned_features(triangles)
    vertices = [triangles[t, k] for t, bits in enumerate(owned) for k in range(3) if bits >> k & 1]
    assert sorted(vertices) == list(range(columns * rows))
    edges = {tuple(sorted((t[k], t[(k + 1) % 3]))) for t in triangles.tolist() for k in range(3)}
    owners = [(t, k) for t, bits in enumerate(owned) for k in range(3) if bits >> (k + 3) & 1]
    assert len(owners) == len(edges)


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6), speed=st.floats(0.5, 20.0), n=st.integers(5, 10))
def test_random_throws_stay_free_of_intersections(seed, speed, n):
    rng = np.random.default_rng(seed)
    cloths = []
    for k in range(3):
        velocity = speed * rng.normal(size=3) * [0.3, 0.3, 1.0]
        cloths.append(sheet(f"c{k}", n + k, size=0.3, transform=tilted(0.08 * k, rng.uniform(0, 6)), velocity=velocity))
    model = wc.Model.build(cloths, [wc.Plane((0, 0, -0.2)), wc.Box((0, 0, 0.4), (2, 2, 0.1))])
    sim = touching(model, integrator="xpbd", substeps=15)
    for _ in range(10):
        sim.step(1 / 60)
        assert intersections(model, sim.state).sum() == 0
    assert wp.get_device(model.device).is_cpu


def test_diverging_cloth_is_reported_and_never_hangs():
    sim = touching(wc.Model.build(wc.Cloth.grid(size=(0.4, 0.4), resolution=(30, 30), pins="left")), substeps=2)
    with pytest.warns(StabilityWarning), pytest.raises(DivergedError, match="diverged"):
        sim.run(200)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_spike_between_particles_does_not_poke_through(integrator):
    """The spike's tip is much finer than the cloth's cells; only edges and corners can hold it."""
    base = np.array([[0.03, 0, -0.2], [-0.015, 0.026, -0.2], [-0.015, -0.026, -0.2], [0.006, 0.004, 0.0]])
    spike = wc.MeshObstacle(base, [[0, 1, 3], [1, 2, 3], [2, 0, 3], [0, 2, 1]], thickness=0.002)
    cloth = sheet(n=8, transform=(0, 0, 0.03))
    sim = touching(wc.Model.build(cloth, [spike]), integrator=integrator, substeps=60)
    for _ in range(25):
        sim.step(1 / 60)
        x = sim.state.particle_q.numpy()
        points = np.vstack([x, base])
        faces = np.vstack([cloth.triangles, np.array([[0, 1, 3], [1, 2, 3], [2, 0, 3], [0, 2, 1]]) + len(x)])
        assert count_intersections(points, faces, len(cloth.triangles)) == (0, 0)
    assert np.abs(x[:, :2]).max() < 0.5  # it has not been thrown away


def test_edges_that_slide_past_each_other_do_not_flip():
    """A cloth edge passes an obstacle's edge without ever crossing it: no push, no friction."""
    square = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
    table = wc.MeshObstacle(square, [[0, 1, 2], [0, 2, 3]], friction=0.0, thickness=0.002)
    cloth = sheet(n=8, size=0.2, transform=tilted(0.0045, 0.3), velocity=(1.0, 0.0, 0.0))
    sim = touching(wc.Model.build(cloth, table), gravity=(0, 0, 0), substeps=50)
    sim.run(12)
    assert np.allclose(sim.state.particle_qd.numpy(), (1.0, 0.0, 0.0), atol=1e-4)


def test_intervals_follow_the_fastest_obstacle():
    """A quarter of an edge of 2 cm in each; a spin counts by the obstacle's reach, smooth keys by half more."""
    still, ball = wc.Plane(), wc.Sphere((0, 0, 0), 0.1)
    assert intervals_needed(0.02, [still, ball], 1 / 60) == 2  # no longer than 1/120 s
    flies = wc.Motion([0, 1], [[0, 0, 0], [6, 0, 0]], np.zeros((2, 3)))
    assert intervals_needed(0.02, [still, wc.Sphere((0, 0, 0), 0.1, motion=flies)], 1 / 60) == 20
    smooth = wc.Motion([0, 1], flies.positions, flies.rotations, interpolation="smooth")
    assert intervals_needed(0.02, [wc.Sphere((0, 0, 0), 0.1, motion=smooth)], 1 / 60) == 30
    spins = wc.Motion([0, 1], np.zeros((2, 3)), [[0, 0, 0], [0, 0, 60]])
    assert intervals_needed(0.02, [wc.Sphere((0, 0, 0), 0.1, motion=spins)], 1 / 60) == 20
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    swells = wc.MeshObstacle(points, [[0, 1, 2]], sample_times=[0, 1], sample_points=[points, points * 7])
    assert intervals_needed(0.02, [swells], 1 / 60) == 20


def test_small_obstacles_need_more_intervals():
    """A quarter of half their width, where that is less than an edge; a plate is wide, a rod is not."""
    flies = wc.Motion([0, 1], [[0, 0, 0], [6, 0, 0]], np.zeros((2, 3)))
    corners = np.array([[0.0, 0, 0], [0.01, 0, 0], [0, 0.02, 0], [0, 0, 0.03]])
    needle = wc.MeshObstacle(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], motion=flies)
    counts = [
        intervals_needed(0.02, [obstacle], 1 / 60)
        for obstacle in (
            wc.Sphere((0, 0, 0), 0.01, motion=flies),
            wc.Capsule((0, 0, 0), (0, 0, 1), 0.005, motion=flies),
            wc.Box((0, 0, 0), (1.0, 0.001, 1.0), motion=flies),
            wc.Box((0, 0, 0), (0.001, 0.02, 1.0), motion=flies),
            needle,
        )
    ]
    assert counts == [40, 80, 20, 40, 40]


@settings(max_examples=50)
@given(substeps=st.integers(1, 200), speed=st.floats(0.1, 50.0))
def test_intervals_share_the_substeps_evenly(substeps, speed):
    motion = wc.Motion([0, 1], [[0, 0, 0], [0, 0, -speed]], np.zeros((2, 3)))
    stage = ContactStage(wc.Model.build(sheet(n=5), wc.Sphere((0, 0, -1), 0.1, motion=motion)), "all")
    lengths = stage.interval_lengths(1 / 60, substeps)
    assert sum(lengths) == substeps
    assert len(lengths) == min(substeps, stage.intervals(1 / 60))
    assert max(lengths) - min(lengths) <= 1
    assert stage.intervals(1 / 60) == max(2, np.ceil(speed / 60 / (0.25 * 0.1) - 1e-9))  # edges of 0.1 m


def test_impacts_bring_cloth_to_the_obstacles_speed():
    """A free sheet is hit by a sheet-like obstacle that has the response's time step for itself: one long step."""
    points = np.array([[-0.5, -0.5, -0.05], [0.5, -0.5, -0.05], [0.5, 0.5, -0.05], [-0.5, 0.5, -0.05]])
    up = wc.Motion([0, 1], [[0, 0, 0], [0, 0, 6.0]], np.zeros((2, 3)))
    bat = wc.MeshObstacle(points, [[0, 1, 2], [0, 2, 3]], friction=0.0, motion=up)
    model = wc.Model.build(sheet(n=6), bat)
    cloths = touching(model, integrator="xpbd", gravity=(0, 0, 0), substeps=1).contact.cloths
    state = State.of(model)
    cloths.begin(state, 0.01)
    model.shapes.place(model.tracks, state.world_time, 0.01)  # 6 cm: through the cloth at 5 cm
    cloths.surface.place(state.particle_q, model.shapes.end, cloths.now)
    cloths.end(state, 0.01)
    x, v = state.particle_q.numpy(), state.particle_qd.numpy()
    assert cloths.metrics()["contact_impacts"] > 0
    assert cloths.metrics()["contact_pinched"] == 0
    assert x[:, 2].min() > 0.01  # in front of the bat
    assert np.abs(v[:, 2] - 6.0).max() < 0.06


@pytest.mark.filterwarnings("ignore::warpcloth.errors.ContactWarning")
@pytest.mark.parametrize("shape", ["mesh", "box", "sphere"])
def test_where_parting_does_not_end_cloth_is_carried_by_what_moves(shape, monkeypatch):
    """With no rounds of parting all is up to the guard, and standing still is no way out of an obstacle's way."""
    monkeypatch.setattr(cloth_contact, "ROUNDS", 0)
    turning = wc.Motion([0, 0.3], [[0, 0, 0], [0.2, 0, 1.5]], [[0, 0, 0], [2.0, 1.0, 3.0]])
    tetra = 0.2 * np.array([[0, 0, 1], [0.9, 0, -0.5], [-0.5, 0.8, -0.5], [-0.5, -0.8, -0.5]]) - [0, 0, 0.25]
    obstacle = {
        "mesh": wc.MeshObstacle(tetra, [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]], motion=turning),
        "box": wc.Box((0, 0, -0.15), (0.2, 0.15, 0.1), motion=turning),
        "sphere": wc.Sphere((0, 0, -0.15), 0.1, motion=turning),
    }[shape]
    upper = sheet("upper", 10, transform=tilted(0.03, 0.4), velocity=(0, 0, -10))
    sim = touching(wc.Model.build([sheet("lower", 12), upper], obstacle), "xpbd", (0, 0, 0), 30)
    assert_never_intersects(sim, 20)
    found = sim.metrics()
    assert found["contact_held"] > 0
    assert found["contact_pinched"] == 0
    assert found["max_penetration_m"] <= 1e-4


@pytest.mark.filterwarnings("ignore::warpcloth.errors.ContactWarning")
def test_where_parting_does_not_end_cloth_is_carried_by_pins(monkeypatch):
    monkeypatch.setattr(cloth_contact, "ROUNDS", 0)
    down = wc.Motion([0, 0.3], [[0, 0, 0], [0.1, 0, -1.5]], [[0, 0, 0], [0.5, 1.0, 0.0]])
    upper = sheet("upper", 10, transform=tilted(0.03, 0.4), pins=wc.pin("left", motion=down))
    sim = touching(wc.Model.build([sheet("lower", 12), upper]), "xpbd", (0, 0, 0), 30)
    assert_never_intersects(sim, 15)
    assert sim.metrics()["contact_held"] > 0
    assert sim.metrics()["contact_pinched"] == 0


def test_torn_cloth_names_its_world():
    model = wc.Model.build_worlds([([sheet(n=4)], []), ([sheet(n=4)], []), ([sheet(n=4)], [])])
    sim = touching(model, integrator="xpbd", gravity=(0, 0, 0), substeps=4)
    velocities = np.zeros((48, 3))
    velocities[20] = (0, 0, 1e4)
    sim.state.particle_qd.assign(velocities)
    with pytest.raises(DivergedError, match="edges grew") as failure:
        sim.step(1 / 60)
    assert failure.value.worlds == (1,)


def test_single_steps_know_no_contact_among_cloths(monkeypatch):
    """What is listed is what the guard of the frame before looked at, which may be anywhere by then."""
    sim = touching(wc.Model.build([sheet(), sheet("other", transform=(0, 0, 0.003))]), "xpbd", substeps=4)
    sim.step(1 / 60)
    asked = []
    monkeypatch.setattr(sim.contact.cloths, "resolve", lambda *_: asked.append("to part them"))
    sim.substep(1e-3)
    assert not asked
