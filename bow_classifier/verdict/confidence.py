"""The confidence in a verdict: the probability that the regime is right, from how far the cell is from the thresholds.

A logistic function of six margins, with one row of coefficients for each regime. ``python -m studies.verdicts --fit``
fitted the coefficients to records whose regime is known; docs/verdicts.md shows how well they predict other records.
That of wolves is the rule of succession: all of 126 strings called so were wolves (``python -m studies.wolves``).
No coefficient of a margin is negative: the confidence never falls with the distance from a threshold.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from bow_classifier.verdict.fingerprint import LEAN
from bow_sim.simd import lanes
from bow_sim.simd.elementary import exp_parts, exp_series, log_series
from bow_sim.simd.jit import part
from bow_sim.simd.lanes import LANES

load: Any = lanes.load  # for the type checker: intrinsics are called without their first argument
store: Any = lanes.store

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

_FRACTION = np.int64(52)
"""Bits of the fraction in a float64; above them is the exponent."""

_BELOW = np.int64(2**52 - 1)
_ONE, _HALF = np.int64(1023), np.int64(1022)
"""The exponents of 1 ... 2 and of 0.5 ... 1."""

_LOW = 0.7
"""Logarithms are taken of 0.7 ... 1.4, times a power of 2."""

_FAR = 3.0
_SMALL = 1e-3


class Workspace(NamedTuple):
    """The arrays that the confidence of eight cells is computed in, float64.

    Attributes
    ----------
    exponents, fractions
        (16,): the ratios whose logarithms are margins, as powers of 2 and what these are multiplied by; then the powers
        of e, in the same way.
    logarithms
        (16,).
    """

    exponents: Any
    fractions: Any
    logarithms: Any


@part(nogil=True, error_model="numpy")
def confidence_workspace():
    """Return the workspace."""
    return Workspace(np.ones(2 * LANES), np.ones(2 * LANES), np.ones(2 * LANES))


@part(**LEAN)
def _whole(number):
    """Return how near a number is to a whole one: 1 for a whole one, 0 half way between two."""
    return 1.0 - 2.0 * abs(number - round(number))


@part(**LEAN)
def _prepare_logarithm(a, b, at, workspace):
    """Write the ratio of two amounts to place `at` of the workspace."""
    bits = np.float64((a + _SMALL) / (b + _SMALL)).view(np.int64)
    exponent, fraction = (bits >> _FRACTION) - _HALF, np.int64(bits & _BELOW | _HALF << _FRACTION).view(np.float64)
    low = fraction < _LOW
    workspace.exponents[at], workspace.fractions[at] = exponent - int(low), 2.0 * fraction if low else fraction


@part(**LEAN)
def _distance(logarithm):
    """Return a logarithm without its sign, at most `_FAR`."""
    return min(_FAR, abs(logarithm))


@part(**LEAN)
def _correlation(correlation):
    return min(1.0, max(-1.0, correlation))


@part(**LEAN)
def margins(first, number, features, limits, workspace, out):
    """Write the margins of eight cells to `out`.

    Parameters
    ----------
    first, number : int
        The first of the cells, and how many they are.
    features : Features
    limits : Limits
    workspace : Workspace
    out : ndarray of float64, shape (cells, margins)
        In the order of `MARGINS`.
    """
    exponents, fractions, logarithms = workspace
    for lane in range(number):
        r = _correlation(features.correlation[first + lane])
        _prepare_logarithm(1.0 - r, 1.0 - limits.correlation, lane, workspace)
        _prepare_logarithm(features.loudness[first + lane], limits.silence, LANES + lane, workspace)
    for at in (0, LANES):
        store(logarithms, at, log_series(load(exponents, at), load(fractions, at)))
    for lane in range(number):
        i = first + lane
        correlation = features.correlation[i]
        if correlation > limits.correlation:
            per_period = features.period[i] / (limits.periods * limits.period)
        else:
            per_period = 1.0 / limits.periods
        row = out[i]
        row[0] = 1.0
        row[1] = _distance(logarithms[lane]) if abs(correlation) <= 2.0 else _FAR  # NaN: no maximum
        row[2] = features.sure_slips[i]
        row[3] = features.sure_corners[i]
        row[4] = _whole(features.slips[i] * per_period)
        row[5] = _whole(features.corners[i] * per_period)
        row[6] = _distance(logarithms[LANES + lane])


@part(**LEAN)
def probabilities(first, number, regime, rows, workspace, out):
    """Write the logistic function of the weighted margins of eight cells, 0 ... 1, to `out`.

    Parameters
    ----------
    first, number : int
        The first of the cells, and how many they are.
    regime : ndarray of uint8, shape (cells,)
    rows : ndarray of float64, shape (cells, margins)
    workspace : Workspace
    out : ndarray of float32, shape (cells,)
    """
    exponents, fractions = workspace.exponents, workspace.fractions
    for lane in range(number):
        coefficients, row = COEFFICIENTS[regime[first + lane]], rows[first + lane]
        total = 0.0
        for k in range(row.shape[0]):
            total += coefficients[k] * row[k]
        exponents[lane], fractions[lane] = exp_parts(-total)
    store(fractions, 0, exp_series(load(fractions, 0)))
    for lane in range(number):
        power = np.int64((np.int64(exponents[lane]) + _ONE) << _FRACTION).view(np.float64)  # `ldexp` is a call
        out[first + lane] = 1.0 / (1.0 + fractions[lane] * power)
