"""The third test: travelling Raman corners in the bridge force (section III.B, PHYSICS.md section 7).

The bridge force x is averaged over one period of the Schelleng ripples, bow-bridge-bow, and differentiated; together
this is y[t] = x[t] - x[t - d], d the ripple period: a passing corner makes a pulse of width d and height of about
v_b/beta. A corner is counted where y rises above the threshold, or falls below minus the threshold; only the previous
sample is needed to see that. All in float32, as in the stream.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from bow_classifier.features.slips import FACTORS, sureness
from bow_classifier.verdict.fingerprint import LEAN
from bow_sim.simd import bits, columns, lanes
from bow_sim.simd.bits import BYTES, MANY
from bow_sim.simd.jit import part
from bow_sim.simd.lanes import LANES, absolute, choose

load: Any = lanes.load  # for the type checker: intrinsics are called without their first argument
bits_of: Any = lanes.bits_of
count_of: Any = bits.count_of
lowest_bit: Any = lanes.lowest_bit
find_onsets: Any = bits.find_onsets
mask_of: Any = lanes.mask_of
nonzero: Any = bits.nonzero
spread: Any = lanes.spread
flipped: Any = columns.flipped

_NONE = np.uint64(1 << LANES)
"""A bit beyond those of eight lanes: without another, it is the lowest."""

_ALL = 2**LANES - 1
"""The bits of all lanes."""


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
    found
        (samples / 8, rounded up to `BYTES`,) uint8: where a corner may be, as bits, the lowest first.
    """

    levels: Any
    found: Any


@part(nogil=True, error_model="numpy")
def corner_workspace(samples):
    """Return the workspace for windows of `samples`."""
    return Workspace(
        np.empty(FACTORS.shape[0], np.float32),
        np.zeros(-(-samples // (LANES * BYTES)) * BYTES, np.uint8),
    )


@part(**LEAN)
def _steps(row, at, delay):
    """Return the magnitude of y at eight samples, and y of the samples before, negative if the sign is another."""
    now = load(row, at) - load(row, at - delay)
    before = load(row, at - 1) - load(row, at - 1 - delay)
    return absolute(now), flipped(before, now)


@part(**LEAN)
def _candidates(row, start, delay, lowest, highest, found):
    """Write to `found` where y may begin to exceed a level between the two, for all samples from `start` on."""
    end = row.shape[0]
    count = (end - start) // MANY * MANY
    find_onsets(row, start, count, delay, lowest, highest, found)
    for at in range(start + count, end, LANES):
        first = min(at, end - LANES)  # the last group overlaps the one before
        size, before = _steps(row, first, delay)
        found[(at - start) // LANES] = bits_of((size > lowest) & (before <= highest)) >> (at - first)


@part(**LEAN)
def _onsets(size, before, level):
    """Return in which lanes y begins to exceed a level."""
    return (size > level) & (before <= level)


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
    levels, found = workspace
    end = row.shape[0]
    for k in range(FACTORS.shape[0]):
        levels[k] = FACTORS[k] * level
    lowest, highest = levels[0], levels[0]
    for k in range(1, FACTORS.shape[0]):
        lowest, highest = min(lowest, levels[k]), max(highest, levels[k])
    one, zero = spread(np.float32(1.0)), spread(np.float32(0.0))
    a = b = c = d = e = zero  # corners that exceed each of the levels
    near = int(gap)  # samples are whole numbers: none lies between this and the gap
    latest, clusters = -end, 0
    _candidates(row, start, delay, lowest, highest, found)
    for word in range(0, found.shape[0], BYTES):
        groups = nonzero(found, word)
        while groups:  # no branches within, but for two corners in a group: they would often be predicted wrongly
            at = start + LANES * (word + lowest_bit(groups))
            groups &= groups - np.uint64(1)
            place = min(at, end - LANES)
            size, before = _steps(row, place, delay)
            size = choose(mask_of(np.uint8(_ALL << (at - place))), size, 0.0)
            onset = _onsets(size, before, levels[0])
            a = a + choose(onset, one, 0.0)
            b = b + choose(_onsets(size, before, levels[1]), one, 0.0)
            c = c + choose(_onsets(size, before, levels[2]), one, 0.0)
            d = d + choose(_onsets(size, before, levels[3]), one, 0.0)
            e = e + choose(_onsets(size, before, levels[4]), one, 0.0)
            bits = np.uint64(bits_of(onset))
            t = place + lowest_bit(bits | _NONE)
            clusters += int((bits != 0) & (t - latest > near))
            latest = t if bits else latest
            bits &= bits - np.uint64(1)
            while bits:
                t = place + lowest_bit(bits)
                clusters += int(t - latest > near)
                latest = t
                bits &= bits - np.uint64(1)
    tally = (count_of(a), count_of(b), count_of(c), count_of(d), count_of(e))
    return Corners(int(tally[0]), clusters, sureness(tally))
