"""The second test: significant slips (section III.B, PHYSICS.md section 7).

A slip is significant when the slip speed, integrated over the whole interval, exceeds a threshold: a whole Helmholtz
slip gives v_b N, the slips of Schelleng ripples at the moment of release a few percent of it. A slip counts in the
window in which it ends, with all of its integral, also what came before.

Significant slips with only a short stick between them are a cluster: the flybacks of multiple flyback motion, which
the paper describes as closely spaced (section IV.A), are often slips of their own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

NEIGHBOURS = np.array([0.8, 0.9, 1.1, 1.2])
"""Factors of a threshold under which a count should stay the same if it is to be trusted."""

_NEVER = np.int64(-(2**62))

_FACTORS = np.concatenate([[1.0], NEIGHBOURS])


class Intervals(NamedTuple):
    """The slip intervals of a chunk, cut at its borders, as the message StickSlip has them.

    Attributes
    ----------
    slipping
        (cells,) uint8: 1 = slipping after the last step before this chunk.
    offsets
        (cells + 1,) uint32: intervals of cell i are offsets[i] ... offsets[i + 1] - 1.
    onset, duration
        (intervals,) uint32, samples: first slipping sample within the chunk, and how many.
    slip
        (intervals,) float64: sum of the slip speed over the interval.
    """

    slipping: NDArray[np.uint8]
    offsets: NDArray[np.uint32]
    onset: NDArray[np.uint32]
    duration: NDArray[np.uint32]
    slip: NDArray[np.float64]


class Slips(NamedTuple):
    """What the second test says of the cells of a block.

    Attributes
    ----------
    number
        (cells,) uint16: significant slips that end in the window.
    clusters
        (cells,) uint16: those of them that begin a cluster.
    sure
        (cells,) float64, 0 ... 1: share of neighbouring thresholds (`NEIGHBOURS` times the threshold) under which the
        count is the same.
    small
        (cells,) uint16: insignificant slips that end in the window.
    """

    number: NDArray[np.uint16]
    clusters: NDArray[np.uint16]
    sure: NDArray[np.float64]
    small: NDArray[np.uint16]


class Unfinished(NamedTuple):
    """What a chunk leaves to the next one; samples count from the next one's first.

    Attributes
    ----------
    slipping
        (cells,) bool: a slip goes on.
    slip
        (cells,) float64: its sum so far.
    onset
        (cells,) int64, samples: where it began.
    ended
        (cells,) int64, samples: first sticking sample after the latest significant slip.
    """

    slipping: NDArray[np.bool_]
    slip: NDArray[np.float64]
    onset: NDArray[np.int64]
    ended: NDArray[np.int64]

    @classmethod
    def none(cls, cells: int) -> Unfinished:
        """Return the state at the start: the string sticks and never slipped."""
        return cls(np.zeros(cells, bool), np.zeros(cells), np.zeros(cells, np.int64), np.full(cells, _NEVER))


@njit(nogil=True, cache=True, error_model="numpy")
def _end(total, level, factors, tally):
    """Count a slip that has ended, under every factor of the threshold; return whether it is significant."""
    for j in range(factors.shape[0]):
        tally[j] += int(total > factors[j] * level)
    return total > level


@njit(nogil=True, cache=True, error_model="numpy")
def _slips(
    offsets,
    onset,
    duration,
    slip,
    samples,
    level,
    gap,
    factors,
    slipping,
    unfinished,
    began,
    ended,
    number,
    clusters,
    sure,
    small,
):
    tally = np.empty(factors.shape[0], np.int64)
    for i in range(level.shape[0]):
        begin, end = offsets[i], offsets[i + 1]
        goes_on, total, start, last = slipping[i], unfinished[i], began[i], ended[i]
        tally[:] = 0
        apart, ends = 0, 0
        if goes_on and (begin == end or onset[begin] != 0):  # it ended at the border: sample 0 sticks
            ends += 1
            if _end(total, level[i], factors, tally):
                apart += int(start - last > gap[i])
                last = 0
            goes_on = False
        for k in range(begin, end):
            if goes_on:
                total += slip[k]
            else:
                total, start = slip[k], onset[k]
            stop = onset[k] + duration[k]
            goes_on = stop == samples
            ends += int(not goes_on)
            if not goes_on and _end(total, level[i], factors, tally):
                apart += int(start - last > gap[i])
                last = stop
        slipping[i] = goes_on
        unfinished[i] = total if goes_on else 0.0
        began[i] = start - samples if goes_on else 0
        ended[i] = max(last - samples, _NEVER)
        number[i] = tally[0]
        clusters[i] = apart
        small[i] = ends - tally[0]
        same = 0
        for j in range(1, factors.shape[0]):
            same += int(tally[j] == tally[0])
        sure[i] = same / (factors.shape[0] - 1)


def slips(
    intervals: Intervals, samples: int, level: NDArray[np.float64], gap: NDArray[np.float64], before: Unfinished
) -> tuple[Slips, Unfinished]:
    """Return the significant slips that end in a chunk, for every cell, and what it leaves.

    Parameters
    ----------
    intervals
        The chunk's slip intervals.
    samples
        Length of the chunk, which is the window.
    level
        (cells,) threshold of the integrated slip, in samples times bow speed.
    gap
        (cells,) samples: two significant slips with a longer stick between them belong to different clusters.
    before
        What the chunk before left.

    Raises
    ------
    ValueError
        Where the chunk does not begin in the state in which the one before ended.
    """
    wrong = np.flatnonzero((intervals.slipping != 0) != before.slipping)
    if len(wrong):
        state = "slips" if before.slipping[wrong[0]] else "sticks"
        raise ValueError(f"row {wrong[0]}: the string {state} at the end of the chunk before, not so this one says")
    cells = len(level)
    result = Slips(np.empty(cells, np.uint16), np.empty(cells, np.uint16), np.empty(cells), np.empty(cells, np.uint16))
    after = Unfinished._make(array.copy() for array in before)
    _slips(
        intervals.offsets.astype(np.int64),
        intervals.onset.astype(np.int64),
        intervals.duration.astype(np.int64),
        intervals.slip.astype(np.float64),  # astype copies: views of a message may be unaligned
        samples,
        level,
        gap,
        _FACTORS,
        *after,
        *result,
    )
    return result, after
