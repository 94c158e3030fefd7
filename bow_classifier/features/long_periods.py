"""Long periods: motion that repeats only after two or three nominal periods, or at an anomalous low frequency.

The first test searches for a period near the nominal one (:mod:`bow_classifier.features.periodicity`). Where it finds
none, lags up to three nominal periods are searched here: first a coarse search in averages of eight samples, which
costs little, then a fine one in the samples, around the shortest lag whose coarse maximum is as high as any.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from bow_classifier.features.periodicity import CONSTANT
from bow_classifier.verdict.fingerprint import LEAN
from bow_sim.simd import columns, lanes
from bow_sim.simd.jit import part
from bow_sim.simd.lanes import LANES, choose, root

load: Any = lanes.load  # for the type checker: intrinsics are called without their first argument
spread: Any = lanes.spread
store: Any = lanes.store
read: Any = lanes.read
write: Any = lanes.write
four_twice: Any = columns.four_twice
sums_of_eight: Any = columns.sums_of_eight
transposed_halves: Any = columns.transposed_halves

COARSE = 8
"""Samples averaged for the coarse search: it costs a sixty-fourth, and the fine search corrects its errors."""

BESIDE = 10
"""Lags of the fine search on either side of a coarse maximum, which is right within `COARSE`."""

SLACK = 0.08
"""A coarse maximum may lie this far below the threshold and still be searched finely."""

SHORTER = 0.1
"""A coarse maximum at a shorter lag may lie this far below the highest one and still be searched finely."""

EQUAL = 0.02
"""A shorter lag is preferred to the best one if its correlation is less by no more than this."""


class Sums(NamedTuple):
    """Sums over one window at each lag, from the last lag to the first; arrays are (lags,) float64 or longer.

    Attributes
    ----------
    products
        Of the samples and those a lag earlier.
    totals, squares
        Of the samples a lag earlier, and of their squares.
    """

    products: Any
    totals: Any
    squares: Any


class Workspace(NamedTuple):
    """The arrays that `search_row` works in, float64.

    Attributes
    ----------
    averages
        Bridge force, averages of `COARSE` samples.
    coarse_sums, coarse
        `Sums` and correlations of the coarse search.
    x
        Bridge force around the window.
    fine_sums, fine
        `Sums` and correlations of the fine search.
    """

    averages: Any
    coarse_sums: Any
    coarse: Any
    x: Any
    fine_sums: Any
    fine: Any


@part(**LEAN)
def _moments(x, begin, n, eight):
    """Return the sums of x and of x squared over n samples; `eight` is workspace, (8,)."""
    s, q = spread(0.0), spread(0.0)
    whole = begin + n // LANES * LANES
    for t in range(begin, whole, LANES):
        y = load(x, t)
        s, q = s + y, q + y * y
    store(eight, 0, s)
    total = ((eight[0] + eight[4]) + (eight[2] + eight[6])) + ((eight[1] + eight[5]) + (eight[3] + eight[7]))
    store(eight, 0, q)
    square = ((eight[0] + eight[4]) + (eight[2] + eight[6])) + ((eight[1] + eight[5]) + (eight[3] + eight[7]))
    for t in range(whole, begin + n):
        total += x[t]
        square += x[t] * x[t]
    return total, square


@part(**LEAN)
def _products(x, begin, n, lag, products):
    """Write to products[i] the sum of x[t] x[t - lag + i] over the n samples from `begin` on; eight i at a time.

    Each is the sum of four, of every fourth sample: one alone would wait for each addition. Four samples are multiplied
    at once with those at eight lags.

    Samples are read by `read`, here and below: for each index in brackets Numba tests whether it is negative.
    """
    for i in range(0, products.shape[0], LANES):
        earlier = i - lag
        p = q = r = s = spread(0.0)  # the four sums for lags i and i + 4, i + 1 and i + 5 ...
        for t in range(begin, begin + n - 3, 4):
            now = four_twice(x, t)
            p = p + now * load(x, t + earlier)
            q = q + now * load(x, t + earlier + 1)
            r = r + now * load(x, t + earlier + 2)
            s = s + now * load(x, t + earlier + 3)
        a, b, c, d = transposed_halves(p, q, r, s)
        for t in range(begin + n // 4 * 4, begin + n):
            a = a + read(x, t, 0.0) * load(x, t + earlier)
        store(products, i, (a + c) + (b + d))


@part(**LEAN)
def _slide(x, begin, n, first, last, total, square, totals, squares):
    """Write the sums of the n samples from `begin` - lag on to totals[last - lag], those of squares to squares.

    `total` and `square` are those at lag n; the others are updated sample by sample.
    """
    up, up_square = total, square
    for lag in range(n, last + 1):
        write(totals, last - lag, up)
        write(squares, last - lag, up_square)
        enters, leaves = read(x, begin - lag - 1, 0.0), read(x, begin - lag - 1 + n, 0.0)
        up += enters - leaves
        up_square += (enters - leaves) * (enters + leaves)
    for lag in range(n - 1, first - 1, -1):
        enters, leaves = read(x, begin - lag - 1 + n, 0.0), read(x, begin - lag - 1, 0.0)
        total += enters - leaves
        square += (enters - leaves) * (enters + leaves)
        write(totals, last - lag, total)
        write(squares, last - lag, square)


@part(**LEAN)
def _add_coefficients(products, mean, variation, totals, squares, floor, one_nth, r):
    """Add Pearson coefficients from sums over n samples to r, eight lags at a time; NaN where a window is constant."""
    for i in range(0, r.shape[0], LANES):
        total, square = load(totals, i), load(squares, i)
        variation_b = square - total * total * one_nth
        varies = (variation_b > square * CONSTANT) & (variation_b > spread(floor * CONSTANT))
        coefficient = (load(products, i) - total * mean) / root(variation_b * variation)
        store(r, i, load(r, i) + choose(varies, coefficient, np.nan))


@part(**LEAN)
def _correlations(x, start, windows, n, first, last, sums, r):
    """Write the correlations at lags last ... first to r; return the sums of x and of x squared over all windows.

    They are averages over the windows of n samples; NaN where a window is constant. At a lag of n the earlier window is
    the one before, whose sums are known.
    """
    products, totals, squares = sums
    r[:] = 0.0
    one_nth = 1.0 / n  # divisions would take a third of the time
    sum_total, sum_square = 0.0, 0.0
    earlier, earlier_square = _moments(x, start - n, n, products)
    for w in range(windows):
        begin = start + w * n
        total, square = _moments(x, begin, n, products)
        variation = square - total * total * one_nth
        if not variation > CONSTANT * square:
            variation = np.nan
        _products(x, begin, n, last, products)
        _slide(x, begin, n, first, last, earlier, earlier_square, totals, squares)
        _add_coefficients(products, total * one_nth, variation, totals, squares, earlier_square, one_nth, r)
        earlier, earlier_square = total, square
        sum_total += total
        sum_square += square
    for i in range(r.shape[0]):
        r[i] /= windows
    return sum_total, sum_square


@part(**LEAN)
def _best_maximum(r):
    """Return height and place of the largest interior maximum of r; NaN where there is none."""
    height, place = np.nan, np.nan
    for i in range(1, r.shape[0] - 1):
        j = i + 1
        while j < r.shape[0] and r[j] == r[i]:  # a flat top is a maximum if it falls on its far side
            j += 1
        if r[i - 1] < r[i] and j < r.shape[0] and r[j] < r[i]:
            slope = 0.5 * (r[i + 1] - r[i - 1])
            bend = 2.0 * r[i] - r[i + 1] - r[i - 1]
            top = r[i] + 0.5 * slope * slope / bend
            if not top <= height:
                height, place = top, i + slope / bend
    return min(height, 1.0), place  # a parabola may rise above what a correlation can be


@part(**LEAN)
def _averages(row, averages):
    """Write averages of `COARSE` samples each, the last one at the end of the record."""
    count = averages.shape[0]
    part = row[row.shape[0] - COARSE * count :]
    level = np.float64(row[row.shape[0] - 1])  # near the mean, so that less is lost by cancellation in the sums
    for k in range(0, count - LANES + 1, LANES):
        store(averages, k, sums_of_eight(part, COARSE * k, spread(level)) / COARSE)
    for k in range(count // LANES * LANES, count):
        total = 0.0
        for x in part[COARSE * k : COARSE * (k + 1)]:
            total += np.float64(x) - level
        averages[k] = total / COARSE


@part(**LEAN)
def _coarse(y, n, first, last, sums, r):
    """Write the correlations of the last n of y with those a lag earlier to r[last - lag], lags first ... last."""
    products, totals, squares = sums
    begin = y.shape[0] - r.shape[0] - n  # y has a margin at its end, as loads of eight read beyond the last lag
    _products(y, begin, n, last, products)
    total, square = 0.0, 0.0
    for t in range(begin, begin + n):
        now = read(y, t, 0.0)
        total += now
        square += now * now
    one_nth = 1.0 / n
    variation = square - total * total * one_nth
    if not variation > CONSTANT * square:
        variation = np.nan
    earlier, earlier_square = total, square
    for lag in range(1, last + 1):
        enters, leaves = read(y, begin - lag, 0.0), read(y, begin - lag + n, 0.0)
        earlier += enters - leaves
        earlier_square += (enters - leaves) * (enters + leaves)
        if lag >= first:
            write(totals, last - lag, earlier)
            write(squares, last - lag, earlier_square)
    r[:] = 0.0
    _add_coefficients(products, total * one_nth, variation, totals, squares, square, one_nth, r)


@part(**LEAN)
def _is_maximum(r, i):
    return r[i - 1] < r[i] >= r[i + 1]


@part(**LEAN)
def _within(lag, shortest, longest):
    """Return the middle, in samples, of the fine search around a lag of the coarse one."""
    return min(max(COARSE * lag, shortest), longest)


@part(**LEAN)
def _highest(r, count, least):
    """Return the place in r of the highest maximum above `least`, -1 for none."""
    found, best = -1, least
    for i in range(1, count - 1):
        if r[i] > best and _is_maximum(r, i):
            found, best = i, r[i]
    return found


@part(**LEAN)
def _fine(x, samples, period, middle, sums, f):
    """Return height and lag of the largest interior maximum within `BESIDE` of a lag; NaN for none."""
    before = x.shape[0] - samples - f.shape[0]
    _correlations(x, before, samples // period, period, middle - BESIDE, middle + BESIDE, sums, f)
    height, at = _best_maximum(f[: 2 * BESIDE + 1])
    return height, middle + BESIDE - at


@part(nogil=True, error_model="numpy")
def long_workspace(samples, period, shortest, longest):
    """Return the workspace for windows of `samples` and the lags shortest ... longest, both samples."""
    n, low, high = samples // COARSE, shortest // COARSE - 1, -(-longest // COARSE)
    wide = -(-(high - low + 1) // LANES) * LANES
    width = -(-(2 * BESIDE + 1) // LANES) * LANES
    before = longest + BESIDE + 1
    slide = max(width, before - period + 1)  # the sums are updated from one period to the longest lag
    return Workspace(
        np.zeros(n + high + 1 + wide),
        Sums(np.zeros(wide), np.zeros(wide), np.zeros(wide)),
        np.empty(wide),
        np.zeros(before + samples + width),
        Sums(np.zeros(width), np.zeros(slide), np.zeros(slide)),
        np.empty(width),
    )


@part(**LEAN)
def search_row(row, start, period, shortest, longest, least, workspace):
    """Return height and lag of the shortest of the best long lags of one cell; NaN where none is above `least`.

    The height is the correlation of the first test: the mean over the last five nominal periods, each with the same
    samples a lag earlier, at the interior maximum of the quadratic through three neighbouring lags.

    Parameters
    ----------
    row : ndarray of float32, shape (start + samples,)
        Bridge force; the window, whole periods, begins at `start`.
    start : int
        Samples before the window, `samples_before` of `longest` or more.
    period : int
        Nominal period, samples.
    shortest, longest : int
        Lags, samples; both are longer than the period.
    least : float
        Threshold of the correlation.
    workspace : Workspace
    """
    y, coarse, r, x, sums, f = workspace
    samples = row.shape[0] - start
    n, low, high = samples // COARSE, shortest // COARSE - 1, -(-longest // COARSE)
    lags, before = high - low + 1, longest + BESIDE + 1
    _averages(row, y[: n + high + 1])
    _coarse(y, n, low, high, coarse, r)
    best = _highest(r, lags, least - SLACK)
    if best < 0:
        return np.nan, np.nan
    level, part = np.float64(row[start]), row[start - before :]
    for t in range(part.shape[0]):
        x[t] = np.float64(part[t]) - level
    height, lag = _fine(x, samples, period, _within(high - best, shortest, longest), sums, f)
    for k in range(lags - 2, best, -1):  # motion that repeats after a lag repeats after its multiples, too
        if r[k] > r[best] - SHORTER and _is_maximum(r, k):
            other, at = _fine(x, samples, period, _within(high - k, shortest, longest), sums, f)
            if other > least and not other < height - EQUAL:
                height, lag = other, at
                break
    return (height, lag) if height > least else (np.nan, np.nan)


def samples_before(longest: int) -> int:
    """Return how many samples must precede the window for lags up to `longest` samples."""
    return -(-longest // COARSE) * COARSE + 2 * COARSE + BESIDE + 1
