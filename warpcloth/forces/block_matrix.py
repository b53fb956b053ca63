"""The matrix a K + b C in blocks, for solvers that multiply it many times at one state."""

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
import warp as wp

from ..launching import fill, launch
from ..model import Model
from .base import ForceTerm, Linearization


@runtime_checkable
class Assembled(Protocol):
    """A force that can write its matrix down: a :class:`~warpcloth.forces.base.ForceTerm` with blocks."""

    def couplings(self) -> np.ndarray:
        """Particles (i, j) of its blocks, shape [m, 2], in an order of its own; (i, i) stand for none. Empty: what it
        has is between particles and the world."""
        ...

    def add_blocks(self, at: Linearization, slots: wp.array, rows: Any) -> None:
        """Adds a K + b C to ``rows``, a ``BlockRows`` of ``kernels/block_rows.py``. Launches kernels only.

        ``slots`` (int32, shape [m]) has the block of each coupling, −1 for (i, i): what particles have with themselves
        only, the sum of a row, goes to ``rows.own``.
        """
        ...


@runtime_checkable
class PartlyAssembled(Assembled, Protocol):
    """A force of whose matrix some is written down, and some has products that are faster."""

    def multiply_rest(self, at: Linearization, x: wp.array, out: wp.array) -> None:
        """Adds to ``out`` the product with what :meth:`add_blocks` leaves out."""
        ...


@runtime_checkable
class NeverProjected(Assembled, Protocol):
    """A force whose matrix is the same, projected or not; its :meth:`add_blocks` adds the blocks (i, i) as well, to
    ``rows.diagonal``, which its ``hessian_diagonal`` would work out once more."""

    never_projected: bool


class BlockMatrix:
    """Blocks of all the terms that are :class:`Assembled`.

    A product with all of them costs what one kernel takes to read the blocks, however much the laws behind them
    compute: 36 bytes a block in float32, some 10 to 25 blocks a row.

    Args:
        model: the model.
        terms: force terms; those that are not :class:`Assembled` are left out.

    Attributes:
        terms: those whose matrix it is.
        with_diagonal: those whose diagonal is written down, too.
    """

    def __init__(self, model: Model, terms: Sequence[ForceTerm]):
        self.model = model
        kernels, n = model.kernels, model.particle_count
        self.terms = [term for term in terms if isinstance(term, Assembled)]
        pairs = [term.couplings().astype(np.int64) for term in self.terms]
        keys = [np.where(first == second, -1, first * n + second) for first, second in (pair.T for pair in pairs)]
        blocks = np.unique(np.concatenate([np.zeros(0, np.int64), *keys]))
        blocks = blocks[blocks >= 0]
        slots = [np.where(key < 0, -1, np.searchsorted(blocks, key)) for key in keys]
        self._written = [  # couplings of which no block is left are all left out
            (term, model.array(slot, wp.int32))
            for term, slot in zip(self.terms, slots, strict=True)
            if len(slot) == 0 or slot.max() >= 0
        ]
        self.with_diagonal = [term for term, _ in self._written if isinstance(term, NeverProjected)]
        mat33 = kernels.precision.mat33
        self.rows = kernels.block_rows.BlockRows()
        self.rows.start = model.array(np.searchsorted(blocks, n * np.arange(n + 1)), wp.int32)
        self.rows.column = model.array(blocks % n, wp.int32)
        self.rows.block = wp.zeros(len(blocks), dtype=mat33, device=model.device)
        self.rows.own, self.rows.diagonal = (wp.zeros(n, dtype=mat33, device=model.device) for _ in range(2))

    def assemble(self, at: Linearization) -> None:
        """Adds up the matrix at a state."""
        fill(self.rows.block)
        fill(self.rows.own)
        fill(self.rows.diagonal)
        for term, slots in self._written:
            term.add_blocks(at, slots, self.rows)

    def multiply(self, at: Linearization, x: wp.array, out: wp.array) -> None:
        """Adds to ``out`` the product of x with the terms' matrices at the state that was assembled last; both vec3,
        shape [particle_count], not the same array."""
        model = self.model
        kernel = model.kernels.block_rows.multiply
        if self._written:
            launch(kernel, dim=model.particle_count, inputs=[self.rows, x], outputs=[out], device=model.device)
        for term in self.terms:
            if isinstance(term, PartlyAssembled):
                term.multiply_rest(at, x, out)

    def add_diagonal(self, out: wp.array) -> None:
        """Adds to ``out`` the diagonal blocks of ``with_diagonal`` at the state that was assembled last."""
        model = self.model
        kernel = model.kernels.block_rows.add_diagonal
        if self.with_diagonal:
            launch(kernel, dim=model.particle_count, inputs=[self.rows], outputs=[out], device=model.device)


def corner_pairs(triangles: np.ndarray) -> np.ndarray:
    """Pairs of corners, shape [9 m, 2]: corners c and d of triangle t are number 9 t + 3 c + d."""
    shape = (len(triangles), 3, 3)
    return np.stack(
        [np.broadcast_to(triangles[:, :, None], shape), np.broadcast_to(triangles[:, None, :], shape)], axis=-1
    ).reshape(-1, 2)
