"""All tests and the rule over the cells of a block in one pass: a record is read once, and used while it is at hand."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_classifier.features.corners import count_corners
from bow_classifier.features.long_periods import long_workspace, search_row
from bow_classifier.features.periodicity import judge_eight, workspace
from bow_classifier.features.ripples import ripple_share
from bow_classifier.features.slips import NEIGHBOURS, count_slips, wrong_start
from bow_classifier.verdict.decision import LONG, decide_cell
from bow_classifier.verdict.fingerprint import LEAN, VERSION
from bow_sim.simd.columns import expect
from bow_sim.simd.jit import njit
from bow_sim.simd.lanes import LANES

FEW = 8
"""Counts below this may be one a period, to the nearest whole number, in five nominal periods of an actual one."""

_TALLIES = len(NEIGHBOURS) + 1

_LINE = 16
"""Samples in a cache line."""


class Strings(NamedTuple):
    """What the tests must know of every cell; arrays are (cells,).

    Attributes
    ----------
    delay
        int64, samples: ripple period.
    height
        float64: v_b/beta, the flyback of Helmholtz motion.
    corner, slip
        float64: the thresholds of a corner, in units of the bridge force, and of a slip, samples times bow speed.
    spread, gap
        float64, samples: longest time between two corners, and longest stick between two slips, of a cluster.
    """

    delay: NDArray[np.int64]
    height: NDArray[np.float64]
    corner: NDArray[np.float64]
    slip: NDArray[np.float64]
    spread: NDArray[np.float64]
    gap: NDArray[np.float64]


class Lags(NamedTuple):
    """First and last of the lags searched, samples: those near the nominal period, and the long ones."""

    first: int
    last: int
    shortest: int
    longest: int


@njit(**LEAN)
def _copy(x, out):
    for t in range(out.shape[0]):  # an assignment of slices takes four times as long
        out[t] = x[t]


@njit(**LEAN)
def _take(i, history, bridge_force, row):
    """Write the record of cell i to row, what came before the chunk and the chunk; keep its end as history."""
    before, start = history[i], history.shape[1]
    _copy(before, row[:start])
    _copy(bridge_force[i], row[start:])
    _copy(row[row.shape[0] - start :], before)


@njit(**LEAN)
def _expect(array, i):
    """Have a row of an array fetched while there is other work; a tenth of the time would go on waiting for it."""
    for at in range(i * array.shape[1], (i + 1) * array.shape[1], _LINE):
        expect(array, at)


@njit(**LEAN)
def _undecided(i, e, limits):
    """Return where the name hangs on the ripples: no Helmholtz motion, one slip or a flyback cluster a period."""
    periods, period, _, least, _, _, _, _ = limits
    if not (e.correlation[i] > least and e.period[i] < LONG * period):
        return False
    slips, corners = e.slips[i], e.corners[i]
    one = slips < FEW and corners < FEW and (slips != periods or corners != periods)
    return one or (corners > 2 * periods and e.corner_clusters[i] < FEW)


@njit(**LEAN)
def _judge_cell(i, row, start, strings, lags, limits, e, room):
    """Write to the evidence what the third test, the long lags and the ripples say of cell i."""
    _, period, _, least, silence, _, _, _ = limits
    levels, tally, long, turns = room
    delay = strings.delay[i]
    found = count_corners(row, start, delay, strings.corner[i], strings.spread[i], levels, tally)
    e.corners[i], e.corner_clusters[i], e.sure_corners[i] = found
    e.loudness[i] /= strings.height[i]
    if e.slips[i] > 0 and e.loudness[i] >= silence and not e.correlation[i] > least:
        height, lag = search_row(row, start, int(period), lags.shortest, lags.longest, least, long)
        if height > least:
            e.correlation[i], e.period[i] = height, lag
    e.ripple[i] = ripple_share(row, e.period[i], delay, turns) if _undecided(i, e, limits) else 0.0


@njit(**LEAN)
def _judge_all(history, bridge_force, intervals, unfinished, strings, lags, limits, e, decision, room):
    """Judge all cells, eight at a time."""
    rows, near, eight, tally, others = room
    start, cells, samples, period = history.shape[1], history.shape[0], bridge_force.shape[1], int(limits[1])
    height, lag, deviation = eight
    slipped = e.slips, e.slip_clusters, e.sure_slips, e.small_slips
    for group in range(0, cells, LANES):
        number = min(LANES, cells - group)  # lanes without a cell go on with whatever there is
        for lane in range(number):
            _take(group + lane, history, bridge_force, rows[lane])
        judge_eight(rows, start, period, lags.first, lags.last, near, height, lag, deviation)
        for lane in range(number):
            i = group + lane
            if i + LANES < cells:
                _expect(bridge_force, i + LANES)
                _expect(history, i + LANES)
            e.correlation[i], e.period[i], e.loudness[i] = height[lane], lag[lane], deviation[lane]
            count_slips(i, intervals, samples, strings.slip[i], strings.gap[i], unfinished, slipped, tally)
            _judge_cell(i, rows[lane], start, strings, lags, limits, e, others)
            decide_cell(i, e, limits, decision)


def build(version: int) -> Any:
    """Make the compiled pass, to be cached as this version; see `bow_classifier.verdict.fingerprint`."""

    @njit(nogil=True, cache=True, error_model="numpy")
    def judge(history, bridge_force, slipping, intervals, unfinished, strings, lags, limits, evidence, decision):
        wrong = wrong_start(slipping, unfinished)
        if wrong >= 0 or version < 0:
            return wrong
        samples, period = bridge_force.shape[1], int(limits[1])
        end = history.shape[1] + samples
        others = (
            np.empty(LANES, np.float32),
            np.empty(LANES, np.float32),
            long_workspace(samples, period, lags.shortest, lags.longest),
            (np.empty((2, LANES)), np.empty(LANES), np.empty(end)),
        )
        room = (
            np.zeros((LANES, end), np.float32),
            workspace(samples, period, lags.first, lags.last),
            (np.empty(LANES), np.empty(LANES), np.empty(LANES)),
            np.empty(_TALLIES, np.int64),
            others,
        )
        _judge_all(history, bridge_force, intervals, unfinished, strings, lags, limits, evidence, decision, room)
        return wrong

    return judge


judge_cells = build(VERSION)
"""Judge a chunk: write evidence and decision, and to history and `Unfinished` what the chunk leaves to the next one.

Returns the first cell whose slips do not continue the chunk before, and has then changed nothing; -1 for none.
"""
