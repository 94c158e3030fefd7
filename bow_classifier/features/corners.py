"""The third test: travelling Raman corners in the bridge force (section III.B, PHYSICS.md section 7).

The bridge force x is averaged over one period of the Schelleng ripples, bow-bridge-bow, and differentiated; together
this is y[t] = x[t] - x[t - d], d the ripple period: a passing corner makes a pulse of width d and height of about
v_b/beta. A corner is counted where y rises above the threshold, or falls below minus the threshold; only the previous
sample is needed to see that. All in float32, as in the stream, eight samples at a time.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from bow_classifier.features.slips import FACTORS, sureness
from bow_classifier.verdict.fingerprint import LEAN
from bow_sim.simd import columns, lanes
from bow_sim.simd.jit import part
from bow_sim.simd.lanes import LANES, absolute, choose

load: Any = lanes.load  # for the type checker: intrinsics are called without their first argument
spread: Any = lanes.spread
store: Any = lanes.store
read: Any = lanes.read
bits_of: Any = lanes.bits_of
lowest_bit: Any = lanes.lowest_bit
flipped: Any = columns.flipped

_BITS = 64
"""Samples whose candidates for a corner are the bits of one number."""


class Corners(NamedTuple):
    """The result of the third test for one cell.

    Attributes
    ----------
    number
        Corners in the window.
    clusters
        Corners that begin a cluster: those long after the one before in the window.
    sure
        0 ... 1: share of the other `FACTORS` of the threshold that give the same number.
    """

    number: int
    clusters: int
    sure: float


class Workspace(NamedTuple):
    """The arrays that `count_corners` works in.

    Attributes
    ----------
    levels, tally
        (8,) float32: the thresholds, and how many corners exceed each of them.
    found
        (samples / 8, rounded up to words,) uint8: where a corner may be, as bits, the lowest first.
    words
        The same memory as uint64, on all machines that Numba compiles for: their lowest byte is the first.
    """

    levels: Any
    tally: Any
    found: Any
    words: Any


@part(nogil=True, error_model="numpy")
def corner_workspace(samples):
    """Return the workspace for windows of `samples`."""
    words = np.zeros(-(-samples // _BITS), np.uint64)
    return Workspace(np.empty(LANES, np.float32), np.empty(LANES, np.float32), words.view(np.uint8), words)


@part(**LEAN)
def _starts(row, at, delay, lowest, highest):
    """Return, as bits, at which of eight samples y may begin to exceed a level between the two."""
    now = load(row, at) - load(row, at - delay)
    before = load(row, at - 1) - load(row, at - 1 - delay)
    return bits_of((absolute(now) > lowest) & (flipped(before, now) <= highest))


@part(**LEAN)
def _candidates(row, start, delay, lowest, highest, found):
    """Write the same for all samples from `start` on to `found`, a byte for eight of them."""
    end, place = row.shape[0], 0
    for at in range(start, end - LANES + 1, LANES):
        found[place] = _starts(row, at, delay, lowest, highest)
        place += 1
    over = (end - start) % LANES
    if over:  # the last group overlaps the one before
        found[place] = _starts(row, end - LANES, delay, lowest, highest) >> (LANES - over)


@part(**LEAN)
def count_corners(row, start, delay, level, gap, workspace):
    """Return the `Corners` of one cell.

    Parameters
    ----------
    row : ndarray of float32, shape (start + samples,)
        Bridge force; the window, 8 samples or more, begins at `start`.
    start : int
        Samples before the window, more than `delay`.
    delay : int
        Ripple period, samples: round trip bow-bridge-bow.
    level : float
        Threshold of the magnitude of y, units of the bridge force; not negative.
    gap : float
        Samples; two corners further apart belong to different clusters.
    workspace : Workspace
    """
    levels, tally, found, words = workspace
    end = row.shape[0]
    for k in range(LANES):
        levels[k] = FACTORS[k] * level if k < FACTORS.shape[0] else np.inf
    lowest, highest = levels[0], levels[0]
    for k in range(1, FACTORS.shape[0]):
        lowest, highest = min(lowest, levels[k]), max(highest, levels[k])
    high = load(levels, 0)
    count, one = spread(np.float32(0.0)), spread(np.float32(1.0))
    near = int(gap)  # samples are whole numbers: none lies between this and the gap
    latest, clusters = -end, 0
    _candidates(row, start, delay, lowest, highest, found)
    begin = start
    for word in words:
        candidates = word
        while candidates:
            t = begin + lowest_bit(candidates)
            candidates &= candidates - np.uint64(1)
            now = read(row, t, lowest) - read(row, t - delay, lowest)
            before = read(row, t - 1, lowest) - read(row, t - 1 - delay, lowest)
            if_up = -before if now < 0.0 else before
            onset = (high < abs(now)) & (high >= if_up)
            count = count + choose(onset, one, 0.0)
            counts = bits_of(onset) & 1
            clusters += counts & int(t - latest > near)
            latest = t if counts else latest
        begin += _BITS
    store(tally, 0, count)
    return Corners(int(tally[0]), clusters, sureness(tally))
