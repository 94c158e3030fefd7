"""Which differences between maps are significant.

A measure of a map has four independent values, one from each of its four interleaved grids of half the density
(:func:`bow_sweep.maps.playability.playability`). Two maps are compared by Welch's t test on four values against four.
Where many maps are compared, some differences look large by chance; Holm's correction keeps the chance that any of
them is called significant without being so below `LEVEL`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

GRIDS = 4
"""Independent values of a measure."""

LEVEL = 0.05
"""Chance that any of the differences that are compared together is called significant, where there is none."""

TEST = (
    f"Welch's t test on the {GRIDS} interleaved grids of each map, Holm's correction over the maps of a measure, "
    f"level {LEVEL:.0%}"
)


class Measured(NamedTuple):
    """A measure of a map.

    Attributes
    ----------
    value
        None where there is nothing to measure.
    error, mean
        Standard error and mean of the four grids; None where the map is too small.
    """

    value: float | None
    error: float | None
    mean: float | None


class Difference(NamedTuple):
    """How a measure of one map differs from that of another.

    Attributes
    ----------
    value, error
        Of the difference; None where not known.
    p
        Chance of such a difference, or a larger one, where there is none; corrected. None where not known.
    significant
        Whether `p` is at most `LEVEL`.
    """

    value: float | None
    error: float | None
    p: float | None
    significant: bool


def p_value(one: Measured, other: Measured) -> float | None:
    """Return the two-sided p of Welch's t test between the grids of two maps; None where one is too small."""
    from scipy.stats import ttest_ind_from_stats

    if one.mean is None or other.mean is None or one.error is None or other.error is None:
        return None
    if one.error == 0 and other.error == 0:  # the grids of each map agree to the last cell
        return 1.0 if one.mean == other.mean else 0.0
    spread = [each.error * np.sqrt(GRIDS) for each in (one, other) if each.error is not None]
    found = ttest_ind_from_stats(one.mean, spread[0], GRIDS, other.mean, spread[1], GRIDS, equal_var=False)
    return float(found.pvalue)


def holm(p: Sequence[float]) -> NDArray[np.float64]:
    """Return p values corrected for being several, (tests,), after Holm (Scand. J. Statist. 6, 65-70, 1979)."""
    values = np.asarray(p, float)
    order = np.argsort(values, kind="stable")
    stepped = np.maximum.accumulate(values[order] * (len(values) - np.arange(len(values))))
    corrected = np.empty_like(values)
    corrected[order] = np.minimum(stepped, 1.0)
    return corrected


def differences(pairs: Sequence[tuple[Measured, Measured]]) -> list[Difference]:
    """Return how each second map differs from the first, for one measure; the pairs are corrected together."""
    raw = [p_value(one, other) for one, other in pairs]
    known = [index for index, p in enumerate(raw) if p is not None]
    corrected: list[float | None] = [None] * len(raw)
    for index, p in zip(known, holm([raw[index] or 0.0 for index in known]), strict=True):
        corrected[index] = float(p)
    found = []
    for (one, other), p in zip(pairs, corrected, strict=True):
        value = None if one.value is None or other.value is None else other.value - one.value
        known_errors = value is not None and one.error is not None and other.error is not None
        error = math.hypot(one.error or 0.0, other.error or 0.0) if known_errors else None
        found.append(Difference(value, error, p, p is not None and p <= LEVEL))
    return found
