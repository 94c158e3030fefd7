"""The third test: travelling Raman corners in the bridge force (section III.B, PHYSICS.md section 7).

The bridge force x is averaged over one period of the Schelleng ripples, bow-bridge-bow, and differentiated; together
y[t] = x[t] - x[t - d], d the ripple period: a corner that passes raises a pulse of width d and about height v_b/beta.
A corner is the onset of `|y|` above the threshold, either sign, armed again when y falls below it or changes sign.
All in float32, as the stream is: eight samples at a time.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_classifier.features.slips import NEIGHBOURS
from bow_classifier.verdict.fingerprint import LEAN, VERSION
from bow_sim.simd import lanes
from bow_sim.simd.jit import njit
from bow_sim.simd.lanes import LANES, choose

load: Any = lanes.load  # intrinsics are called without the first argument that their types ask for
spread: Any = lanes.spread
store: Any = lanes.store
bits_of: Any = lanes.bits_of
lowest_bit: Any = lanes.lowest_bit

FACTORS = np.concatenate([[1.0], NEIGHBOURS])
"""Of the threshold, under which corners are counted: a lane for each."""

_WORD = 64
"""Samples that are looked through together: a bit of a word for each."""


class Corners(NamedTuple):
    """What the third test says of the cells of a block.

    Attributes
    ----------
    number
        (cells,) uint16: corners in the window.
    sure
        (cells,) float64, 0 ... 1: share of neighbouring thresholds (`NEIGHBOURS` times the threshold) under which the
        count is the same.
    clusters
        (cells,) uint16: corners that begin a cluster: that come long after the one before in the window.
    """

    number: NDArray[np.uint16]
    sure: NDArray[np.float64]
    clusters: NDArray[np.uint16]


@njit(**LEAN)
def _starts(row, at, delay, lowest, highest):
    """Return, as bits, at which of eight samples y may begin to exceed a level between the two."""
    now = load(row, at) - load(row, at - delay)
    before = load(row, at - 1) - load(row, at - 1 - delay)
    return bits_of(((now > lowest) & (before <= highest)) | ((now < -lowest) & (before >= -highest)))


@njit(**LEAN)
def _candidates(row, begin, end, delay, lowest, highest):
    """Return the same of the samples from `begin` on, as many as a word has bits, or up to the end."""
    found = np.uint64(0)
    if begin + _WORD <= end:
        for k in range(0, _WORD, LANES):
            found |= np.uint64(_starts(row, begin + k, delay, lowest, highest)) << np.uint64(k)
        return found
    for group in range(begin, end, LANES):
        at = min(group, end - LANES)  # the last group goes back over samples that are already there
        found |= np.uint64(_starts(row, at, delay, lowest, highest) >> (group - at)) << np.uint64(group - begin)
    return found


@njit(**LEAN)
def count_corners(row, start, delay, level, gap, levels, tally):
    """Return number, clusters and sureness of the corners of one cell; `levels` and `tally` are room for eight lanes.

    Armed means no more than that the sample before was not above the level with the same sign: y is all the state.
    """
    end = row.shape[0]
    for k in range(LANES):
        levels[k] = FACTORS[k] * level if k < FACTORS.shape[0] else np.inf
    lowest, highest = levels[0], levels[0]
    for k in range(1, FACTORS.shape[0]):
        lowest, highest = min(lowest, levels[k]), max(highest, levels[k])
    high = load(levels, 0)
    count, one = spread(np.float32(0.0)), spread(np.float32(1.0))
    near = int(gap)  # samples are whole: none lies between this and the gap
    latest, apart = -end, 0
    for begin in range(start, end, _WORD):
        candidates = _candidates(row, begin, end, delay, lowest, highest)
        while candidates:
            t = begin + lowest_bit(candidates)
            candidates &= candidates - np.uint64(1)
            now, before = row[t] - row[t - delay], row[t - 1] - row[t - 1 - delay]
            onset = ((high < now) & (high >= before)) | ((high < -now) & (high >= -before))
            count = count + choose(onset, one, 0.0)
            counts = bits_of(onset) & 1
            apart += counts & int(t - latest > near)
            latest = t if counts else latest
    store(tally, 0, count)
    same = 0
    for k in range(1, FACTORS.shape[0]):
        same += int(tally[k] == tally[0])
    return int(tally[0]), apart, same / (FACTORS.shape[0] - 1)


def build(version: int) -> Any:
    """Make the compiled test, to be cached as this version; see `bow_classifier.verdict.fingerprint`."""

    @njit(nogil=True, cache=True, error_model="numpy")
    def count(record, start, delay, level, gap, number, sure, clusters):
        levels, tally = np.empty(LANES, np.float32), np.empty(LANES, np.float32)
        for i in range(record.shape[0]):
            found = count_corners(record[i], start, delay[i], level[i], gap[i], levels, tally)
            number[i], clusters[i], sure[i] = found
        return version

    return count


_corners = build(VERSION)


def corners(
    record: NDArray[np.float32],
    start: int,
    delay: NDArray[np.int64],
    level: NDArray[np.float64],
    gap: NDArray[np.float64] | None = None,
) -> Corners:
    """Return how many corners pass in the window, for every cell.

    Parameters
    ----------
    record
        (cells, start + samples) bridge force; the window is ``record[:, start:]``, what precedes it came before
        (0 before t = 0). The window has at least 8 samples.
    start
        Samples before the window, more than the longest delay: the sample before the window tells what is no onset.
    delay
        (cells,) ripple period in samples: round trip bow-bridge-bow.
    level
        (cells,) threshold of `|y|`, in units of the bridge force.
    gap
        (cells,) samples: two corners further apart than this belong to different clusters; 0 unless given.

    Raises
    ------
    ValueError
        Where the record does not reach far enough back, or the window is too short.
    """
    cells = record.shape[0]
    least, most = (int(delay.min()), int(delay.max())) if cells else (1, 1)
    if not 0 < least <= most < start <= record.shape[1] - LANES:
        raise ValueError(
            f"record {record.shape}, window from {start}, delays {least} ... {most}: delays should be above 0, and the "
            f"window should hold at least {LANES} samples and have more than {most} before it"
        )
    result = Corners(np.empty(cells, np.uint16), np.empty(cells), np.empty(cells, np.uint16))
    gap = np.zeros(cells) if gap is None else gap
    _corners(np.ascontiguousarray(record), start, delay, level, gap, *result)
    return result
