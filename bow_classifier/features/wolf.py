"""A wolf: a note that swells and breaks, many periods long, because a mode of the body takes the string's energy.

It has a memory of `MEMORY` periods (PHYSICS.md section 11). Two things are kept of each cell: how many significant
slips end in each period, and the mean square of the bridge force over one period, `STEPS` times a period. The beat is
sought in the root of the latter, and only where the slips change between one and more a period.

The bridge's velocity would show the beat as well, but it is no stream. In its r.m.s. over one period the beat is seen
directly; in that of the force, the true period, a little longer than the nominal one, leaves a ripple. A mean over one
more period takes the ripple away; docs/verdicts.md compares the two.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_classifier.features.windows import take_window
from bow_classifier.verdict.fingerprint import LEAN
from bow_sim.simd import lanes
from bow_sim.simd.jit import part
from bow_sim.simd.lanes import LANES, root
from bow_sim.simd.rows import transpose

load: Any = lanes.load  # for the type checker: intrinsics are called without their first argument
spread: Any = lanes.spread
store: Any = lanes.store

MEMORY = 100
"""Periods that are looked back on."""

LEAST = 150
"""Periods of the shortest run that is examined, and of the first test: before, the note has not settled."""

STEPS = 16
"""Values of the mean square a period; `_sum_steps` is for this number."""

COARSE = 8
"""Values that are added before the autocorrelation is computed coarsely, and lags that are then decided on together."""

ROUNDING = 1e-9
"""More than all errors of rounding in the coarse autocorrelation, as a share of the sum of squares."""


class WolfState(NamedTuple):
    """What is kept of the last `MEMORY` periods, in a ring of chunks; without cells where no wolf is looked for.

    Attributes
    ----------
    power
        (cells, slots, STEPS * periods of a chunk) float32: mean square of the bridge force over the period before.
    counts
        (cells, slots * periods of a chunk) uint8: significant slips that end in each period.
    """

    power: NDArray[np.float32]
    counts: NDArray[np.uint8]

    @classmethod
    def empty(cls, cells: int, periods: int) -> WolfState:
        """Return the state before t = 0; `periods` is the length of a chunk."""
        slots = -(-MEMORY // periods)
        return cls(np.zeros((cells, slots, STEPS * periods), np.float32), np.zeros((cells, slots * periods), np.uint8))


class Workspace(NamedTuple):
    """The arrays that a wolf is sought in, float64 but for `power`; rows of eight cells are stored one after another.

    Attributes
    ----------
    samples
        (samples * 8,): one period of the bridge force, and eight samples on either side.
    segments
        (values * 8,): sums of squares of the segments of a chunk and of the period before it.
    power
        (8, STEPS * periods of a chunk) float32.
    x, products
        The r.m.s. of one cell, followed by zeros, and the sums of its products at each lag.
    means, coarse
        Means of `COARSE` values of it, and about the sums of products at the lags that are multiples of `COARSE`.
    """

    samples: Any
    segments: Any
    power: Any
    x: Any
    products: Any
    means: Any
    coarse: Any


@part(nogil=True, error_model="numpy")
def wolf_workspace(state, period):
    """Return the workspace for a state, and a nominal period in samples."""
    some = min(state.power.shape[0], 1)  # nothing where no wolf is looked for
    values = state.power.shape[1] * state.power.shape[2] * some
    coarse = values // COARSE
    return Workspace(
        np.zeros((period + 2 * LANES) * LANES * some),
        np.zeros((state.power.shape[2] + STEPS) * LANES * some),
        np.zeros((LANES, state.power.shape[2] * some), np.float32),
        np.zeros(values + values // 2 + 2 * LANES),
        np.zeros(values // 2 + 2 * LANES),
        np.zeros(coarse + coarse // 2 + 4 * LANES),
        np.zeros(coarse // 2 + 3 * LANES),
    )


@part(**LEAN)
def _sum_steps(x, count, each):
    """Write the sum of x[k] and the 15 after it to x[k], of the first `count`; the last 15 are then of no use.

    x has a row of `each` numbers for each k, 1 or 8. Up to seven numbers beyond the last are changed, too.
    """
    for apart in (1, 2, 4, 8):
        for at in range(0, (count - apart) * each, LANES):
            store(x, at, load(x, at) + load(x, at + apart * each))


@part(**LEAN)
def _sum_squares(cells, period, samples, segments):
    """Write the sums of squares of the segments to segments: of the chunk of eight cells, and a period before it."""
    zero, at = spread(0.0), 0
    take_window(cells.before, cells, cells.before.shape[1] - period, period, zero, samples, LANES)
    at = _sum_segments(samples, period, segments, at)
    for begin in range(0, cells.bridge_force.shape[1], period):
        take_window(cells.bridge_force, cells, begin, period, zero, samples, LANES)
        at = _sum_segments(samples, period, segments, at)


@part(**LEAN)
def _sum_segments(samples, period, segments, at):
    """Write the sums of squares of the segments of one period from place `at` on; return the place after them."""
    for k in range(STEPS):
        total = spread(0.0)
        for t in range(k * period // STEPS, (k + 1) * period // STEPS):
            x = load(samples, (t + LANES) * LANES)
            total = total + x * x
        store(segments, at, total)
        at += LANES
    return at


@part(**LEAN)
def keep_power(cells, chunk, period, state, workspace):
    """Keep the mean square of the bridge force in one chunk of eight cells.

    Parameters
    ----------
    cells : EightCells
        Before the chunk is a period or more.
    chunk : int
        Number of the chunk from t = 0 on.
    period : int
        Samples.
    state : WolfState
        The cells are changed.
    workspace : Workspace
    """
    segments, power, slot = workspace.segments, workspace.power, chunk % state.power.shape[1]
    values = power.shape[1]
    _sum_squares(cells, period, workspace.samples, segments)
    _sum_steps(segments, values + STEPS, LANES)
    for k in range(LANES, (values + 1) * LANES, LANES):
        store(segments, k, load(segments, k) / np.float64(period))
    for k in range(0, values, LANES):  # STEPS is a multiple of eight, so values is
        transpose(segments, (k + 1) * LANES, LANES, power, k, values)
    for lane in range(cells.number):
        kept = state.power[cells.first + lane, slot]
        for k in range(values):
            kept[k] = power[lane, k]


@part(**LEAN)
def keep_counts(i, chunk, period, stops, number, state):
    """Keep how many significant slips end in each period of one chunk of cell i.

    Parameters
    ----------
    i : int
        The cell.
    chunk : int
        Number of the chunk from t = 0 on.
    period : int
        Samples.
    stops : ndarray of int64
        First sticking sample after each significant slip, from the start of the chunk.
    number : int
        Of them.
    state : WolfState
        Cell i is changed.
    """
    slots = state.power.shape[1]
    periods = state.counts.shape[1] // slots
    slot = chunk % slots * periods
    counts = state.counts[i, slot : slot + periods]
    counts[:] = 0
    for k in range(number):
        counts[min(stops[k] // period, periods - 1)] += 1


@part(**LEAN)
def _share_of_ones(counts):
    """Return the share of periods with exactly one slip; counts is (periods,)."""
    ones = 0
    for k in range(counts.shape[0]):
        ones += int(counts[k] == 1)
    return ones / counts.shape[0]


@part(**LEAN)
def _turns(oldest, counts):
    """Return how often the periods, from the oldest one on, change between one slip and more; counts is (periods,)."""
    turns, before = 0, -1
    for begin, end in ((oldest, counts.shape[0]), (0, oldest)):
        for k in range(begin, end):
            if counts[k] > 0:  # none ends where the actual period is a little longer
                one = int(counts[k] == 1)
                turns += int(before >= 0 and one != before)
                before = one
    return turns


@part(**LEAN)
def _rms(i, oldest, power, x):
    """Write the r.m.s. over two periods, triangularly weighted, less its mean, to x; return the number of values."""
    slots, values = power.shape[1], power.shape[2]
    at = 0
    for k in range(slots):
        slot = (oldest + k) % slots
        for j in range(values):
            x[at] = np.float64(power[i, slot, j])
            at += 1
    count = at - STEPS + 1
    _sum_steps(x, at, 1)
    for k in range(0, count, LANES):
        store(x, k, root(load(x, k) / np.float64(STEPS)))
    mean = 0.0
    for k in range(count):
        mean += x[k]
    mean /= count
    for k in range(count):
        x[k] -= mean
    x[count:] = 0.0
    return count


@part(**LEAN)
def _correlate(x, count, first, lags, products):
    """Write the sum of x[t] x[t + lag] to products[lag] for the lags from `first` on below `lags`, eight at a time."""
    for lag in range(first, lags, LANES):
        a, b, c, d = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
        for t in range(0, count - 3, 4):
            a = a + x[t] * load(x, t + lag)
            b = b + x[t + 1] * load(x, t + 1 + lag)
            c = c + x[t + 2] * load(x, t + 2 + lag)
            d = d + x[t + 3] * load(x, t + 3 + lag)
        for t in range(count // 4 * 4, count):
            a = a + x[t] * load(x, t + lag)
        store(products, lag, (a + c) + (b + d))


@part(**LEAN)
def _variation(x, count, eight):
    """Return the largest sum of squares of x[t + r] - x[t] for r up to half of `COARSE`; `eight` is workspace."""
    apart = 0.0
    for r in range(1, COARSE // 2 + 1):
        squares, total = spread(0.0), 0.0
        for k in range(0, count, LANES):
            step = load(x, k + r) - load(x, k)
            squares = squares + step * step
        store(eight, 0, squares)
        for k in range(LANES):
            total += eight[k]
        for k in range(r):
            total += x[k] * x[k]  # the samples before the first are 0
        apart = max(apart, total)
    return apart


@part(**LEAN)
def _correlate_coarsely(x, count, lags, whole, means, coarse):
    """Write about the sum of x[t] x[t + COARSE m] to coarse[m], up to that of the first lag not below `lags`.

    Returns
    -------
    float
        How far, at most, the sum at a lag from COARSE m to COARSE (m + 1) is from the nearer one of coarse[m] and
        coarse[m + 1]; NaN where it cannot be told.

    Notes
    -----
    x is the sum of its means c over `COARSE` values and of a rest e, whose means are 0. Where the lag is a multiple of
    `COARSE`, the products of c and e add up to 0, and by Cauchy and Schwarz those of e to |e|^2 at most. A lag that is
    r off such a multiple adds the products of x and d = x[t + r] - x[t], at most |x| |d|.
    """
    blocks = -(-count // COARSE)
    inside = 0.0
    for i in range(blocks):
        total = 0.0
        for k in range(COARSE * i, COARSE * (i + 1)):
            total += x[k]
        means[i] = total / COARSE
        inside += COARSE * means[i] * means[i]
    means[blocks:] = 0.0
    variation = _variation(x, count, coarse)
    _correlate(means, blocks, 0, lags // COARSE + 2, coarse)
    for m in range(lags // COARSE + 2):
        coarse[m] *= COARSE
    return max(whole - inside, 0.0) + np.sqrt(whole * variation) + ROUNDING * whole


@part(**LEAN)
def _highest(x, count, lags, clear, products, means, coarse):
    """Return height and lag of the highest sum beyond the first that is negative, below `lags`, if clear; else lag -1.

    It is clear above `clear` times the sum at lag 0. The sums are computed only where the coarse ones do not tell that
    they are positive and before the first negative one, or negative, or not clear.
    """
    _correlate(x, count, 0, 1, products)
    whole = products[0]
    error = _correlate_coarsely(x, count, lags, whole, means, coarse)
    best, at, beyond = 0.0, -1, False
    for first in range(0, lags, COARSE):
        m = first // COARSE
        low, high = min(coarse[m], coarse[m + 1]) - error, max(coarse[m], coarse[m + 1]) + error
        if high < 0.0:
            beyond = True
        elif not (high <= clear * whole if beyond else low > 0.0):
            _correlate(x, count, first, first + COARSE, products)
            for lag in range(first, min(first + COARSE, lags)):
                beyond = beyond or products[lag] < 0.0
                if beyond and products[lag] > best:
                    best, at = products[lag], lag
    return (best, at) if best > clear * whole else (best, -1)


@part(**LEAN)
def find_beat(i, chunk, state, share, changes, clear, shortest, workspace):
    """Return the beat of cell i after a chunk, periods; NaN where it is no wolf.

    The beat is the lag of the highest value of the r.m.s.'s autocorrelation beyond its first zero and below half the
    record. The sums at all lags are divided by the one at lag 0, so that of a beat and its multiples the beat is
    highest.

    Parameters
    ----------
    i, chunk : int
        The cell, and the number of the chunk.
    state : WolfState
    share : float
        Least share of periods with exactly one slip, and of the others.
    changes : float
        Least number of changes between one slip and more.
    clear : float
        Least height of the autocorrelation at the beat.
    shortest : float
        Periods; what comes back sooner is a subharmonic.
    workspace : Workspace
    """
    counts = state.counts[i]
    if not share <= _share_of_ones(counts) <= 1.0 - share:
        return np.nan
    slots = state.power.shape[1]
    oldest = (chunk + 1) % slots
    if not _turns(oldest * (counts.shape[0] // slots), counts) >= changes:
        return np.nan
    x = workspace.x
    count = _rms(i, oldest, state.power, x)
    _, at = _highest(x, count, count // 2, clear, workspace.products, workspace.means, workspace.coarse)
    return at / STEPS if at > shortest * STEPS else np.nan
