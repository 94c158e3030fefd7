"""The second test: significant slips (section III.B, PHYSICS.md section 7).

A slip is significant when the slip speed, summed over the whole interval, exceeds a threshold: a Helmholtz slip gives
v_b N, the short slips that Schelleng ripples cause at the moment of release give a few percent of it. A slip counts in
the window in which it ends, with its whole sum, including what came before the window.

Significant slips with only a short stick between them form a cluster: the flybacks of multiple flyback motion, which
the paper describes as closely spaced (section IV.A), are often separate slips.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_classifier.verdict.fingerprint import LEAN
from bow_sim.simd import lanes
from bow_sim.simd.jit import part
from bow_sim.simd.lanes import LANES, choose

load: Any = lanes.load  # for the type checker: intrinsics are called without their first argument
spread: Any = lanes.spread
store: Any = lanes.store

FACTORS = np.array([1.0, 0.8, 0.9, 1.1, 1.2])
"""A threshold is applied with each of these factors; the count is sure if all of them give the same."""

_EIGHT_FACTORS = np.append(FACTORS, np.full(LANES - len(FACTORS), np.inf))
"""The same in eight lanes; no slip exceeds the last ones."""

_NEVER = np.int64(-(2**62))

_KINDS = (np.uint8, np.uint32, np.uint32, np.uint32, np.float64)
"""Types of the arrays of `Intervals`."""


class Intervals(NamedTuple):
    """The slip intervals of a chunk, cut at its borders, as in the message StickSlip.

    Attributes
    ----------
    slipping
        (cells,) uint8: 1 = slipping after the last step before this chunk.
    offsets
        (cells + 1,) uint32: intervals of cell i are offsets[i] ... offsets[i + 1] - 1.
    onset, duration
        (intervals,) uint32, samples: first slipping sample within the chunk, and how many.
    slip
        (intervals,) float64, samples times bow speed: sum of the slip speed over the interval.
    """

    slipping: NDArray[np.uint8]
    offsets: NDArray[np.uint32]
    onset: NDArray[np.uint32]
    duration: NDArray[np.uint32]
    slip: NDArray[np.float64]

    def prepared(self) -> Intervals:
        """Return arrays of the types that the pass is compiled for; one of another, as of a message, is copied."""
        arrays: Iterable[tuple[NDArray[Any], type[Any]]] = zip(self, _KINDS, strict=True)
        return Intervals(*(x if x.dtype == kind and x.flags.carray else np.array(x, kind) for x, kind in arrays))


class SlipState(NamedTuple):
    """The slips at the end of a chunk; samples count from the first one of the next chunk.

    Attributes
    ----------
    slipping
        (cells,) bool: a slip continues in the next chunk.
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
    def at_rest(cls, cells: int) -> SlipState:
        """Return the state before t = 0: the string sticks and never slipped."""
        return cls(np.zeros(cells, bool), np.zeros(cells), np.zeros(cells, np.int64), np.full(cells, _NEVER))


class Slips(NamedTuple):
    """The result of the second test for one cell.

    Attributes
    ----------
    number
        Significant slips that end in the window.
    clusters
        Those of them that begin a cluster.
    sure
        0 ... 1: share of the other `FACTORS` that give the same number.
    small
        Insignificant slips that end in the window.
    """

    number: int
    clusters: int
    sure: float
    small: int


@part(**LEAN)
def sureness(tally):
    """Return the share of the other `FACTORS` that give the same count as the first; tally is (factors or more,)."""
    same = 0
    for k in range(1, FACTORS.shape[0]):
        same += int(tally[k] == tally[0])
    return same / (FACTORS.shape[0] - 1)


@part(**LEAN)
def are_in_order(intervals, cells, samples):
    """Return whether the intervals of each cell are in order, separate, and within the chunk, as is supposed below."""
    offsets, onset, duration = intervals.offsets, intervals.onset, intervals.duration
    count = onset.shape[0]
    if offsets.shape[0] != cells + 1 or intervals.slipping.shape[0] != cells:
        return False
    if duration.shape[0] != count or intervals.slip.shape[0] != count or offsets[0] != 0 or offsets[cells] != count:
        return False
    borders = 0  # where the first interval of a cell is not after the last one of the cell before, as it need not be
    for i in range(cells):
        first, end = offsets[i], offsets[i + 1]
        if end < first or end > count:
            return False
        if 0 < first < end:
            past = np.int64(first) - 1
            borders += int(np.int64(onset[first]) <= np.int64(onset[past]) + np.int64(duration[past]))
    outside, overlaps = 0, 0
    for k in range(count):  # no branches, so that several intervals are compared at once
        outside += int((duration[k] < 1) | (np.int64(onset[k]) + np.int64(duration[k]) > samples))
    later = onset[1:]
    for k in range(later.shape[0]):
        overlaps += int(np.int64(later[k]) <= np.int64(onset[k]) + np.int64(duration[k]))
    return outside == 0 and overlaps == borders


@part(**LEAN)
def first_discontinuity(slipping, state):
    """Return the first cell whose chunk does not begin in the state in which the one before ended; -1 for none."""
    for i in range(slipping.shape[0]):
        if (slipping[i] != 0) != state.slipping[i]:
            return i
    return -1


@part(**LEAN)
def count_slips(i, intervals, samples, level, rise, gap, state, tally, onsets, stops):
    """Return the `Slips` of cell i that end in a chunk.

    Parameters
    ----------
    i : int
        The cell.
    intervals : Intervals
        Of the chunk.
    samples : int
        Length of the chunk, which is the window.
    level, rise : float
        Threshold of a slip's sum, samples times bow speed, for one that ends at the start of the chunk, and what it
        grows by each sample: 0, but for a bow that is accelerated without end.
    gap : float
        Samples; two significant slips with a longer stick between them belong to different clusters.
    state : SlipState
        At the end of the chunk before; cell i is changed to the end of this one.
    tally : ndarray of float64, shape (8,)
        Workspace.
    onsets, stops : ndarray of int64
        Changed in place: first slipping sample of each significant slip, and first sticking one after it, from the
        start of the chunk.
    """
    _, offsets, onset, duration, slip = intervals
    slipping, unfinished, began, ended = state
    continues, total, start, last = slipping[i], unfinished[i], began[i], ended[i]
    begin, end = np.int64(offsets[i]), np.int64(offsets[i + 1])
    factors, one = load(_EIGHT_FACTORS, 0), spread(1.0)
    count = spread(0.0)
    number, clusters, ends = 0, 0, 0
    if continues and (begin == end or onset[begin] != 0):  # it ended at the border: sample 0 sticks
        ends += 1
        count = choose(total > factors * level, one, 0.0)
        if total > level:
            onsets[0], stops[0] = start, 0
            clusters += int(start - last > gap)
            number, last = 1, 0
        continues = False
    for k in range(begin, end):  # no branches, which would often be predicted wrongly
        total = total + slip[k] if continues else slip[k]
        start = start if continues else np.int64(onset[k])
        stop = np.int64(onset[k]) + np.int64(duration[k])
        continues = stop == samples
        ends += int(not continues)
        ended_now = -np.inf if continues else total
        least = level + rise * stop
        count = count + choose(ended_now > factors * least, one, 0.0)
        significant = ended_now > least
        onsets[number], stops[number] = start, stop  # the next one overwrites them if this one does not count
        number += int(significant)
        clusters += int(significant & (start - last > gap))
        last = stop if significant else last
    store(tally, 0, count)
    slipping[i] = continues
    unfinished[i] = total if continues else 0.0
    began[i] = start - samples if continues else 0
    ended[i] = max(last - samples, _NEVER)
    return Slips(number, clusters, sureness(tally), ends - number)


def discontinuity(row: int, slips: bool) -> ValueError:
    """Return the error for a cell whose chunk does not begin in the state in which the one before ended."""
    state = "slips" if slips else "sticks"
    return ValueError(f"row {row}: the string {state} at the end of the chunk before, but not before this chunk")
