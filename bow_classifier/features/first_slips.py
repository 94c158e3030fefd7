"""Guettler's transient: how long after the first slip regular slips begin (PHYSICS.md section 14).

It is for a bow that is accelerated without end (``gesture=guettler``). Releases are regular where each follows the one
before after the nominal period, within `TOLERANCE`. The transient ends where the last unbroken row of at least `LEAST`
such intervals begins.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_classifier.verdict.fingerprint import LEAN
from bow_sim.simd.jit import part

TOLERANCE = 0.05
"""How far an interval between two releases may differ from the nominal period, in parts of it."""

LEAST = 5
"""Intervals of a row that counts."""


class Releases(NamedTuple):
    """The significant slips of each cell so far, by their first sample from t = 0 on; arrays are (cells,) int64.

    They have no cells where nobody asks for the transient.

    Attributes
    ----------
    first, latest
        The first one, and the latest; -1 before.
    begin, intervals
        Where the present row of regular intervals began, and how many it has.
    found
        Where the last row of at least `LEAST` intervals began; -1 for none.
    """

    first: NDArray[np.int64]
    latest: NDArray[np.int64]
    begin: NDArray[np.int64]
    intervals: NDArray[np.int64]
    found: NDArray[np.int64]

    @classmethod
    def none(cls, cells: int) -> Releases:
        """Return the state before t = 0."""
        first, latest, begin, found = (np.full(cells, -1, np.int64) for _ in range(4))
        return cls(first, latest, begin, np.zeros(cells, np.int64), found)


@part(**LEAN)
def transient_after(i, origin, period, onsets, number, releases):
    """Take the significant slips of a chunk of cell i; return its transient so far, nominal periods.

    The transient is 0 while there is none. One of less than a sample, where the first slip begins the regular row, is
    given as one sample.

    Parameters
    ----------
    i, origin, period : int
        The cell; first sample of the chunk from t = 0 on; nominal period, samples.
    onsets : ndarray of int64
        First sample of each slip, from the start of the chunk; negative if it began before.
    number : int
        Of them.
    releases : Releases
        Cell i is changed.
    """
    first, latest, begin, intervals, found = releases
    for k in range(number):
        onset = origin + onsets[k]
        if latest[i] < 0:
            first[i] = begin[i] = onset
        elif abs(onset - latest[i] - period) <= TOLERANCE * period:
            intervals[i] += 1
            if intervals[i] >= LEAST:
                found[i] = begin[i]
        else:
            begin[i], intervals[i] = onset, 0
        latest[i] = onset
    return max(found[i] - first[i], 1) / period if found[i] >= 0 else 0.0
