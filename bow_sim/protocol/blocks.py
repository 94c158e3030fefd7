"""Which cells are in which block, for a sweep whose plan may grow.

A sweep is planned in *rounds*. A round is a list of cells and is divided into blocks; blocks are numbered through all
rounds, and the last block of a round may have fewer cells. An exhaustive sweep has one round with all cells. An
adaptive sweep chooses the next round when every block of the round before is done or given up
(:mod:`bow_sweep.plan.adaptive`). The message Plan announces the rounds as one number for each cell.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics.errors import ParameterError

MAX_ROUNDS = 255
"""Largest number of rounds: Plan.rounds has a byte for each cell."""


class Blocks:
    """The blocks of a sweep planned so far. Does not change; :meth:`grown` returns one with another round.

    Parameters
    ----------
    cells
        Number of cells of the plane.
    block_cells
        Largest number of cells of a block.
    rounds
        Cells of each round, ascending; None: one round of all cells.
    kinds
        (cells,) numbers: a block has cells of one kind (:mod:`bow_sim.physics.kinds`). None: all are of one kind.

    Attributes
    ----------
    adaptive
        Whether rounds were given: then more can follow.
    """

    def __init__(
        self,
        cells: int,
        block_cells: int,
        rounds: Iterable[NDArray[np.integer]] | None = None,
        kinds: NDArray[np.integer] | None = None,
    ) -> None:
        self.cells, self.block_cells, self.adaptive = cells, block_cells, rounds is not None
        self.rounds = tuple(np.asarray(each, np.uint32) for each in ([np.arange(cells)] if rounds is None else rounds))
        self.kinds = kinds
        parts = [part for each in self.rounds for part in _by_kind(each, kinds)]
        starts = list(itertools.accumulate(map(len, parts), initial=0))
        cuts = [range(start, end, block_cells) for start, end in itertools.pairwise(starts)]
        self._bounds = [*itertools.chain(*cuts), starts[-1]]
        self._order = np.concatenate([np.zeros(0, np.uint32), *parts])

    @classmethod
    def announced(
        cls,
        cells: int,
        block_cells: int,
        round_of: NDArray[np.integer],
        kinds: NDArray[np.integer] | None = None,
    ) -> Blocks:
        """Return the blocks that ``Plan.rounds`` describes, see :meth:`announce`.

        Raises
        ------
        ParameterError
            Where it is neither empty nor has one number for each cell, or where a round is missing.
        """
        if not len(round_of):
            return cls(cells, block_cells, kinds=kinds)
        if len(round_of) != cells:
            raise ParameterError(
                f"Plan.rounds has {len(round_of)} values: should be none or {cells}, one for each cell"
            )
        numbers = np.arange(1, int(round_of.max()) + 1)
        parts = [np.flatnonzero(round_of == number) for number in numbers]
        if not parts or not all(map(len, parts)):
            raise ParameterError(f"Plan.rounds has rounds {np.unique(round_of[round_of > 0])}: should be 1, 2, 3 ...")
        return cls(cells, block_cells, parts, kinds)

    def announce(self) -> NDArray[np.uint8]:
        """Return ``Plan.rounds``, (cells,): the round of every cell from 1 on, 0 = not planned; (0,) if exhaustive."""
        if not self.adaptive:
            return np.zeros(0, np.uint8)
        round_of = np.zeros(self.cells, np.uint8)
        for number, cells in enumerate(self.rounds, 1):
            round_of[cells] = number
        return round_of

    def grown(self, cells: NDArray[np.integer]) -> Blocks:
        """Return the same blocks and those of one more round.

        Raises
        ------
        ValueError
            Where the round is empty, its cells do not ascend, one is not of the plane or is planned already, or there
            are too many rounds.
        """
        fresh = np.unique(cells)
        if not len(fresh) or not np.array_equal(fresh, cells) or fresh[0] < 0 or fresh[-1] >= self.cells:
            raise ValueError(f"a round of cells {cells}: should be ascending, from 0 ... {self.cells - 1}")
        if not self.adaptive or self.planned[fresh].any():
            raise ValueError(f"cell {fresh[self.planned[fresh]][0]} is planned already")
        if len(self.rounds) >= MAX_ROUNDS:
            raise ValueError(f"a round after the last: there can be {MAX_ROUNDS}")
        return Blocks(self.cells, self.block_cells, (*self.rounds, fresh), self.kinds)

    def extends(self, other: Blocks) -> bool:
        """Return whether these are the blocks of `other`, and perhaps more."""
        return (self.cells, self.block_cells, self.adaptive) == (other.cells, other.block_cells, other.adaptive) and (
            len(self.rounds) >= len(other.rounds)
            and all(map(np.array_equal, self.rounds, other.rounds))  # map() ends with the shorter list
        )

    @property
    def planned(self) -> NDArray[np.bool_]:
        """Whether each cell is in a block, (cells,)."""
        out = np.zeros(self.cells, bool)
        out[self._order] = True
        return out

    @property
    def planned_cells(self) -> int:
        """Number of cells that are in a block."""
        return len(self._order)

    @property
    def count(self) -> int:
        """Number of blocks."""
        return len(self._bounds) - 1

    def size(self, block: int) -> int:
        """Return the number of cells of a block."""
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
        """Return whether each cell is in one of some blocks, (cells,)."""
        out = np.zeros(self.cells, bool)
        for block in blocks:
            out[self.block(block)] = True
        return out


def _by_kind(cells: NDArray[np.uint32], kinds: NDArray[np.integer] | None) -> list[NDArray[np.uint32]]:
    """Return cells divided by their kinds, ascending in each; a round without cells stays one."""
    if kinds is None or not len(cells):
        return [cells]
    own = kinds[cells]
    return [cells[own == kind] for kind in np.unique(own)]
