"""Two kinds of trees over triangles on their ways find the same pairs."""

import numpy as np
import pytest
import trimesh
import warp as wp

import warpcloth as wc
from warpcloth.contact.pair_finder import LEEWAY, PairFinder
from warpcloth.contact.trees import BinaryTree, WideTree, spatial_order, tree_levels
from warpcloth.surface import Surface


def found_in(tree_kind: type, model: wc.Model, moved: np.ndarray, anew: bool) -> set[tuple[int, int]]:
    """Pairs of triangles of a model that a tree finds, fitted to ways after it was made."""
    surface, rng = Surface(model), np.random.default_rng(5)
    finder = PairFinder(model, surface)
    finder._bound(surface.rest, surface.rest, finder.everything, 0.0)
    tree = tree_kind(model, surface, *([finder.known_way] if tree_kind is BinaryTree else []))
    end = surface.positions()
    way = rng.normal(0.0, 0.03, (surface.particle_count, 3)) + rng.random((surface.particle_count, 1)) * [0.3, 0.0, 0.1]
    end.assign(surface.rest.numpy() + way)
    finder._bound(surface.rest, end, finder.everything, 0.001)
    arrays = [wp.array(values, dtype=wp.int32, device="cpu") for values in (moved, [int(anew)])]
    tree.find(*arrays, finder.known_way, LEEWAY, finder.known)
    count = int(finder.known.added.numpy()[0])
    assert count <= finder.capacity
    pairs = finder.known.pair.numpy()[:count]
    assert len(np.unique(pairs, axis=0)) == count  # each once
    return set(map(tuple, pairs.tolist()))


@pytest.mark.parametrize("anew", [False, True])
def test_both_trees_find_the_same_pairs(anew):
    """Cloths and a mesh in worlds that are all in one place; in one of them there is no mesh."""
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.3)
    ball = wc.MeshObstacle(mesh.vertices, mesh.faces)
    sheets = [wc.Cloth.grid((1.0, 1.0), (n, n), transform=(0.0, 0.0, 0.3), name=f"of {n}") for n in (4, 13, 2)]
    worlds = [([sheets[0]], [ball]), ([sheets[1], sheets[2]], []), ([sheets[2]], [ball])]
    model = wc.Model.build_worlds(worlds, device="cpu")
    count = Surface(model).tri_count
    moved = np.random.default_rng(2).random(count) < 0.4
    wide, binary = (found_in(kind, model, moved, anew) for kind in (WideTree, BinaryTree))
    assert wide == binary
    assert len(wide) > 1000
    assert anew or all(moved[list(pair)].any() for pair in wide)


def test_what_has_diverged_finds_no_empty_lanes():
    """It overlaps with all that there is; before, with children that there are not, and the process crashed."""
    model = wc.Model.build([wc.Cloth.grid((0.04, 0.1), (3, 6))], device="cpu")  # 20 triangles in three leaves
    surface = Surface(model)
    finder, count = PairFinder(model, surface), surface.tri_count
    tree, end = WideTree(model, surface), surface.positions()
    everything = wp.ones(count, dtype=wp.int32, device="cpu")
    for far in (1e32, np.inf, np.nan):
        end.assign(surface.rest.numpy() + far * np.where(np.arange(surface.particle_count) % 2, 1.0, -1.0)[:, None])
        finder._bound(surface.rest, end, finder.everything, 0.001)
        finder.known.added.zero_()
        tree.find(everything, everything, finder.known_way, LEEWAY, finder.known)
        listed = min(int(finder.known.added.numpy()[0]), finder.capacity)
        pairs = finder.known.pair.numpy()[:listed]
        assert pairs.min(initial=0) >= 0
        assert pairs.max(initial=0) < count


def test_trees_of_eight():
    levels = [sizes.tolist() for sizes in tree_levels([0, 1, 8, 9, 65], 8)]
    assert levels == [[0, 1, 1, 2, 9], [0, 0, 0, 1, 2], [0, 0, 0, 0, 1]]
    grid = np.stack(np.meshgrid(np.arange(16.0), np.arange(16.0)), axis=-1).reshape(-1, 2)
    points = np.column_stack([grid, np.zeros(256)])
    order = spatial_order(points)
    assert sorted(order) == list(range(256))
    assert np.ptp(points[order].reshape(16, 16, 3), axis=1).max() == 3.0  # sixteen in a row are a square
    assert len(spatial_order(np.zeros((3, 3)))) == 3
