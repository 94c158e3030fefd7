"""Which cells are in which block, for a sweep whose plan may grow.

A sweep is planned in *rounds*, lists of cells. Each is cut into blocks of its own, numbered on from the last; the last
block of a round may have fewer cells. An exhaustive sweep has one round, all cells; an adaptive one chooses the next
round when every block of the one before is settled (:mod:`bow_sweep.plan.adaptive`). The plan announces the rounds as
one number for each cell.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics.errors import ParameterError

MAX_ROUNDS = 255
"""Rounds that a plan can announce."""


class Blocks:
    """The blocks of a sweep as far as it is planned. Does not change; :meth:`grown` gives a larger one.

    Parameters
    ----------
    cells
        Of the plane.
    block_cells
        Cells of a block at most.
    rounds
        Cells of each round, ascending; one round of all cells unless given.

    Attributes
    ----------
    adaptive
        Whether rounds were given.
    """

    def __init__(self, cells: int, block_cells: int, rounds: Iterable[NDArray[np.integer]] | None = None) -> None:
        self.cells, self.block_cells, self.adaptive = cells, block_cells, rounds is not None
        parts = [np.arange(cells)] if rounds is None else rounds
        self.rounds = tuple(np.asarray(part, np.uint32) for part in parts)
        starts = list(itertools.accumulate(map(len, self.rounds), initial=0))
        cuts = [range(start, end, block_cells) for start, end in itertools.pairwise(starts)]
        self._bounds = [*itertools.chain(*cuts), starts[-1]]
        self._order = np.concatenate([np.zeros(0, np.uint32), *self.rounds])

    @classmethod
    def announced(cls, cells: int, block_cells: int, round_of: NDArray[np.integer]) -> Blocks:
        """Return the blocks that ``Plan.rounds`` describes: see :meth:`announce`.

        Raises
        ------
        ParameterError
            Where it is neither empty nor one number for each cell, or a round is left out.
        """
        if not len(round_of):
            return cls(cells, block_cells)
        if len(round_of) != cells:
            raise ParameterError(
                f"Plan.rounds has {len(round_of)} values: should be none or {cells}, one for each cell"
            )
        numbers = np.arange(1, int(round_of.max()) + 1)
        parts = [np.flatnonzero(round_of == number) for number in numbers]
        if not parts or not all(map(len, parts)):
            raise ParameterError(f"Plan.rounds has rounds {np.unique(round_of[round_of > 0])}: should be 1, 2, 3 ...")
        return cls(cells, block_cells, parts)

    def announce(self) -> NDArray[np.uint8]:
        """Return ``Plan.rounds``: the round of every cell, counted from 1, 0 = not planned; empty if exhaustive."""
        if not self.adaptive:
            return np.zeros(0, np.uint8)
        round_of = np.zeros(self.cells, np.uint8)
        for number, cells in enumerate(self.rounds, 1):
            round_of[cells] = number
        return round_of

    def grown(self, cells: NDArray[np.integer]) -> Blocks:
        """Return these blocks and those of another round.

        Raises
        ------
        ValueError
            Where it has no cells, they do not ascend, one is planned already or is none of the plane, or there are
            too many rounds.
        """
        fresh = np.unique(cells)
        if not len(fresh) or not np.array_equal(fresh, cells) or fresh[0] < 0 or fresh[-1] >= self.cells:
            raise ValueError(f"a round of cells {cells}: should be ascending, from 0 ... {self.cells - 1}")
        if not self.adaptive or self.planned[fresh].any():
            raise ValueError(f"cell {fresh[self.planned[fresh]][0]} is planned already")
        if len(self.rounds) >= MAX_ROUNDS:
            raise ValueError(f"a round after the last: there can be {MAX_ROUNDS}")
        return Blocks(self.cells, self.block_cells, (*self.rounds, fresh))

    def extends(self, other: Blocks) -> bool:
        """Whether all blocks of `other` are the same here."""
        return (self.cells, self.block_cells, self.adaptive) == (other.cells, other.block_cells, other.adaptive) and (
            len(self.rounds) >= len(other.rounds)
            and all(map(np.array_equal, self.rounds, other.rounds))  # as far as the shorter goes
        )

    @property
    def planned(self) -> NDArray[np.bool_]:
        """Which cells are in a block, (cells,)."""
        out = np.zeros(self.cells, bool)
        out[self._order] = True
        return out

    @property
    def planned_cells(self) -> int:
        """How many cells are in a block."""
        return len(self._order)

    @property
    def count(self) -> int:
        """How many blocks there are."""
        return len(self._bounds) - 1

    def size(self, block: int) -> int:
        """Return how many cells a block has."""
        return self._bounds[block + 1] - self._bounds[block]

    def block(self, block: int) -> NDArray[np.uint32]:
        """Return the cells of a block, (cells of the block,).

        Raises
        ------
        IndexError
            Where there is no such block.
        """
        if not 0 <= block < self.count:
            raise IndexError(f"block {block}: the sweep has blocks 0 ... {self.count - 1}")
        return self._order[self._bounds[block] : self._bounds[block + 1]]

    def cells_of(self, blocks: Iterable[int]) -> NDArray[np.bool_]:
        """Return which cells are in some blocks, (cells,)."""
        out = np.zeros(self.cells, bool)
        for block in blocks:
            out[self.block(block)] = True
        return out
