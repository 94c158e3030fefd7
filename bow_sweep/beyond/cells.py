"""Cells computed in this process with their slips and verdicts: for claims about a few strings, and about slips."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bow_sim.physics.parameters import Parameters
from bow_sweep.maps.in_process import judged_chunks

AT_ONCE = 512
"""Cells computed at once: what a block of a sweep has."""


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


class Motion(NamedTuple):
    """What some cells did.

    Parameters
    ----------
    slips : Slips
    regime : ndarray of uint8, shape (tests, cells)
        Code of the regime after every five periods.
    period : ndarray, shape (tests, cells)
        Measured period, samples; NaN where there is none.
    """

    slips: Slips
    regime: NDArray[np.uint8]
    period: NDArray[np.float32]


def compute(parameters: Parameters, lanes: Mapping[str, ArrayLike]) -> Motion:
    """Simulate and classify cells with the kernel and the classifier that a sweep uses.

    Parameters
    ----------
    parameters
        Common to all cells.
    lanes
        Name -> (cells,), what differs; as in :class:`bow_sim.kernel.block.Block`.

    Raises
    ------
    ParameterError
        For values that cannot be.
    """
    columns = {name: np.asarray(values, np.float64) for name, values in lanes.items()}
    count = len(next(iter(columns.values())))
    parts = []
    for first in range(0, count, AT_ONCE):
        parts.append(_block(parameters, {name: x[first : first + AT_ONCE] for name, x in columns.items()}, first))
    slips = Slips(*(np.concatenate(column) for column in zip(*(part.slips for part in parts), strict=True)))
    regime, period = (np.concatenate([part[i] for part in parts], axis=1) for i in (1, 2))
    return Motion(slips, regime, period)


def _block(p: Parameters, lanes: Mapping[str, NDArray[np.float64]], first: int) -> Motion:
    count = len(next(iter(lanes.values())))
    pieces, regimes, periods = [], [], []
    for chunk, (c, verdict) in enumerate(judged_chunks(p, lanes)):
        regimes.append(verdict.regime)
        periods.append(verdict.period)
        cell = np.repeat(np.arange(count), c.offsets[1:] - c.offsets[:-1])
        onset, duration = c.onset.astype(np.int64), c.duration.astype(np.int64)
        goes_on = (onset == 0) & (c.slipping[cell] != 0)
        start = onset + chunk * p.chunk_samples
        pieces.append((cell + first, start, start + duration, c.slip, goes_on))
    return Motion(
        _joined(*(np.concatenate(column) for column in zip(*pieces, strict=True))), *map(np.array, (regimes, periods))
    )


def _joined(
    cell: NDArray[np.int64],
    start: NDArray[np.int64],
    end: NDArray[np.int64],
    slip: NDArray[np.float64],
    goes_on: NDArray[np.bool_],
) -> Slips:
    """Sort pieces of slips by cell and time, and join those that the end of a chunk has cut."""
    order = np.lexsort((start, cell))
    cell, start, end, slip, goes_on = cell[order], start[order], end[order], slip[order], goes_on[order]
    if not len(cell):
        return Slips(cell, start, end, slip)
    begins = np.flatnonzero(~goes_on | (np.diff(cell, prepend=-1) != 0))
    last = np.append(begins[1:], len(cell)) - 1
    return Slips(cell[begins], start[begins], end[last], np.add.reduceat(slip, begins))
