"""Position-based schemes: exact for one spring, converging to the implicit step, conserving what they should."""

from itertools import pairwise

import numpy as np
import pytest
import trimesh

import warpcloth as wc
from warpcloth.integrators.colouring import grouped, particle_colours, spring_colours

SCHEMES = [
    ("pbd", {"stiffness": 0.3}),
    ("xpbd", {}),
    ("xpbd", {"iterations": 4, "warm_start": 1.0}),
    ("vbd", {"iterations": 3, "acceleration": 0.5}),
    ("projective_dynamics", {"iterations": 5}),
    ("projective_dynamics", {"iterations": 2, "solver": "jacobi"}),
    ("projective_dynamics", {"iterations": 2, "solver": "cg"}),
]
every_scheme = pytest.mark.parametrize(("name", "options"), SCHEMES, ids=[f"{n}-{o}" for n, o in SCHEMES])


def network(seed: int, particles: int = 24, springs: int = 60, damping: float = 0.5) -> dict:
    """A stretched random network: rest lengths are shorter than the springs, in float64."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(particles, 3))
    ends = rng.integers(0, particles, (springs, 2))
    ends[:, 1] = np.where(ends[:, 0] == ends[:, 1], (ends[:, 1] + 1) % particles, ends[:, 1])
    return {
        "positions": x,
        "masses": rng.uniform(0.5, 2.0, particles),
        "springs": ends,
        "rest_lengths": np.linalg.norm(x[ends[:, 1]] - x[ends[:, 0]], axis=1) * rng.uniform(0.6, 0.9, springs),
        "k_s": rng.uniform(10.0, 100.0, springs),
        "k_d": damping * rng.uniform(0.5, 1.0, springs),
        "velocities": rng.normal(size=(particles, 3)),
        "precision": "float64",
    }


def after_steps(net: dict, name: str, options: dict, h: float, steps: int = 1, gravity=(0.0, 0.0, 0.0), graph=False):
    sim = wc.Simulation(
        wc.Model.from_springs(**net), name, gravity, substeps=1, integrator_options=options, graph=graph
    )
    for _ in range(steps):
        sim.step(h)
    return sim.state.particle_q.numpy(), sim.state.particle_qd.numpy()


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("xpbd", {}),
        ("xpbd", {"iterations": 3}),
        ("vbd", {"iterations": 1}),
        ("projective_dynamics", {"iterations": 1, "solver": "jacobi"}),
        ("projective_dynamics", {"iterations": 1, "solver": "cg"}),
    ],
)
def test_one_iteration_on_one_spring_is_implicit_euler(name, options):
    """The damped spring of section 1, where implicit Euler is a linear equation."""
    m, k_s, k_d, r, g, h = 0.05, 20.0, 0.05, 0.25, 9.81, 0.01
    net = {"positions": [[0, 0, 0], [0.30, 0, 0]], "masses": [1.0, m], "springs": [[0, 1]], "rest_lengths": r}
    net |= {"k_s": k_s, "k_d": k_d, "pinned": [0], "precision": "float64"}
    x, v, expected = 0.30, 0.0, []
    for _ in range(100):
        v = (v + h * (g - k_s / r * (x - r) / m)) / (1.0 + h * k_d / (r * m) + h * h * k_s / (r * m))
        x += h * v
        expected.append((x, v))
    assert np.ptp(expected, axis=0).max() > 0.1
    q, qd = after_steps(net, name, options, h, steps=100, gravity=(g, 0, 0))
    assert q[1, 0] == pytest.approx(expected[-1][0], rel=1e-13)
    assert qd[1, 0] == pytest.approx(expected[-1][1], abs=1e-12)


@pytest.mark.parametrize(("share", "sweeps", "h"), [(0.3, 1, 0.01), (0.3, 1, 0.02), (0.8, 3, 0.01)])
def test_pbd_stiffness_is_made_by_the_step(share, sweeps, h):
    """A spring of pbd is a spring of xpbd whose stiffness is the one that its documentation states."""
    net = network(1, particles=2, springs=1, damping=0.0)
    w = float(np.sum(1.0 / net["masses"]))
    r = float(net["rest_lengths"][0])
    same = net | {"k_s": r * ((1.0 - share) ** -sweeps - 1.0) / (h * h * w)}
    q, _ = after_steps(net, "pbd", {"stiffness": share, "iterations": sweeps}, h)
    q_same, _ = after_steps(same, "xpbd", {}, h)
    assert np.abs(q - net["positions"]).max() > 1e-3
    assert np.abs(q - q_same).max() <= 1e-14


@every_scheme
def test_linear_momentum(name, options):
    """Kept to round-off by pairwise corrections; by the others as far as they solve the step."""
    exact = wc.integrators()[name].conserves_linear_momentum
    options = options if exact else {**options, "iterations": 150}
    net = network(2)
    q, qd = after_steps(net, name, options, 0.05, steps=40)
    m = net["masses"][:, None]
    assert np.abs(q - net["positions"]).max() > 1.0
    before, after = (m * net["velocities"]).sum(axis=0), (m * qd).sum(axis=0)
    assert np.abs(after - before).max() <= (1e-13 if exact else 1e-6) * np.abs(m * qd).sum()


def test_impulses_of_a_spring_have_no_moment():
    """Σ x₁ × m (v₁ − v₀) = 0 as in implicit Euler: the impulse lies along the spring at the end of the step."""
    net = network(3, particles=2, springs=1)
    q, qd = after_steps(net, "xpbd", {}, 0.05)
    impulse = net["masses"][:, None] * (qd - net["velocities"])
    assert np.abs(impulse).max() > 0.1
    assert np.abs(np.cross(q, impulse).sum(axis=0)).max() <= 1e-15


@every_scheme
def test_springs_of_zero_length(name, options):
    net = network(4)
    net |= {"positions": np.zeros((24, 3)), "velocities": np.zeros((24, 3)), "masses": 1.0}  # so rounding is equal
    q, qd = after_steps(net, name, options, 0.05, steps=3, gravity=(0.0, 0.0, -9.81))
    assert np.isfinite(q).all()
    assert np.ptp(q, axis=0).max() <= 1e-12  # they fall together
    assert qd[:, 2] == pytest.approx(-9.81 * 0.15)


def swinging_cloth(seed: int) -> wc.Cloth:
    shaken = wc.Motion.keyframes([(0.0, (0, 0, 0)), (0.1, (0.1 * seed, 0, 0.1)), (0.3, (0, 0, 0))])
    return wc.Cloth.grid(size=(0.4, 0.4), resolution=(7 + seed, 9), pins=("top", wc.pin("bottom_left", shaken)))


@every_scheme
def test_captured_steps_and_worlds(name, options):
    """Graphs change nothing, a world among others is that world alone, to the last bit; pins follow their motion."""

    def run(worlds, graph):
        model = wc.Model.build_worlds([([swinging_cloth(k)], []) for k in worlds])
        sim = wc.Simulation(model, name, substeps=3, integrator_options=options, graph=graph)
        sim.run(6, fps=60)
        return [sim.state.particle_q.numpy()[c.start : c.stop] for c in model.cloths]

    both = run([0, 1], graph=False)
    for k, alone in enumerate(both):
        assert np.array_equal(alone, run([k], graph=True)[0])
    start = swinging_cloth(1).points
    assert both[1][0] - start[0] == pytest.approx([0.1, 0, 0.1], abs=1e-6)
    assert np.abs(both[1] - start).max() > 0.02


def test_colours():
    cloths = [wc.Cloth.grid(size=(1.0, 1.0), resolution=(17, 24)), wc.Cloth.disc(0.5, 12)]
    for cloth in cloths:
        ends, count = np.asarray(cloth.springs.indices), len(cloth.points)
        colours = spring_colours(ends, count)
        touched = np.column_stack([np.concatenate([colours, colours]), ends.T.ravel()])
        assert len(np.unique(touched, axis=0)) == 2 * len(ends)
        assert colours.max() < np.bincount(ends.ravel()).max() + 1  # Vizing's bound
        of_particle = particle_colours(ends, count)
        assert (of_particle[ends[:, 0]] != of_particle[ends[:, 1]]).all()
        assert of_particle.max() < 8
        order, start = grouped(colours)
        assert np.array_equal(np.sort(order), np.arange(len(ends)))
        assert all((np.diff(order[a:b]) > 0).all() for a, b in pairwise(start))


def test_bad_options():
    model = wc.Model.from_springs([[0, 0, 0], [1, 0, 0]], 1.0, [[0, 1]], 1.0, 1.0, 0.0)
    cases = [("vbd", "acceleration", 1.0), ("projective_dynamics", "solver", "lu"), ("xpbd", "iterations", 0)]
    cases += [("xpbd", "warm_start", 2.0), ("pbd", "stiffness", 1.1), ("pbd", "bending", -1)]
    for name, option, value in cases:
        with pytest.raises(wc.errors.InputError, match=f"^Integrator '{name}': {option} must be "):
            wc.Simulation(model, name, integrator_options={option: value})


def test_automatic_substeps_hold_the_weight_of_cloth():
    """Strain stays in bounds at two resolutions and two stiffnesses, though no step is too large to be stable."""
    for resolution, stretch in ((16, 400.0), (24, 12_000.0)):
        fabric = wc.Fabric(stretch_stiffness=stretch)
        cloth = wc.Cloth.grid(size=(1.0, 1.0), resolution=(resolution, resolution), pins="left", fabric=fabric)
        sim = wc.Simulation(wc.Model.build(cloth), "xpbd")
        edges = cloth.springs.indices[cloth.springs.kinds == 0]
        rest = cloth.springs.rest_lengths[cloth.springs.kinds == 0]
        worst = 0.0
        for _ in range(60):
            sim.step(1.0 / 60.0)
            q = sim.state.particle_q.numpy()
            strain = np.abs(np.linalg.norm(q[edges[:, 1]] - q[edges[:, 0]], axis=1) / rest - 1.0).mean()
            worst = max(worst, strain)
        assert 1 < sim.substeps < 12
        assert worst < 0.028
        assert strain < 0.005
        assert q[:, 0].mean() + 0.5 == pytest.approx(-0.47, abs=0.01)


def test_reset_forgets_the_steps_before():
    net = network(5)
    options = {"warm_start": 0.5}
    sim = wc.Simulation(wc.Model.from_springs(**net), "xpbd", (0, 0, 0), substeps=1, integrator_options=options)
    start = sim.state.particle_q.numpy().copy(), sim.state.particle_qd.numpy().copy()
    sim.step(0.05)
    first = sim.state.particle_q.numpy().copy()
    for forget in (True, False):
        sim.state.particle_q.assign(start[0])
        sim.state.particle_qd.assign(start[1])
        if forget:
            sim.integrator.reset()
        sim.step(0.05)
        assert np.array_equal(sim.state.particle_q.numpy(), first) == forget


def test_what_springs_did_is_kept_unless_the_next_step_would_expect_more_of_it_than_that():
    """Half of an acceleration goes as far in a step √2 times as long; what is kept is that without gravity."""
    for ratio, forgets in ((1.3, False), (1.5, True)):
        ends = []
        for reset in (False, True):
            sim = wc.Simulation(
                wc.Model.from_springs(**network(6)), "vbd", (0, 0, -9.81), substeps=1,
                integrator_options={"iterations": 1, "warm_start": 0.5},
            )  # fmt: skip
            before = sim.state.particle_qd.numpy().copy()
            sim.step(0.02)
            springs = (sim.state.particle_qd.numpy() - before) / 0.02 + [0.0, 0.0, 9.81]
            np.testing.assert_allclose(sim.integrator.spring_acceleration.numpy(), springs, atol=1e-9)
            if reset:
                sim.integrator.reset()
            sim.step(ratio * 0.02)
            ends.append(sim.state.particle_q.numpy())
        assert np.array_equal(*ends) == forgets


@pytest.mark.filterwarnings("ignore::warpcloth.errors.FabricWarning")
@pytest.mark.parametrize("kind", ["grid", "mesh", "woven"])
@pytest.mark.parametrize("options", [{}, {"rows": False}, {"warm_start": 0.5}], ids=str)
def test_forces_of_the_step_before_are_kept_only_if_they_count(kind, options):
    """What no step begins with needs no copy for frames that are done again; whatever is there is not looked at."""
    cloth = wc.Cloth.grid((1.0, 1.0), (12, 12), pins=[0])
    if kind != "grid":
        ball = trimesh.creation.icosphere(subdivisions=2, radius=0.5)
        cloth = wc.Cloth.from_mesh(ball, pins=[0], springs="woven" if kind == "woven" else "fitted")
    expects, ends = "warm_start" in options, []
    for there in (0.0, 1e-3 if expects else float("nan")):
        sim = wc.Simulation(wc.Model.build(cloth), "xpbd", substeps=2, integrator_options=options)
        for force in (*(sweep.flat_force for sweep in sim.integrator.sweeps), sim.integrator._triangle_force):
            force.fill_(there)
        sim.step(0.01)
        ends.append(sim.state.particle_q.numpy())
    assert bool(sim.integrator.memory()) == expects
    assert np.array_equal(*ends) != expects


@every_scheme
@pytest.mark.parametrize("substeps", [1, 4])
def test_no_step_is_too_large_for_crushed_cloth(name, options, substeps):
    """Undamped stiff cloth, every particle off by a cell: explicit schemes would need steps a hundred times smaller."""
    fabric = wc.Fabric(stretch_stiffness=4000.0, damping_time=0.0)
    model = wc.Model.build(wc.Cloth.grid(size=(0.5, 0.5), resolution=(12, 12), pins="top", fabric=fabric))
    sim = wc.Simulation(model, name, substeps=substeps, integrator_options=options)
    q, free = sim.state.particle_q.numpy(), model.particle_inv_mass.numpy() > 0.0
    q[free] += np.random.default_rng(0).normal(size=(free.sum(), 3)) * (0.5 / 11.0)
    energies = [sim.energy()["total"]]
    for _ in range(30):
        sim.step(1.0 / 60.0)
        energies.append(sim.energy()["total"])
    assert energies[0] > 100.0
    assert max(energies[1:]) < energies[0]
    assert energies[-1] < 0.5 * energies[0]


def test_five_sweeps_of_block_descent_take_the_steps_of_two_of_xpbd():
    """What they leave unsolved has momentum: with steps twice as long a folded tablecloth took off from its table."""
    model = wc.Model.build(wc.Cloth.grid((1.0, 1.0), (33, 33)))

    def substeps(name: str, **options) -> int:
        return wc.Simulation(model, name, integrator_options=options).substeps_for(1.0 / 24.0)

    assert substeps("vbd", iterations=5) == substeps("xpbd", iterations=2, rows=False)
    assert substeps("vbd", iterations=20) == substeps("xpbd", iterations=8, rows=False)


def test_many_sweeps_do_not_make_steps_so_long_that_cloth_goes_on_swinging():
    model = wc.Model.build(wc.Cloth.grid((0.5, 0.5), (25, 25), wc.library_fabric("cotton"), pins="top"))
    options = {"integrator_options": {"iterations": 100}, "contact": "none"}
    sim = wc.Simulation(model, "xpbd", (0.0, -9.81, 0.0), **options)
    sim.run(180)
    assert sim.substeps >= 3
    assert sim.settled


@pytest.mark.parametrize(("cells", "time"), [(9, 5.0), (17, 5.0), (9, 50.0)])
def test_strong_damping_does_not_throw_cloth(cells, time):
    """Free cloth with random velocities, at automatic substeps: `vbd` diverged within a tenth of a second."""
    cloth = wc.Cloth.grid((1.0, 1.0), (cells, cells), wc.Fabric(damping_time=time))
    sim = wc.Simulation(wc.Model.build(cloth, device="cpu"), "vbd", gravity=(0.0, 0.0, 0.0))
    sim.state.particle_qd.assign(0.3 * np.random.default_rng(0).standard_normal((cells * cells, 3)))
    start = sim.energy()["kinetic"]
    sim.run(120)
    assert sim.energy()["total"] < 0.5 * start
    assert np.linalg.norm(sim.state.particle_qd.numpy(), axis=1).max() < 0.5


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("vbd", {}),
        ("projective_dynamics", {"solver": "cg"}),
        ("projective_dynamics", {}),
        ("xpbd", {"warm_start": 0.5}),
    ],
)
def test_a_frame_that_lasts_next_to_nothing_does_not_throw_cloth_about(name, options):
    """As when frames are cut to end at a given time, and rounding leaves a rest. Accelerations in it are no guess for
    what springs do in a long step; the start of each long one is from its forces alone then."""
    fabric = wc.library_fabric("cotton")
    model = wc.Model.build([wc.Cloth.grid((0.5, 0.5), (9, 9), fabric, pins=["top_left", "top_right"])])
    fastest = {}
    for rest in (None, 1e-6):
        sim = wc.Simulation(model, name, substeps=1, integrator_options=options)
        speeds = []
        for _ in range(12):
            for dt in (1.0 / 60.0, *([] if rest is None else [rest])):
                sim.step(dt)
            speeds.append(np.linalg.norm(sim.state.particle_qd.numpy(), axis=1).max())
        fastest[rest] = max(speeds)
    assert fastest[1e-6] < 2.0 * fastest[None]


@pytest.mark.parametrize(("name", "sweeps"), [("xpbd", 4), ("vbd", 3)])
def test_sweeps_count_as_evaluations_as_they_look_at_every_spring(name, sweeps):
    model = wc.Model.build(wc.Cloth.grid((0.3, 0.3), (5, 5), pins="left"))
    sim = wc.Simulation(model, name, substeps=3, graph=False, integrator_options={"iterations": sweeps})
    for frame in range(1, 3):
        sim.step(1 / 60)
        assert sim.forces.evaluations == frame * 3 * sweeps


@pytest.mark.parametrize("integrator", ["xpbd", "vbd"])
def test_a_force_of_the_callers_own_acts_whatever_its_name(integrator):
    """Also where a scheme leaves out forces of the model that have the same one."""
    cloth, ends = wc.Cloth.grid((0.2, 0.2), (5, 5), wc.Fabric(bending_rigidity=1e-6)), []
    for name in ("applied", "springs", "bending"):
        model = wc.Model.build([cloth], device="cpu")
        force = wc.AppliedForce(model)
        force.name = name
        force.force.fill_((0.0, 0.01, 0.0))
        sim = wc.Simulation(model, integrator, substeps=10, forces=[force])
        sim.run(3)
        ends.append(sim.state.particle_q.numpy())
    assert ends[0][:, 1].mean() > 0.01
    for end in ends[1:]:
        assert np.array_equal(end, ends[0])
