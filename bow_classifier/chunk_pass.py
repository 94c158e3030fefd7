"""All features and the decision for the cells of a block, in one pass: each record is read once, while it is in cache.

This is the only compiled function of the classifier that is cached; it contains the functions of
:mod:`bow_classifier.features` and :mod:`bow_classifier.verdict` that it calls.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_classifier.features.corners import corner_workspace, count_corners
from bow_classifier.features.first_slips import Releases, transient_after
from bow_classifier.features.long_periods import long_workspace, search_row
from bow_classifier.features.next_rows import NextRows, fetch_before, fetch_intervals, fetch_samples, fetch_third
from bow_classifier.features.periodicity import EightMaxima, correlate_eight, periodicity_workspace
from bow_classifier.features.ripples import ripple_share, ripple_workspace
from bow_classifier.features.slips import Intervals, SlipState, are_in_order, count_slips, first_discontinuity
from bow_classifier.features.windows import EightCells
from bow_classifier.features.wolf import LEAST, WolfState, find_beat, keep_counts, keep_power, wolf_workspace
from bow_classifier.verdict.confidence import confidence_workspace
from bow_classifier.verdict.decision import LONG, Decision, Features, Limits, decide_eight
from bow_classifier.verdict.fingerprint import LEAN, VERSION
from bow_sim.simd.jit import njit, part
from bow_sim.simd.lanes import LANES

FEW = 8
"""In five nominal periods, fewer events than this may be one in each actual period, which may be a little longer."""

ONCE: dict[str, Any] = {**LEAN, "forceinline": True}
"""For small functions, and those called in one place: they take a hundred arrays. LLVM inlines them or not depending on
how much code there is; a call for every cell copies seven words of each array, and takes a twentieth of the time."""

DISORDER = -2
"""What the pass returns for slip intervals that cannot be."""


class Strings(NamedTuple):
    """Ripple period, height and thresholds of every cell; arrays are (cells,).

    Attributes
    ----------
    delay
        int64, samples: ripple period.
    height
        float64: v_b/beta, the flyback of Helmholtz motion.
    corner, slip
        float64: the thresholds of a corner, in units of the bridge force, and of a slip, samples times bow speed.
    rise
        float64, bow speed: what the threshold of a slip grows by each sample, from the start of the chunk on.
    spread, gap
        float64, samples: longest time between two corners, and longest stick between two slips, of a cluster.
    """

    delay: NDArray[np.int64]
    height: NDArray[np.float64]
    corner: NDArray[np.float64]
    slip: NDArray[np.float64]
    rise: NDArray[np.float64]
    spread: NDArray[np.float64]
    gap: NDArray[np.float64]


class Lags(NamedTuple):
    """First and last of the lags searched, samples: those near the nominal period, and the long ones."""

    first: int
    last: int
    shortest: int
    longest: int


class Setup(NamedTuple):
    """What stays the same for all chunks of a block; `start` samples before a chunk are part of its records."""

    strings: Strings
    lags: Lags
    limits: Limits
    start: int


class BlockState(NamedTuple):
    """What one chunk leaves to the next.

    Attributes
    ----------
    before
        (cells, `Setup.start` samples or more) float32, C-contiguous and read-only: the bridge force before the next
        chunk; 0 before t = 0.
    slips
        The slips at the border.
    wolf
        What is kept of many periods; without cells in a run that is too short for a wolf.
    releases
        The significant slips since t = 0; without cells but for a bow that is accelerated without end.
    """

    before: NDArray[np.float32]
    slips: SlipState
    wolf: WolfState
    releases: Releases


class Chunk(NamedTuple):
    """A chunk of a block: bridge force, (cells, samples) float32, C-contiguous and read-only, and slip intervals.

    `number` counts the chunks of the block from 0 on.
    """

    bridge_force: NDArray[np.float32]
    intervals: Intervals
    number: int


class Result(NamedTuple):
    """Where the pass writes what it finds."""

    features: Features
    decision: Decision


class _Workspace(NamedTuple):
    """The arrays that a pass works in: the record of a cell, (start + samples,) float32, and those of its parts.

    `slip_tally` is (8,) float64; `onsets` and `stops` of the significant slips of a cell are int64.
    """

    row: Any
    periodicity: Any
    maxima: Any
    slip_tally: Any
    onsets: Any
    stops: Any
    corners: Any
    long_periods: Any
    ripples: Any
    wolf: Any
    confidence: Any


@part(nogil=True, error_model="numpy")
def _workspace(samples, start, period, lags, wolf):
    return _Workspace(
        np.zeros(start + samples, np.float32),
        periodicity_workspace(samples, period, lags.first, lags.last),
        EightMaxima(np.empty(LANES), np.empty(LANES), np.empty(LANES)),
        np.empty(LANES),
        np.empty(samples // 2 + 2, np.int64),
        np.empty(samples // 2 + 2, np.int64),
        corner_workspace(samples),
        long_workspace(samples, period, lags.shortest, lags.longest),
        ripple_workspace(start + samples),
        wolf_workspace(wolf, period),
        confidence_workspace(),
    )


@part(**LEAN)
def _copy(x, out):
    for t in range(out.shape[0]):  # an assignment of slices takes four times as long
        out[t] = x[t]


@part(**ONCE)
def _take_before(i, before, row, first, start):
    """Write the samples before the chunk of cell i to row, where it begins at `start`, from place `first` on."""
    past = before[i]
    _copy(past[past.shape[0] - start + first :], row[first:start])


@part(**ONCE)
def _needs_ripple(i, features, limits):
    """Return whether a rule compares the ripples of cell i: not Helmholtz, but one slip or flyback cluster a period."""
    if not (features.correlation[i] > limits.correlation and features.period[i] < LONG * limits.period):
        return False
    slips, corners = features.slips[i], features.corners[i]
    one = slips < FEW and corners < FEW and (slips != limits.periods or corners != limits.periods)
    return one or (corners > 2 * limits.periods and features.corner_clusters[i] < FEW)


@part(**ONCE)
def _measure_cell(i, before, row, near, setup, features, workspace):
    """Write corners, long period and ripples of cell i to the features, which have the first two tests already.

    Row has the chunk, and of what comes before it the last `near` samples.
    """
    strings, lags, limits, start = setup
    delay = strings.delay[i]
    corners = count_corners(row, start, delay, strings.corner[i], strings.spread[i], workspace.corners)
    features.corners[i], features.corner_clusters[i], features.sure_corners[i] = corners
    features.loudness[i] /= strings.height[i]
    moves = features.slips[i] > 0 and features.loudness[i] >= limits.silence
    if moves and not features.correlation[i] > limits.correlation:
        _take_before(i, before, row, 0, start)
        height, lag = search_row(
            row, start, int(limits.period), lags.shortest, lags.longest, limits.correlation, workspace.long_periods
        )
        if height > limits.correlation:
            features.correlation[i], features.period[i] = height, lag
    features.ripple[i] = (
        ripple_share(row, features.period[i], delay, workspace.ripples) if _needs_ripple(i, features, limits) else 0.0
    )


@part(**ONCE)
def _remember(i, chunk, row, start, slips, limits, longest, wolf, releases, workspace, onsets, stops, beat, transient):
    """Write what has a memory longer than the record of cell i: the beat of a wolf, and Guettler's transient.

    `chunk` is its number, `slips` that of the significant slips in it, `longest` the longest lag, samples.
    """
    period, samples = int(limits.period), row.shape[0] - start
    beat[i] = transient[i] = np.nan
    if wolf.power.shape[0] > 0:
        keep_counts(i, chunk, period, stops, slips, wolf)
        if (chunk + 1) * samples >= LEAST * period:
            share, changes, clear = limits.wolf_share, limits.wolf_changes, limits.wolf_beat
            beat[i] = find_beat(i, chunk, wolf, share, changes, clear, longest / period, workspace)
    if releases.first.shape[0] > 0:
        transient[i] = transient_after(i, chunk * samples, period, onsets, slips, releases)


@part(**ONCE)
def _classify_all(state, chunk, setup, result, workspace):
    """Classify all cells, eight at a time."""
    before, slip_state = state.before, state.slips
    bridge_force, intervals = chunk.bridge_force, chunk.intervals
    strings, lags, limits, start = setup
    features, decision = result
    row, maxima = workspace.row, workspace.maxima
    cells, samples, period = bridge_force.shape[0], bridge_force.shape[1], int(limits.period)
    longest = max(lags.last, period)
    for delay in strings.delay:
        longest = max(longest, delay)
    near = min(start, longest + 1)  # only the search for long periods needs all samples before the chunk
    for group in range(0, cells, LANES):
        number = min(LANES, cells - group)
        eight = EightCells(bridge_force, before, group, number)
        ahead = NextRows(bridge_force, before, near, group + LANES, min(LANES, max(cells - group - LANES, 0)))
        if state.wolf.power.shape[0] > 0:
            keep_power(eight, chunk.number, period, state.wolf, workspace.wolf)
        correlate_eight(eight, period, lags.first, lags.last, workspace.periodicity, maxima)
        fetch_intervals(intervals, ahead)
        for lane in range(number):
            i = group + lane
            fetch_third(ahead, lane, 0)
            features.correlation[i], features.period[i] = maxima.height[lane], maxima.lag[lane]
            features.loudness[i] = maxima.deviation[lane]
            if not features.correlation[i] > limits.correlation:  # long periods may be searched for
                end = (i + 1) * before.shape[1]
                fetch_samples(before, end - start, end - near)
            slips = count_slips(
                i, intervals, samples, strings.slip[i], strings.rise[i], strings.gap[i], slip_state,
                workspace.slip_tally, workspace.onsets, workspace.stops,
            )  # fmt: skip
            features.slips[i], features.slip_clusters[i], features.sure_slips[i], features.small_slips[i] = slips
            fetch_third(ahead, lane, 1)
            fetch_before(ahead, lane)
            _take_before(i, before, row, start - near, start)
            _copy(bridge_force[i], row[start:])
            _measure_cell(i, before, row, near, setup, features, workspace)
            fetch_third(ahead, lane, 2)
            _remember(
                i, chunk.number, row, start, features.slips[i], limits, lags.longest, state.wolf, state.releases,
                workspace.wolf, workspace.onsets, workspace.stops, features.beat, features.transient,
            )  # fmt: skip
        decide_eight(group, number, features, limits, decision, workspace.confidence)


def build(version: int) -> Any:
    """Make the compiled pass, to be cached as this version; see `bow_classifier.verdict.fingerprint`."""

    @njit(nogil=True, cache=True, error_model="numpy")
    def classify(state, chunk, setup, result):
        if version < 0 or not are_in_order(chunk.intervals, *chunk.bridge_force.shape):
            return DISORDER
        wrong = first_discontinuity(chunk.intervals.slipping, state.slips)
        if wrong >= 0:
            return wrong
        workspace = _workspace(
            chunk.bridge_force.shape[1], setup.start, int(setup.limits.period), setup.lags, state.wolf
        )
        _classify_all(state, chunk, setup, result, workspace)
        return wrong

    return classify


classify_cells = build(VERSION)
"""Classify the cells of a block after a chunk.

Parameters
----------
state : BlockState
    Changed in place to what this chunk leaves to the next.
chunk : Chunk
setup : Setup
result : Result
    Changed in place.

Returns
-------
int
    -1; where nothing has been changed, the first cell whose slips do not continue the chunk before, or `DISORDER`.
"""
