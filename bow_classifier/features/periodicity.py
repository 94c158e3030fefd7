"""The first test: is the bridge force periodic, and with which period (section III.B, PHYSICS.md section 7).

For each integer lag around the nominal period, the Pearson correlation of each of the last five periods with the same
window one lag earlier, averaged over the five; then, at each interior local maximum, the quadratic through three
neighbouring lags. The largest maximum is the result; its place is the period. Eight cells are computed at a time, each
in its own lane.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from bow_classifier.features.windows import line_aligned, take_window
from bow_classifier.verdict.fingerprint import LEAN
from bow_sim.simd import columns as transposition
from bow_sim.simd import lanes
from bow_sim.simd.jit import part
from bow_sim.simd.lanes import LANES, choose, root
from bow_sim.simd.products import lagged_products

load: Any = lanes.load  # for the type checker: intrinsics are called without their first argument
spread: Any = lanes.spread
store: Any = lanes.store
mask_of: Any = lanes.mask_of
columns: Any = transposition.columns

CONSTANT = 1e-13
"""A window is constant if its variation is no more than this share of its sum of squares: rounding makes as much."""

_MANY, _FEW = 11, 6
"""Lags whose products are summed together, so that each sample is read once for all of them.

A string of 139 samples has eleven. Lags left over are computed as six, more than six as eleven.
"""

_many_products, _few_products = lagged_products(_MANY), lagged_products(_FEW)


class Workspace(NamedTuple):
    """The arrays that `correlate_eight` works in, float64; rows of eight cells are stored one after another.

    Attributes
    ----------
    x
        (samples * 8,): the bridge force, less a sample of each cell, in all windows and before them.
    level
        (8,): that sample.
    products
        (lags * 8,): sums of products at each lag, for a number of lags rounded up.
    correlations
        (lags * 8,): at the lags from the last to the first.
    """

    x: Any
    level: Any
    products: Any
    correlations: Any


class EightMaxima(NamedTuple):
    """The result of the first test for eight cells; arrays are (8,) float64.

    Attributes
    ----------
    height
        -1 ... 1: the correlation at its largest interior maximum; NaN where there is none.
    lag
        Samples: its place; NaN where there is none.
    deviation
        Units of the bridge force: r.m.s. deviation from the mean over the whole window.
    """

    height: Any
    lag: Any
    deviation: Any


@part(**LEAN)
def _rows_before(last, period):
    """Return how many rows x has before the first window."""
    return max(last + 1, period) + LANES


@part(nogil=True, error_model="numpy")
def periodicity_workspace(samples, period, first, last):
    """Return the workspace for a chunk, a nominal period and the lags first ... last, all samples."""
    lags = last - first + 1
    x = line_aligned((_rows_before(last, period) + samples + LANES + _MANY) * LANES)
    return Workspace(x, np.zeros(LANES), line_aligned((lags + _MANY) * LANES), line_aligned(lags * LANES))


@part(**LEAN)
def _take_before(cells, n, last, less, x, place):
    """Write the last + 1 samples before a chunk to x, up to row `place`; return the sums over n of them."""
    before, end = cells.before, cells.before.shape[1]
    for back in range(n + LANES, last + 1 + LANES, LANES):
        at = max(end - back, 0)
        columns(before, cells.first * end + at, end, cells.number, less, x, (place - end + at) * LANES)
    return take_window(before, cells, end - n, n, less, x, place - n)


@part(**LEAN)
def _products(x, begin, n, lag, lags, products):
    """Write to products[i] the sum of x[t] x[t - lag + i] over the n samples from `begin` on, for i below `lags`."""
    now, past, first = begin * LANES, (begin - lag) * LANES, 0
    while lags - first > _FEW:
        _many_products(x, now, past + first * LANES, n, products, first * LANES)
        first += _MANY
    if first < lags:
        _few_products(x, now, past + first * LANES, n, products, first * LANES)


@part(**LEAN)
def _add_coefficient(products, at, mean, variation, total, square, floor, one_nth, r):
    """Add Pearson's coefficient from sums over n samples to r; NaN where a window is constant."""
    variation_b = square - total * total * one_nth
    varies = (variation_b > square * CONSTANT) & (variation_b > floor)
    coefficient = (load(products, at) - total * mean) / root(variation_b * variation)
    store(r, at, load(r, at) + choose(varies, coefficient, np.nan))


@part(**LEAN)
def _correlations(cells, less, windows, n, first, last, workspace):
    """Write the correlations at lags last ... first to r; return the sums of x and of x squared over all windows.

    They are averages over the windows of n samples; NaN where a window is constant. At a lag of n the earlier window is
    the one before, whose sums are known; at the other lags they are updated sample by sample.
    """
    x, _, products, r = workspace
    start = _rows_before(last, n)
    r[:] = 0.0
    one_nth = 1.0 / n
    sum_total, sum_square = spread(0.0), spread(0.0)
    earlier, earlier_square = _take_before(cells, n, last, less, x, start)
    for w in range(windows):
        begin = start + w * n
        total, square = take_window(cells.bridge_force, cells, w * n, n, less, x, begin)
        variation = square - total * total * one_nth
        variation = choose(variation > square * CONSTANT, variation, np.nan)
        mean, floor = total * one_nth, earlier_square * CONSTANT
        _products(x, begin, n, last, last - first + 1, products)
        up, up_square = earlier, earlier_square
        for lag in range(n, last + 1):
            _add_coefficient(products, (last - lag) * LANES, mean, variation, up, up_square, floor, one_nth, r)
            at = (begin - lag - 1) * LANES
            enters, leaves = load(x, at), load(x, at + n * LANES)
            up, up_square = up + (enters - leaves), up_square + (enters - leaves) * (enters + leaves)
        for lag in range(n - 1, first - 1, -1):
            at = (begin - lag - 1) * LANES
            enters, leaves = load(x, at + n * LANES), load(x, at)
            earlier, earlier_square = (
                earlier + (enters - leaves),
                earlier_square + (enters - leaves) * (enters + leaves),
            )
            _add_coefficient(
                products, (last - lag) * LANES, mean, variation, earlier, earlier_square, floor, one_nth, r
            )
        earlier, earlier_square = total, square
        sum_total, sum_square = sum_total + total, sum_square + square
    for i in range(0, r.shape[0], LANES):
        store(r, i, load(r, i) / windows)
    return sum_total, sum_square


@part(**LEAN)
def _best_maximum(r):
    """Return height and place of the largest interior maximum of r; NaN where there is none."""
    height, place = spread(-np.inf), spread(np.nan)
    above = load(r, r.shape[0] - LANES)
    falls = mask_of(np.uint8(0))  # r falls after this place, perhaps after equal values: a flat top is a maximum too
    for i in range(r.shape[0] // LANES - 2, 0, -1):
        here, below = load(r, i * LANES), load(r, (i - 1) * LANES)
        falls = (above < here) | ((above <= here) & (above >= here) & falls)
        slope = (above - below) * 0.5
        bend = here * 2.0 - above - below
        top = here + slope * slope * 0.5 / bend
        better = (below < here) & falls & (top >= height)  # of equal ones the first in r
        height, place = choose(better, top, height), choose(better, slope / bend + np.float64(i), place)
        above = here
    height = choose(height > -np.inf, height, np.nan)
    return choose(height > 1.0, spread(1.0), height), place  # a parabola may rise above what a correlation can be


@part(**LEAN)
def correlate_eight(cells, period, first, last, workspace, result):
    """Write the result of the first test for eight cells to `result`.

    Parameters
    ----------
    cells : EightCells
        The chunk is whole periods; before it are more than `last` samples (0 before t = 0: windows that are constant
        have no correlation).
    period : int
        Nominal period, samples: the length of each correlated window.
    first, last : int
        Lags searched, samples, both included; the nominal period lies between them.
    workspace : Workspace
    result : EightMaxima
        Changed in place.
    """
    level, samples = workspace.level, cells.bridge_force.shape[1]
    for lane in range(LANES):
        i = cells.first + min(lane, cells.number - 1)
        level[lane] = np.float64(cells.bridge_force[i, 0])  # near the mean: the sums then cancel less
    total, square = _correlations(cells, load(level, 0), samples // period, period, first, last, workspace)
    best, place = _best_maximum(workspace.correlations)
    store(result.height, 0, best)
    store(result.lag, 0, -place + np.float64(last))
    variance = (square - total * total / samples) / samples
    store(result.deviation, 0, root(choose(variance > 0.0, variance, 0.0)))
