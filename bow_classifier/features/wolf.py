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

from bow_classifier.verdict.fingerprint import LEAN
from bow_sim.simd import lanes
from bow_sim.simd.jit import part
from bow_sim.simd.lanes import LANES

load: Any = lanes.load  # for the type checker: intrinsics are called without their first argument
spread: Any = lanes.spread
store: Any = lanes.store

MEMORY = 100
"""Periods that are looked back on."""

LEAST = 150
"""Periods of the shortest run that is examined, and of the first test: before, the note has not settled."""

STEPS = 16
"""Values of the mean square a period; `_sum_steps` is for this number."""


class WolfState(NamedTuple):
    """What is kept of the last `MEMORY` periods, in a ring of chunks; without cells where no wolf is looked for.

    Attributes
    ----------
    power
        (cells, slots, STEPS * periods of a chunk) float32: mean square of the bridge force over the period before.
    counts
        (cells, slots, periods of a chunk) uint8: significant slips that end in each period.
    """

    power: NDArray[np.float32]
    counts: NDArray[np.uint8]

    @classmethod
    def empty(cls, cells: int, periods: int) -> WolfState:
        """Return the state before t = 0; `periods` is the length of a chunk."""
        slots = -(-MEMORY // periods)
        return cls(np.zeros((cells, slots, STEPS * periods), np.float32), np.zeros((cells, slots, periods), np.uint8))


class Workspace(NamedTuple):
    """The arrays that a wolf is sought in, float64: `segments` of a record, and the rms `x` with its `products`."""

    segments: Any
    x: Any
    products: Any


@part(nogil=True, error_model="numpy")
def wolf_workspace(state):
    """Return the workspace for a state."""
    values = state.power.shape[1] * state.power.shape[2]
    return Workspace(
        np.zeros(state.power.shape[2] + STEPS),
        np.zeros(values + values // 2 + 2 * LANES),
        np.zeros(values // 2 + 2 * LANES),
    )


@part(**LEAN)
def _sum_steps(x, count):
    """Write the sum of x[k] and the 15 after it to x[k], of the first `count`; the last 15 are then of no use."""
    for apart in (1, 2, 4, 8):
        for k in range(count - apart):
            x[k] += x[k + apart]


@part(**LEAN)
def keep_chunk(i, chunk, row, start, period, stops, number, state, workspace):
    """Keep what a wolf is known by of one chunk of cell i.

    Parameters
    ----------
    i : int
        The cell.
    chunk : int
        Number of the chunk from t = 0 on.
    row : ndarray of float32, shape (start + samples,)
        Bridge force; the chunk begins at `start`, a period or more after the beginning.
    start, period : int
        Samples.
    stops : ndarray of int64
        First sticking sample after each significant slip, from the start of the chunk.
    number : int
        Of them.
    state : WolfState
        Cell i is changed.
    workspace : Workspace
    """
    segments, slot = workspace.segments, chunk % state.power.shape[1]
    power, counts = state.power[i, slot], state.counts[i, slot]
    for k in range(segments.shape[0]):
        begin, end = start - period + k * period // STEPS, start - period + (k + 1) * period // STEPS
        total = 0.0
        for t in range(begin, end):
            total += np.float64(row[t]) * np.float64(row[t])
        segments[k] = total
    _sum_steps(segments, segments.shape[0])
    for k in range(power.shape[0]):
        power[k] = np.float32(segments[k + 1] / period)
    counts[:] = 0
    for k in range(number):
        counts[min(stops[k] // period, counts.shape[0] - 1)] += 1


@part(**LEAN)
def _alternates(i, oldest, counts, share, changes):
    """Return whether the periods of cell i change between one slip and more, often enough."""
    slots, periods = counts.shape[1], counts.shape[2]
    ones, turns, before = 0, 0, -1
    for k in range(slots):
        slot = (oldest + k) % slots
        for j in range(periods):
            slips = counts[i, slot, j]
            if slips > 0:  # none ends where the actual period is a little longer
                one = int(slips == 1)
                ones += one
                turns += int(before >= 0 and one != before)
                before = one
    part = ones / (slots * periods)
    return share <= part <= 1.0 - share and turns >= changes


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
    _sum_steps(x, at)
    mean = 0.0
    for k in range(count):
        x[k] = np.sqrt(x[k] / STEPS)
        mean += x[k]
    mean /= count
    for k in range(count):
        x[k] -= mean
    x[count:] = 0.0
    return count


@part(**LEAN)
def _correlate(x, count, lags, products):
    """Write the sum of x[t] x[t + lag] to products[lag] for the lags below `lags`; x is 0 from `count` on."""
    for lag in range(0, lags, LANES):
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
    oldest = (chunk + 1) % state.power.shape[1]
    if not _alternates(i, oldest, state.counts, share, changes):
        return np.nan
    x, products = workspace.x, workspace.products
    count = _rms(i, oldest, state.power, x)
    lags = count // 2
    _correlate(x, count, lags, products)
    whole = products[0]
    best, at, beyond = 0.0, -1, False
    for lag in range(lags):
        beyond = beyond or products[lag] < 0.0
        if beyond and products[lag] > best:
            best, at = products[lag], lag
    return at / STEPS if best > clear * whole and at > shortest * STEPS else np.nan
