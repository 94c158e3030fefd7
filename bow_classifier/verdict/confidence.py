"""How sure a verdict is: the margins of its tests, turned into a probability that the name is right.

A logistic curve over six margins, one row of coefficients for each regime. They were fitted to records with known truth
by ``python -m studies.verdicts --fit`` (docs/verdicts.md says how well they hold on others), with no coefficient of a
margin below zero: whoever is further from a threshold is not trusted less.
"""

from __future__ import annotations

import math

import numpy as np

from bow_classifier.verdict.fingerprint import LEAN
from bow_sim.simd.jit import njit

MARGINS = ("constant", "correlation", "slips", "corners", "slips whole", "corners whole", "loudness")
"""What the columns of `COEFFICIENTS` multiply:

- correlation: how far from the threshold, as the logarithm of the ratio of what is missing to 1, at most 3; where there
  is no maximum, 3: there is nothing to argue with
- slips, corners: share of neighbouring thresholds (0.8 ... 1.2 times) under which they count the same
- slips whole, corners whole: 1 where their number a period is whole, 0 where it lies half way between two
- loudness: logarithm of the ratio of the bridge force's r.m.s. to the threshold of silence, either way, at most 3
"""

COEFFICIENTS = np.array(
    [
        [6.217, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],  # no_oscillation
        [-8.986, 0.035, 0.0, 2.59, 0.005, 0.005, 3.823],  # helmholtz
        [4.054, 0.102, 0.0, 0.0, 0.1, 0.037, 0.0],  # multiple_slip
        [0.582, 0.226, 0.0, 1.712, 0.0, 0.394, 0.0],  # multiple_flyback
        [-4.357, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],  # other_periodic
        [-13.417, 2.546, 0.023, 0.0, 2.583, 1.734, 2.215],  # aperiodic
        [6.138, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],  # helmholtz_extra_slips
        [2.411, 0.324, 0.0, 0.0, 0.0, 0.0, 0.0],  # raman_higher
        [6.131, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],  # anomalous_low_frequency
        [-1.904, 1.709, 0.0, 0.0, 0.152, 0.0, 1.087],  # subharmonic
    ]
)
"""(regimes, margins): see `bow_classifier.verdict.regimes.DEFINITIONS` for the rows."""

_FAR = 3.0
_SMALL = 1e-3


@njit(**LEAN)
def _whole(number):
    return 1.0 - 2.0 * abs(number - round(number))


@njit(**LEAN)
def _ratio(a, b):
    """Return how far apart two amounts are: the logarithm of their ratio without its sign, at most `_FAR`."""
    return min(_FAR, abs(math.log((a + _SMALL) / (b + _SMALL))))


@njit(**LEAN)
def margins(correlation, slips, corners, sure_slips, sure_corners, loudness, least, silence, out):
    """Write the margins of one cell to out, (margins,); slips and corners are numbers a period."""
    r = min(1.0, max(-1.0, correlation))
    out[0] = 1.0
    out[1] = _ratio(1.0 - r, 1.0 - least) if abs(correlation) <= 2.0 else _FAR
    out[2] = sure_slips
    out[3] = sure_corners
    out[4] = _whole(slips)
    out[5] = _whole(corners)
    out[6] = _ratio(loudness, silence)


@njit(**LEAN)
def probability(coefficients, row):
    """Return the logistic of the weighted margins, 0 ... 1."""
    total = 0.0
    for k in range(row.shape[0]):
        total += coefficients[k] * row[k]
    return 1.0 / (1.0 + math.exp(-total))
