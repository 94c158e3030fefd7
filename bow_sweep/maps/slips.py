"""The slips of some cells, whole: a slip that the border of two chunks cuts is one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray


class Slips(NamedTuple):
    """The slips of some cells, each whole, also where it lasts over the end of a chunk.

    Parameters
    ----------
    cell : ndarray of int, shape (slips,)
        Rising.
    start, end : ndarray of int, shape (slips,)
        First sample of the slip, and first sample after it. Rising within a cell.
    slip : ndarray, shape (slips,)
        Sum of the slip speed, final bow speed = 1; N = 139 is a whole Helmholtz slip.
    """

    cell: NDArray[np.int64]
    start: NDArray[np.int64]
    end: NDArray[np.int64]
    slip: NDArray[np.float64]

    def of(self, cell: int) -> Slips:
        """Return the slips of one cell."""
        first, last = np.searchsorted(self.cell, [cell, cell + 1])
        return Slips(self.cell[first:last], self.start[first:last], self.end[first:last], self.slip[first:last])


class Pieces(NamedTuple):
    """The slips of a chunk, as the kernel and the bag have them: the first of a cell may go on from the chunk before.

    Parameters
    ----------
    slipping : array_like, shape (cells,)
        Whether each string slips before the chunk.
    offsets : array_like of int, shape (cells + 1,)
        Slips of cell i are offsets[i] to offsets[i + 1].
    onset, duration : array_like of int, shape (slips,)
        First sample of the slip in the chunk, and number of samples.
    slip : array_like, shape (slips,)
        Sum of the slip speed over those samples.
    """

    slipping: ArrayLike
    offsets: ArrayLike
    onset: ArrayLike
    duration: ArrayLike
    slip: ArrayLike


def join(chunks: list[Pieces], samples: int) -> Slips:
    """Join the slips that ends of chunks have cut.

    Parameters
    ----------
    chunks
        Of the same cells, in the order of time.
    samples
        Of a chunk.

    Returns
    -------
    Slips
        Sorted by cell and time. Sums of slip speed are added in the order of time.
    """
    columns = []
    for number, chunk in enumerate(chunks):
        offsets = np.asarray(chunk.offsets, np.int64)
        cell = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
        onset, duration = np.asarray(chunk.onset, np.int64), np.asarray(chunk.duration, np.int64)
        start = onset + number * samples
        goes_on = (onset == 0) & (np.asarray(chunk.slipping)[cell] != 0)
        columns.append((cell, start, start + duration, np.asarray(chunk.slip, np.float64), goes_on))
    cell, start, end, slip, goes_on = (np.concatenate(column) for column in zip(*columns, strict=True))
    order = np.lexsort((start, cell))
    cell, start, end, slip, goes_on = (column[order] for column in (cell, start, end, slip, goes_on))
    begins = ~goes_on | (np.diff(cell, prepend=-1) != 0)
    first = np.flatnonzero(begins)
    whole = np.zeros(len(first))
    np.add.at(whole, np.cumsum(begins) - 1, slip)
    last = np.append(first[1:], len(cell))[: len(first)] - 1
    return Slips(cell[first], start[first], end[last], whole)
