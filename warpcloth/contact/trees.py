"""Trees in which triangles find those that they may meet: Warp's own on GPUs, ours on the CPU."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from ..launching import launch, refit
from ..model import Model
from ..surface import Surface, triangle_worlds


def tree_groups(surface: Surface) -> np.ndarray:
    """Of each triangle the part of a tree that it belongs to, int, shape [tri_count].

    There are two for each world, as worlds are all in one place: its cloth, and its obstacles. A fast mesh that
    searched among its own triangles would find most of them each time.
    """
    groups = 2 * triangle_worlds(surface.tri_indices, surface.world).numpy()
    groups[surface.cloth_tris :] += 1
    return groups


class BinaryTree:
    """A ``wp.Bvh`` of boxes.

    Args:
        model: the model. surface: its triangles. known: their known ways.
    """

    def __init__(self, model: Model, surface: Surface, known: wp.array):
        self._kernels, self._surface = model.kernels.contact_candidates, surface
        groups, count = tree_groups(surface), 2 * model.world_count
        self._boxes = [wp.zeros(len(groups), dtype=wp.vec3, device=model.device) for _ in range(2)]
        self._box(known, 0.0)
        lower, upper = self._boxes
        self._tree = wp.Bvh(lower, upper, groups=model.array(groups, wp.int32))
        sizes = model.array(np.bincount(groups, minlength=count), wp.int32)
        self._root = wp.zeros(count, dtype=wp.int32, device=model.device)
        launch(self._kernels.find_roots, count, [sizes, self._tree.id], [self._root], model.device)

    def find(self, moved: wp.array, anew: wp.array, known: wp.array, stray: float, pairs: Any) -> None:
        """Adds the pairs of triangles that have moved to ``pairs``; boxes may have changed."""
        self._box(known, stray)
        refit(self._tree)
        surface = self._surface
        mesh = [surface.tri_indices, surface.world, self._root, surface.cloth_tris]
        inputs = [*mesh, moved, anew, known, stray, self._tree.id]
        launch(self._kernels.find_triangle_pairs, surface.tri_count, inputs, [pairs], surface.tri_indices.device)

    def _box(self, known: wp.array, stray: float) -> None:
        launch(self._kernels.box_ways, self._surface.tri_count, [known, stray], self._boxes, known.device)


class WideTree:
    """A tree of boxes with eight children a node (``kernels/contact_tree.py``).

    Args:
        model: the model. surface: its triangles, whose places at rest decide who is near whom in the tree.
    """

    def __init__(self, model: Model, surface: Surface):
        self._kernels, self._surface, self._device = model.kernels.contact_tree, surface, model.device
        width, triangles = self._kernels.WIDTH, surface.tri_indices.numpy().reshape(-1, 3)
        middle = surface.rest.numpy()[triangles].mean(axis=1)
        groups = members(tree_groups(surface), 2 * model.world_count)
        orders = [own[spatial_order(middle[own])] for own in groups]
        levels = tree_levels([len(order) for order in orders], width)
        self._level_sizes = [int(sizes.sum()) for sizes in levels]
        self._tree = self._shape(orders, levels, triangles)
        leaves = self._level_sizes[0]
        empty = np.repeat(np.array([1e30, -1e30], np.float32), 3 * width)
        self._contents = self._kernels.Contents()
        self._contents.box = model.array(np.tile(empty, sum(self._level_sizes) - leaves), wp.float32)
        self._contents.way = model.array(np.tile(empty, 2 * leaves), wp.float32)
        self._contents.moved = wp.zeros(width * leaves, dtype=wp.int32, device=model.device)

    def find(self, moved: wp.array, anew: wp.array, known: wp.array, stray: float, pairs: Any) -> None:
        """Adds the pairs of triangles that have moved to ``pairs``; ways may have changed."""
        surface, first = self._surface, 0
        for level, size in enumerate(self._level_sizes):
            kernel, inputs = self._kernels.fit_nodes, [first, self._tree]
            if level == 0:
                kernel, inputs = self._kernels.fit_leaves, [self._tree, known, moved, stray]
            launch(kernel, size, inputs, [self._contents], self._device)
            first += size
        mesh = [surface.tri_indices, surface.world, self._tree, surface.cloth_tris]
        inputs = [*mesh, moved, anew, known, stray, self._contents]
        launch(self._kernels.search_tree, surface.tri_count, inputs, [pairs], self._device)

    def _shape(self, orders: Sequence[np.ndarray], levels: Sequence[np.ndarray], triangles: np.ndarray) -> Any:
        """Nodes level by level, in each those of one group after those of the other."""
        width, first, starts = self._kernels.WIDTH, 0, []
        for sizes in levels:
            starts.append(first + np.cumsum(sizes) - sizes)
            first += int(sizes.sum())
        child, parent = np.full(first, -1), np.full(first, -1)
        slots, root = np.full((int(levels[0].sum()), width), -1), np.full(len(orders), -1)
        for group, order in enumerate(orders):
            if len(order) == 0:
                continue
            leaves = slice(starts[0][group], starts[0][group] + levels[0][group])
            slots[leaves] = np.pad(order, (0, -len(order) % width), constant_values=-1).reshape(-1, width)
            height = sum(int(sizes[group]) > 0 for sizes in levels)
            for level in range(1, height):
                above = starts[level][group] + np.arange(levels[level][group])
                below = starts[level - 1][group] + np.arange(levels[level - 1][group])
                child[above] = below[::width]
                parent[below] = width * above[0] + np.arange(len(below))
            root[group] = starts[height - 1][group]
        corner = np.where(slots[..., None] < 0, -1, triangles[slots]).transpose(0, 2, 1)
        arrays = {"child": child, "parent": parent, "triangle": slots, "corner": corner, "root": root}
        tree = self._kernels.WideTree()
        for name, values in arrays.items():
            setattr(tree, name, wp.array(values.ravel(), dtype=wp.int32, device=self._device))
        return tree


def members(groups: np.ndarray, count: int) -> list[np.ndarray]:
    """The items of each group, in rising order."""
    order = np.argsort(groups, kind="stable")
    return np.split(order, np.searchsorted(groups[order], np.arange(1, count)))


def tree_levels(counts: Sequence[int], width: int) -> list[np.ndarray]:
    """How many nodes groups of so many items have on each level, from the leaves up to the last root."""
    sizes = -(-np.array(counts) // width)
    levels = [sizes]
    while (sizes > 1).any():
        sizes = np.where(sizes > 1, -(-sizes // width), 0)
        levels.append(sizes)
    return levels


def spatial_order(points: np.ndarray) -> np.ndarray:
    """Points, shape [n, 3], along a curve that stays in a place before it goes to the next (Morton's)."""
    if len(points) == 0:
        return np.zeros(0, np.int64)
    size = float(np.ptp(points, axis=0).max())
    cells = ((points - points.min(axis=0)) * (1023.0 / size if size > 0.0 else 0.0)).astype(np.int64)
    code = np.zeros(len(points), np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= (cells[:, axis] >> bit & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")
