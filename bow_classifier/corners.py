"""The third test: travelling Raman corners in the bridge force (section III.B, PHYSICS.md section 7).

The bridge force x is averaged over one period of the Schelleng ripples, bow-bridge-bow, and differentiated; together
y[t] = x[t] - x[t - d], d the ripple period: a corner that passes raises a pulse of width d and about height v_b/beta.
A corner is the onset of |y| above the threshold, either sign, armed again when y falls below it or changes sign.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .slips import NEIGHBOURS


class Corners(NamedTuple):
    """What the third test says of the cells of a block.

    Attributes
    ----------
    number
        (cells,) uint16: corners in the window.
    sure
        (cells,) float64, 0 ... 1: share of neighbouring thresholds (`NEIGHBOURS` times the threshold) under which the
        count is the same.
    """

    number: NDArray[np.uint16]
    sure: NDArray[np.float64]


@njit(nogil=True, cache=True, error_model="numpy")
def _onsets(y, level):
    """Return how often |y| comes to exceed `level` with a sign that it had not, above `level`, one sample before.

    Armed means no more than that: whether the sample before was above with the same sign. No state but y is needed.
    """
    before, now = y[:-1], y[1:]
    count = 0
    for t in range(now.shape[0]):
        count += ((now[t] > level) & (not before[t] > level)) | ((now[t] < -level) & (not before[t] < -level))
    return count


@njit(nogil=True, cache=True, error_model="numpy")
def _corners(record, start, delay, level, neighbours, number, sure):
    size = record.shape[1] - start + 1  # from one sample before the window on
    y = np.empty(size)
    for i in range(record.shape[0]):
        now, earlier = record[i, start - 1 :], record[i, start - 1 - delay :]
        for t in range(size):
            y[t] = np.float64(now[t]) - np.float64(earlier[t])
        onsets = _onsets(y, level[i])
        same = 0
        for k in range(neighbours.shape[0]):
            same += int(_onsets(y, neighbours[k] * level[i]) == onsets)
        number[i] = onsets
        sure[i] = same / neighbours.shape[0]


def corners(record: NDArray[np.float32], start: int, delay: int, level: NDArray[np.float64]) -> Corners:
    """Return how many corners pass in the window, for every cell.

    Parameters
    ----------
    record
        (cells, start + samples) bridge force; the window is ``record[:, start:]``, what precedes it came before
        (0 before t = 0).
    start
        Samples before the window, at least `delay` + 1: the sample before the window tells what is no onset.
    delay
        Ripple period in samples: round trip bow-bridge-bow.
    level
        (cells,) threshold of |y|, in units of the bridge force.

    Raises
    ------
    ValueError
        Where the record does not reach far enough back.
    """
    if not 0 < delay < start < record.shape[1]:
        raise ValueError(f"record {record.shape}, window from {start}: should begin more than {delay} samples earlier")
    cells = record.shape[0]
    result = Corners(np.empty(cells, np.uint16), np.empty(cells))
    _corners(record, start, delay, level, NEIGHBOURS, *result)
    return result
