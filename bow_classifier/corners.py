"""The third test: travelling Raman corners in the bridge force (section III.B, PHYSICS.md section 7).

The bridge force x is averaged over one period of the Schelleng ripples, bow-bridge-bow, and differentiated; together
y[t] = x[t] - x[t - d], d the ripple period: a corner that passes raises a pulse of width d and about height v_b/beta.
A corner is the onset of |y| above the threshold, either sign, armed again when y falls below it or changes sign.
All in float32, as the stream is: eight samples at a time.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bow_sim import simd
from bow_sim.simd import LANES, absolute

from .slips import NEIGHBOURS
from .sources import VERSION

load: Any = simd.load  # intrinsics are called without the first argument that their types ask for
bits_of: Any = simd.bits_of

_FACTORS = np.concatenate([[1.0], NEIGHBOURS])

_ONES = np.array([number.bit_count() for number in range(256)], np.uint8)
"""Bits set in a byte."""


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


@njit(nogil=True, error_model="numpy")
def _onsets(now, before, level):
    """Return, as a byte, where eight samples of y begin to exceed the level, with either sign.

    Armed means no more than that the sample before was not above the level with the same sign: y is all the state.
    """
    return bits_of(((now > level) & (before <= level)) | ((now < -level) & (before >= -level)))


def build(version: int) -> Any:
    """Make the compiled test, to be cached as this version; see `bow_classifier.sources`."""

    @njit(nogil=True, cache=True, error_model="numpy")
    def count(record, start, delay, level, factors, gap, number, sure, clusters):
        end = record.shape[1]
        levels = np.empty(factors.shape[0], np.float32)
        tally = np.empty(factors.shape[0], np.int64)
        for i in range(record.shape[0]):
            levels[:] = factors * level[i]
            lowest, highest = levels.min(), levels.max()
            tally[:] = 0
            row, back = i * end, delay[i]
            latest, apart = -end, 0
            for group in range(start, end, LANES):
                first = min(group, end - LANES)  # the last group goes back over samples that are already counted
                at = row + first
                now = load(record, at) - load(record, at - back)
                if bits_of(absolute(now) > lowest):  # most groups lie below every level: no onset there
                    before = load(record, at - 1) - load(record, at - 1 - back)
                    if not bits_of(((now > lowest) & (before <= highest)) | ((now < -lowest) & (before >= -highest))):
                        continue  # others stay above
                    for k in range(levels.shape[0]):
                        onsets = _onsets(now, before, levels[k]) >> (group - first)
                        tally[k] += _ONES[onsets]
                        if k == 0 and onsets:
                            for lane in range(LANES):
                                if onsets >> lane & 1:
                                    apart += int(group + lane - latest > gap[i])
                                    latest = group + lane
            number[i] = tally[0]
            clusters[i] = apart
            same = 0
            for k in range(1, tally.shape[0]):
                same += int(tally[k] == tally[0])
            sure[i] = same / (tally.shape[0] - 1)
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
        (cells,) threshold of |y|, in units of the bridge force.
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
    _corners(np.ascontiguousarray(record), start, delay, level, _FACTORS, gap, *result)
    return result
