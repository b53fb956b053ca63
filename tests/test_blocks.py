"""Springs in blocks: no two at once share a particle, and their order is that of the list."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import warpcloth as wc
from warpcloth.fabric_library import library_fabric
from warpcloth.integrators import blocks as blocks_module
from warpcloth.integrators.blocks import SpringBlocks, goes_on, phases_of, spring_levels
from warpcloth.integrators.colouring import SpringColours


def random_model(seed: int, particles: int, springs: int) -> wc.Model:
    rng = np.random.default_rng(seed)
    ends = rng.integers(0, particles, (springs, 2))
    ends[:, 1] = np.where(ends[:, 0] == ends[:, 1], (ends[:, 1] + 1) % particles, ends[:, 1])
    return wc.Model.from_springs(rng.normal(size=(particles, 3)), 1.0, ends, 1.0, 1.0, 0.0)


def block_lists(found: SpringBlocks) -> list[list[np.ndarray]]:
    """Spring numbers of the blocks of each phase."""
    phases = []
    for (first, _), start in zip(pairwise(found.start), found.block_start, strict=True):
        phases.append([found.order[first + a : first + b] for a, b in pairwise(start.numpy())])
    return phases


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6), particles=st.integers(2, 60), springs=st.integers(0, 90), size=st.integers(1, 30))
def test_blocks_of_a_phase_share_no_particle(seed, particles, springs, size):
    model = random_model(seed, particles, springs)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(blocks_module, "BLOCK", size)
        found = SpringBlocks(model)
    ends = model.spring_indices.numpy().reshape(-1, 2)
    assert np.array_equal(np.sort(found.order), np.arange(springs))
    for phase in block_lists(found):
        particles_of = [set(ends[block].ravel().tolist()) for block in phase]
        assert len(set().union(*particles_of)) == sum(map(len, particles_of))


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6), springs=st.integers(0, 60))
def test_levels_are_the_order_of_the_list_where_it_matters(seed, springs):
    ends = np.random.default_rng(seed).integers(0, 20, (springs, 2))
    levels = spring_levels(ends, 20)
    for i in range(20):
        assert (np.diff(levels[(ends == i).any(axis=1)]) > 0).all()  # one after the other at each particle
    assert levels.max(initial=-1) + 1 <= springs


def test_blocks_of_a_grid_need_two_phases_whatever_the_order_of_its_vertices():
    low = np.array([0, 0, 1, 1, 2])
    assert phases_of(low, np.array([0, 1, 1, 2, 3])).tolist() == [0, 1, 0, 1]
    cloth = wc.Cloth.grid((1.0, 1.0), (40, 40))
    shuffle = np.random.default_rng(0).permutation(1600)
    place = np.argsort(shuffle)
    shuffled = wc.Model.from_springs(cloth.points[shuffle], 1.0, place[cloth.springs.indices], 1.0, 1.0, 0.0)
    for model in (wc.Model.build(cloth), shuffled):
        phases = block_lists(SpringBlocks(model))
        assert [len(phase) for phase in phases] == [2, 2]


def test_what_is_solved_is_what_colours_solve():
    """Many sweeps of either come to the solution of the implicit step."""
    ends = []
    for differentiable in (False, True):
        cloth = wc.Cloth.grid((0.4, 0.4), (5, 5), pins="left")
        model = wc.Model.build(cloth, precision="float64", differentiable=differentiable)
        sim = wc.Simulation(model, "xpbd", substeps=4, integrator_options={"iterations": 3000})
        assert isinstance(sim.integrator.colours, SpringColours if differentiable else SpringBlocks)
        sim.step(1.0 / 60.0)
        ends.append(sim.state.particle_q.numpy())
    assert np.abs(ends[0] - ends[1]).max() < 1e-12
    assert np.abs(ends[0] - model.particle_q.numpy()).max() > 1e-4


def test_lists_that_stay_at_a_particle_are_told():
    along = np.array([[0, 1], [1, 2], [2, 3], [3, 4]])
    assert goes_on(along)
    assert goes_on(along[:1])
    assert not goes_on(np.array([[5, 6], [0, 1], [2, 0], [0, 3]]))
    assert goes_on(np.asarray(wc.Cloth.grid((1.0, 1.0), (9, 7)).springs.indices))
    assert not goes_on(np.asarray(wc.Cloth.disc(0.5, 6).springs.indices))


def test_meshes_do_not_blow_up_with_automatic_steps():
    """A disc that falls; its list of springs has all springs of a particle together."""
    fabric = library_fabric("silk")
    disc = wc.Cloth.disc(0.25, 20, fabric, transform=(0, 0, 1))
    sim = wc.Simulation(wc.Model.build(disc), "xpbd")
    sim.run(4, fps=24.0)
    assert sim.metrics()["max_strain"] < 1e-3
