"""The confidence in a verdict: the probability that the regime is right, from how far the cell is from the thresholds.

A logistic function of six margins, with one row of coefficients for each regime. ``python -m studies.verdicts --fit``
fitted the coefficients to records whose regime is known; docs/verdicts.md shows how well they predict other records.
That of wolves is the rule of succession: all of 126 strings called so were wolves (``python -m studies.wolves``).
No coefficient of a margin is negative: the confidence never falls with the distance from a threshold.
"""

from __future__ import annotations

import numpy as np

from bow_classifier.verdict.fingerprint import LEAN
from bow_sim.simd.elementary import exp, log
from bow_sim.simd.jit import part

MARGINS = ("constant", "correlation", "slips", "corners", "slips whole", "corners whole", "loudness")
"""What the columns of `COEFFICIENTS` multiply:

- correlation: distance from the threshold: the logarithm of ``(1 - correlation)/(1 - threshold)`` without its sign, at
  most 3; 3 where there is no maximum, as the cell is then clearly not periodic
- slips, corners: share of neighbouring thresholds (0.8 ... 1.2 times) under which the count is the same
- slips whole, corners whole: 1 where their number a period is whole, 0 where it lies half way between two
- loudness: the logarithm of the r.m.s. bridge force over the threshold *silence* without its sign, at most 3
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
        [4.844, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],  # wolf
    ]
)
"""(regimes, margins): see `bow_classifier.verdict.regimes.DEFINITIONS` for the rows."""

_FAR = 3.0
_SMALL = 1e-3


@part(**LEAN)
def _whole(number):
    """Return how near a number is to a whole one: 1 for a whole one, 0 half way between two."""
    return 1.0 - 2.0 * abs(number - round(number))


@part(**LEAN)
def _log_ratio(a, b):
    """Return the logarithm of the ratio of two amounts without its sign, at most `_FAR`."""
    return min(_FAR, abs(log((a + _SMALL) / (b + _SMALL))))


@part(**LEAN)
def margins(i, features, per_period, limits, out):
    """Write the margins of cell i to `out`.

    Parameters
    ----------
    i : int
        The cell.
    features : Features
    per_period : float
        Turns a count in the window into a count a period.
    limits : Limits
    out : ndarray of float64, shape (margins,)
        In the order of `MARGINS`.
    """
    correlation = features.correlation[i]
    r = min(1.0, max(-1.0, correlation))
    out[0] = 1.0
    out[1] = _log_ratio(1.0 - r, 1.0 - limits.correlation) if abs(correlation) <= 2.0 else _FAR  # NaN: no maximum
    out[2] = features.sure_slips[i]
    out[3] = features.sure_corners[i]
    out[4] = _whole(features.slips[i] * per_period)
    out[5] = _whole(features.corners[i] * per_period)
    out[6] = _log_ratio(features.loudness[i], limits.silence)


@part(**LEAN)
def probability(coefficients, row):
    """Return the logistic function of the weighted margins, 0 ... 1; both arguments are (margins,)."""
    total = 0.0
    for k in range(row.shape[0]):
        total += coefficients[k] * row[k]
    return 1.0 / (1.0 + exp(-total))
