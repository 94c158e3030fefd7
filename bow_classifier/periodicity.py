"""The first test: is the bridge force periodic, and with which period (section III.B, PHYSICS.md section 7).

For each integer lag around the nominal period, the Pearson correlation of each of the last five periods with the same
window one lag earlier, averaged over the five; then the quadratic through three neighbouring lags at each interior
local maximum. The largest counts; its place is the period.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bow_sim import simd
from bow_sim.simd import LANES, choose, root

from .sources import VERSION

load: Any = simd.load  # intrinsics are called without the first argument that their types ask for
spread: Any = simd.spread
store: Any = simd.store

_CONSTANT = 1e-13
"""A window whose variation is this part of its sum of squares is constant: rounding in float64 leaves less."""


class Periodicity(NamedTuple):
    """What the first test says of the cells of a block.

    Attributes
    ----------
    correlation
        (cells,) float32, -1 ... 1: the largest interior maximum; NaN where there is none.
    period
        (cells,) float32, samples: its place; NaN where there is none.
    deviation
        (cells,) float64, units of the bridge force: r.m.s. deviation from the mean over the whole window.
    """

    correlation: NDArray[np.float32]
    period: NDArray[np.float32]
    deviation: NDArray[np.float64]


@njit(nogil=True, error_model="numpy")
def _moments(x, begin, n, eight):
    """Return the sums of x and of x squared over n samples; `eight` is room for eight lanes."""
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


@njit(nogil=True, error_model="numpy")
def _products(x, begin, n, lag, products):
    """Write to products[i] the sum of x[t] x[t - lag + i] over the n samples from `begin` on; eight i at a time.

    The samples are counted from 0: of indices that cannot be negative Numba need not find out whether they are, which
    took half of the time.
    """
    y = x[begin : begin + n]
    for i in range(0, products.shape[0], LANES):
        earlier = begin + i - lag
        a = b = c = d = spread(0.0)  # four sums at once: one alone would wait for each addition
        for t in range(0, n - 3, 4):
            a = a + y[t] * load(x, t + earlier)
            b = b + y[t + 1] * load(x, t + 1 + earlier)
            c = c + y[t + 2] * load(x, t + 2 + earlier)
            d = d + y[t + 3] * load(x, t + 3 + earlier)
        for t in range(n // 4 * 4, n):
            a = a + y[t] * load(x, t + earlier)
        store(products, i, (a + c) + (b + d))


@njit(nogil=True, error_model="numpy")
def _slide(x, begin, n, first, last, total, square, totals, squares):
    """Write the sums of the n samples from `begin` - lag on to totals[last - lag], those of squares to squares.

    `total` and `square` are those of lag n; at other lags they follow sample by sample.
    """
    up, up_square = total, square
    for lag in range(n, last + 1):
        totals[last - lag], squares[last - lag] = up, up_square
        enters, leaves = x[begin - lag - 1], x[begin - lag - 1 + n]
        up += enters - leaves
        up_square += (enters - leaves) * (enters + leaves)
    for lag in range(n - 1, first - 1, -1):
        enters, leaves = x[begin - lag - 1 + n], x[begin - lag - 1]
        total += enters - leaves
        square += (enters - leaves) * (enters + leaves)
        totals[last - lag], squares[last - lag] = total, square


@njit(nogil=True, error_model="numpy")
def _add_coefficients(products, mean, variation, totals, squares, floor, one_nth, r):
    """Add Pearson coefficients from sums over n samples to r, eight lags at a time; NaN where a window is constant."""
    for i in range(0, r.shape[0], LANES):
        total, square = load(totals, i), load(squares, i)
        variation_b = square - total * total * one_nth
        varies = (variation_b > square * _CONSTANT) & (variation_b > spread(floor * _CONSTANT))
        coefficient = (load(products, i) - total * mean) / root(variation_b * variation)
        store(r, i, load(r, i) + choose(varies, coefficient, np.nan))


@njit(nogil=True, error_model="numpy")
def _correlations(x, start, windows, n, first, last, sums, r):
    """Write the correlations at lags last ... first to r; return the sums of x and of x squared over all windows.

    They are averages over the windows of n samples; NaN where a window is constant. The window one period earlier is
    the window before, whose sums are known.
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
        if not variation > _CONSTANT * square:
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


@njit(nogil=True, error_model="numpy")
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


def build(version: int) -> Any:
    """Make the compiled test, to be cached as this version; see `bow_classifier.sources`."""

    @njit(nogil=True, cache=True, error_model="numpy")
    def test(record, start, period, first, last, correlation, place, deviation):
        samples = record.shape[1] - start
        before = last + 1  # the sums slide one sample beyond the last lag
        lags = last - first + 1
        width = -(-lags // LANES) * LANES
        r = np.empty(width)
        sums = np.zeros(width), np.zeros(width), np.zeros(width)
        x = np.zeros(before + samples + width)
        for i in range(record.shape[0]):
            level = np.float64(record[i, start])  # near the mean: the sums then cancel less
            row = record[i, start - before :]
            for t in range(row.shape[0]):
                x[t] = np.float64(row[t]) - level
            total, square = _correlations(x, before, samples // period, period, first, last, sums, r)
            height, at = _best_maximum(r[:lags])
            correlation[i] = height
            place[i] = last - at
            deviation[i] = np.sqrt(max(0.0, square - total * total / samples) / samples)
        return version

    return test


_periodicity = build(VERSION)


def periodicity(record: NDArray[np.float32], start: int, period: int, lags: tuple[int, int]) -> Periodicity:
    """Return correlation, period and loudness of every cell over the last five periods.

    Parameters
    ----------
    record
        (cells, start + 5 * period) bridge force; the window is ``record[:, start:]``, what precedes it came before
        (0 before t = 0: windows that are constant have no correlation, so the first five periods seldom have one).
    start
        Samples before the window, more than the longest lag.
    period
        Nominal period in samples: length of each correlated window.
    lags
        First and last lag, samples, both included; the nominal period lies between them.

    Raises
    ------
    ValueError
        Where the record is too short, or the lags do not enclose the period.
    """
    first, last = lags
    samples = record.shape[1] - start
    if not 0 < first < period < last < start or samples <= 0 or samples % period:
        raise ValueError(
            f"record {record.shape} with the window from {start}: lags {first} ... {last} should enclose the period "
            f"{period}, the window should hold whole periods, and more than {last} samples should precede it"
        )
    cells = record.shape[0]
    result = Periodicity(np.empty(cells, np.float32), np.empty(cells, np.float32), np.empty(cells))
    _periodicity(record, start, period, first, last, *result)
    return result
