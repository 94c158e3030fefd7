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
from bow_sim.simd import bits, columns, lanes
from bow_sim.simd.bits import BYTES, MANY
from bow_sim.simd.jit import part
from bow_sim.simd.lanes import LANES, absolute

load: Any = lanes.load  # for the type checker: intrinsics are called without their first argument
bits_of: Any = lanes.bits_of
lowest_bit: Any = lanes.lowest_bit
bit_count: Any = bits.bit_count
nonzero: Any = bits.nonzero
onsets: Any = bits.onsets
flipped: Any = columns.flipped

_NONE = np.uint64(1 << LANES)


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
    levels
        (factors,) float32: the thresholds.
    tally
        (factors,) int64: how many corners exceed each of them.
    found
        (samples / 8, rounded up to `BYTES`,) uint8: where a corner may be, as bits, the lowest first.
    """

    levels: Any
    tally: Any
    found: Any


@part(nogil=True, error_model="numpy")
def corner_workspace(samples):
    """Return the workspace for windows of `samples`."""
    factors = FACTORS.shape[0]
    found = np.zeros(-(-samples // (LANES * BYTES)) * BYTES, np.uint8)
    return Workspace(np.empty(factors, np.float32), np.empty(factors, np.int64), found)


@part(**LEAN)
def _steps(row, at, delay):
    """Return the magnitude of y at eight samples, and y of the samples before, negative if the sign is another."""
    now = load(row, at) - load(row, at - delay)
    before = load(row, at - 1) - load(row, at - 1 - delay)
    return absolute(now), flipped(before, now)


@part(**LEAN)
def _candidates(row, start, delay, lowest, highest, found):
    """Write to `found` where y may begin to exceed a level between the two, for all samples from `start` on."""
    end, place = row.shape[0], 0
    whole = start + (end - start) // MANY * MANY
    for at in range(start, whole, MANY):
        many = onsets(row, at, delay, lowest, highest)
        found[place], found[place + 1] = np.uint8(many & 255), np.uint8(many >> 8)
        place += MANY // LANES
    for at in range(whole, end, LANES):
        first = min(at, end - LANES)  # the last group overlaps the one before
        size, before = _steps(row, first, delay)
        found[place] = bits_of((size > lowest) & (before <= highest)) >> (at - first)
        place += 1


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
    levels, tally, found = workspace
    end = row.shape[0]
    for k in range(FACTORS.shape[0]):
        levels[k], tally[k] = FACTORS[k] * level, 0
    lowest, highest = levels[0], levels[0]
    for k in range(1, FACTORS.shape[0]):
        lowest, highest = min(lowest, levels[k]), max(highest, levels[k])
    near = int(gap)  # samples are whole numbers: none lies between this and the gap
    latest, clusters = -end, 0
    _candidates(row, start, delay, lowest, highest, found)
    for word in range(found.shape[0] // BYTES):
        groups = nonzero(found, word * BYTES)
        while groups:
            at = start + LANES * (word * BYTES + lowest_bit(groups))
            groups &= groups - np.uint64(1)
            place = min(at, end - LANES)
            size, before = _steps(row, place, delay)
            for k in range(1, FACTORS.shape[0]):
                tally[k] += bit_count(_onsets(size, before, levels[k], at - place))
            first = _onsets(size, before, levels[0], at - place)
            tally[0] += bit_count(first)
            some, t = first != 0, at + lowest_bit(np.uint64(first) | _NONE)
            clusters += int(some & (t - latest > near))
            latest = t if some else latest
            first &= first - np.uint8(1)
            while first:
                t = at + lowest_bit(np.uint64(first))
                clusters += int(t - latest > near)
                latest = t
                first &= first - np.uint8(1)
    return Corners(int(tally[0]), clusters, sureness(tally))


@part(**LEAN)
def _onsets(size, before, level, skipped):
    """Return, as bits, at which of eight samples y begins to exceed a level, but for the first `skipped` of them."""
    return np.uint8(bits_of((size > level) & (before <= level)) >> skipped)
