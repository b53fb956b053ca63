"""Springs in blocks: no two at once share a particle."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import warpcloth as wc
from warpcloth.fabric_library import library_fabric
from warpcloth.integrators import blocks as blocks_module
from warpcloth.integrators.blocks import SpringBlocks, phases_of


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
    chosen = np.flatnonzero(np.random.default_rng(seed).random(springs) < 0.7)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(blocks_module, "BLOCK", size)
        found = SpringBlocks(model, chosen)
    ends = model.spring_indices.numpy().reshape(-1, 2)
    assert np.array_equal(np.sort(found.order), chosen)
    for phase in block_lists(found):
        particles_of = [set(ends[block].ravel().tolist()) for block in phase]
        assert len(set().union(*particles_of)) == sum(map(len, particles_of))


def test_blocks_of_a_grid_need_two_phases_whatever_the_order_of_its_vertices():
    low = np.array([0, 0, 1, 1, 2])
    assert phases_of(low, np.array([0, 1, 1, 2, 3])).tolist() == [0, 1, 0, 1]
    cloth = wc.Cloth.grid((1.0, 1.0), (40, 40))
    shuffle = np.random.default_rng(0).permutation(1600)
    place = np.argsort(shuffle)
    shuffled = wc.Model.from_springs(cloth.points[shuffle], 1.0, place[cloth.springs.indices], 1.0, 1.0, 0.0)
    for model in (wc.Model.build(cloth), shuffled):
        phases = block_lists(SpringBlocks(model, np.arange(model.spring_count)))
        assert [len(phase) for phase in phases] == [2, 2]


def test_meshes_do_not_blow_up_with_automatic_steps():
    """A disc that falls; its list of springs has all springs of a particle together."""
    fabric = library_fabric("silk")
    disc = wc.Cloth.disc(0.25, 20, fabric, transform=(0, 0, 1))
    sim = wc.Simulation(wc.Model.build(disc), "xpbd")
    sim.run(4, fps=24.0)
    assert sim.metrics()["max_strain"] < 1e-3
