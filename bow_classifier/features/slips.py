"""The second test: significant slips (section III.B, PHYSICS.md section 7).

A slip is significant when the slip speed, integrated over the whole interval, exceeds a threshold: a whole Helmholtz
slip gives v_b N, the slips of Schelleng ripples at the moment of release a few percent of it. A slip counts in the
window in which it ends, with all of its integral, also what came before.

Significant slips with only a short stick between them are a cluster: the flybacks of multiple flyback motion, which
the paper describes as closely spaced (section IV.A), are often slips of their own.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_classifier.verdict.fingerprint import LEAN
from bow_sim.simd.jit import njit

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

    @classmethod
    def empty(cls, cells: int) -> Slips:
        """Return room for the results."""
        return cls(np.empty(cells, np.uint16), np.empty(cells, np.uint16), np.empty(cells), np.empty(cells, np.uint16))


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


@njit(**LEAN)
def _end(total, level, tally):
    """Count a slip that has ended, under every factor of the threshold; return whether it is significant."""
    for j in range(_FACTORS.shape[0]):
        tally[j] += int(total > _FACTORS[j] * level)
    return total > level


@njit(**LEAN)
def wrong_start(slipping, unfinished):
    """Return the first cell that did not end the chunk before as this one says, -1 for none."""
    for i in range(slipping.shape[0]):
        if (slipping[i] != 0) != unfinished.slipping[i]:
            return i
    return -1


@njit(**LEAN)
def count_slips(i, intervals, samples, level, gap, state, result, tally):
    """Write what the second test says of cell i to `result`, and to `state` what its chunk leaves."""
    offsets, onset, duration, slip = intervals
    slipping, unfinished, began, ended = state
    number, clusters, sure, small = result
    goes_on, total, start, last = slipping[i], unfinished[i], began[i], ended[i]
    begin, end = np.int64(offsets[i]), np.int64(offsets[i + 1])
    tally[:] = 0
    apart, ends = 0, 0
    if goes_on and (begin == end or onset[begin] != 0):  # it ended at the border: sample 0 sticks
        ends += 1
        if _end(total, level, tally):
            apart += int(start - last > gap)
            last = 0
        goes_on = False
    for k in range(begin, end):
        if goes_on:
            total += slip[k]
        else:
            total, start = slip[k], np.int64(onset[k])
        stop = np.int64(onset[k]) + np.int64(duration[k])
        goes_on = stop == samples
        ends += int(not goes_on)
        if not goes_on and _end(total, level, tally):
            apart += int(start - last > gap)
            last = stop
    slipping[i] = goes_on
    unfinished[i] = total if goes_on else 0.0
    began[i] = start - samples if goes_on else 0
    ended[i] = max(last - samples, _NEVER)
    number[i] = tally[0]
    clusters[i] = apart
    small[i] = ends - tally[0]
    same = 0
    for j in range(1, tally.shape[0]):
        same += int(tally[j] == tally[0])
    sure[i] = same / (tally.shape[0] - 1)


@njit(nogil=True, cache=True, error_model="numpy")
def _slips(slipping, intervals, samples, level, gap, state, result):
    """Write what the second test says of all cells; return the first that does not continue `state`, -1 for none."""
    wrong = wrong_start(slipping, state)
    if wrong < 0:
        tally = np.empty(_FACTORS.shape[0], np.int64)
        for i in range(level.shape[0]):
            count_slips(i, intervals, samples, level[i], gap[i], state, result, tally)
    return wrong


def plain(intervals: Intervals) -> tuple[NDArray[Any], ...]:
    """Return copies of the arrays, for compiled functions: views of a message may be unaligned."""
    offsets, onset, duration = (np.array(array, np.uint32) for array in intervals[1:4])
    return np.array(intervals.slipping, np.uint8), offsets, onset, duration, np.array(intervals.slip, np.float64)


def refusal(row: int, slips: bool) -> ValueError:
    """Return the error for a cell whose chunk does not begin as the one before ended: slipping or not."""
    state = "slips" if slips else "sticks"
    return ValueError(f"row {row}: the string {state} at the end of the chunk before, not so this one says")


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
    result, after = Slips.empty(len(level)), Unfinished._make(array.copy() for array in before)
    parts = plain(intervals)
    wrong = _slips(parts[0], parts[1:], samples, level, gap, after, result)
    if wrong >= 0:
        raise refusal(wrong, before.slipping[wrong])
    return result, after
