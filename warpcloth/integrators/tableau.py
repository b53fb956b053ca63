"""Butcher tableaux of explicit Runge–Kutta methods; each checks that it has the order it claims."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

MAX_STAGES = 8  # forces that one launch of kernels/explicit_step.py combines


@dataclass(frozen=True, eq=False)
class Tableau:
    """An explicit Runge–Kutta method: k_i = f(y + h Σ_j a_ij k_j), y ← y + h Σ b_i k_i.

    Args:
        a: rows of the lower triangle, the first one empty. b: weights.
        order: of the method, at most 5; checked against all order conditions (Hairer, Nørsett, Wanner, Solving Ordinary
            Differential Equations I (1993), II.2).
        error: b minus the weights of the embedded method, for pairs; that is of one order less, and checked as well.

    Raises:
        ValueError: the tableau is not one of an explicit method of that order.
    """

    a: tuple[tuple[float, ...], ...]
    b: tuple[float, ...]
    order: int
    error: tuple[float, ...] = ()

    def __post_init__(self):
        if len(self.b) > MAX_STAGES or [len(row) for row in self.a] != list(range(len(self.b))):
            raise ValueError(f"a tableau of {len(self.b)} stages needs rows of 0, 1, 2, … entries")
        for nodes in range(1, self.order + 1):
            for tree in rooted_trees(nodes):
                weight = elementary_weight(tree, self.matrix)
                if not math.isclose(np.dot(self.b, weight) * density(tree), 1.0):
                    raise ValueError(f"the tableau is not of order {self.order}: tree {tree} fails")
                if self.error and nodes < self.order and abs(np.dot(self.error, weight)) > 1e-14:
                    raise ValueError(f"the embedded method is not of order {self.order - 1}: tree {tree} fails")

    @cached_property
    def matrix(self) -> np.ndarray:
        """a as a square matrix, shape [stages, stages]."""
        full = np.zeros((self.stages, self.stages))
        for i, row in enumerate(self.a):
            full[i, :i] = row
        return full

    @property
    def stages(self) -> int:
        """Force evaluations per step."""
        return len(self.b)

    @property
    def nodes(self) -> np.ndarray:
        """c: times of the stages as fractions of the step; row sums of a, so that time is treated as a variable."""
        return self.matrix.sum(axis=1)

    @property
    def stability_polynomial(self) -> np.ndarray:
        """Coefficients r_j of R(z) = Σ r_j z^j, where y′ = λ y gives y ← R(hλ) y: r_0 = 1, r_{j+1} = b·a^j·1."""
        coefficients, u = [1.0], np.ones(self.stages)
        for _ in range(self.stages):
            coefficients.append(float(np.dot(self.b, u)))
            u = self.matrix @ u
        return np.array(coefficients)


@lru_cache
def rooted_trees(nodes: int) -> tuple[tuple, ...]:
    """All rooted trees of that many nodes, each a sorted tuple of its branches."""
    return tuple(dict.fromkeys(_forests(nodes - 1)))


def _forests(nodes: int) -> Iterator[tuple]:
    """Multisets of trees with ``nodes`` nodes in all."""
    if nodes == 0:
        yield ()
    for first in range(1, nodes + 1):
        for tree in rooted_trees(first):
            for rest in _forests(nodes - first):
                yield tuple(sorted((tree, *rest)))


def elementary_weight(tree: tuple, matrix: np.ndarray) -> np.ndarray:
    """Φ_i of the tree for each stage i."""
    weight = np.ones(len(matrix))
    for branch in tree:
        weight = weight * (matrix @ elementary_weight(branch, matrix))
    return weight


def node_count(tree: tuple) -> int:
    """Number of nodes."""
    return 1 + sum(node_count(branch) for branch in tree)


def density(tree: tuple) -> int:
    """γ(tree): its node count times the densities of its branches; the order condition is Σ b_i Φ_i = 1/γ."""
    return node_count(tree) * math.prod(density(branch) for branch in tree)


FORWARD_EULER = Tableau(((),), (1.0,), 1)
MIDPOINT = Tableau(((), (1 / 2,)), (0.0, 1.0), 2)
HEUN = Tableau(((), (1.0,)), (1 / 2, 1 / 2), 2)
RK4 = Tableau(((), (1 / 2,), (0.0, 1 / 2), (0.0, 0.0, 1.0)), (1 / 6, 1 / 3, 1 / 3, 1 / 6), 4)
BOGACKI_SHAMPINE = Tableau(
    ((), (1 / 2,), (0.0, 3 / 4), (2 / 9, 1 / 3, 4 / 9)),
    (2 / 9, 1 / 3, 4 / 9, 0.0),
    3,
    error=(2 / 9 - 7 / 24, 1 / 3 - 1 / 4, 4 / 9 - 1 / 3, -1 / 8),
)
DORMAND_PRINCE = Tableau(
    (
        (),
        (1 / 5,),
        (3 / 40, 9 / 40),
        (44 / 45, -56 / 15, 32 / 9),
        (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
        (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
        (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
    ),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84, 0.0),
    5,
    error=(71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40),
)
