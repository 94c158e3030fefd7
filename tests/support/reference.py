"""PHYSICS.md section 7 in plain NumPy, over a whole record: the compiled classifier must give the same."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def periodicity(x: NDArray[np.float64], end: int, period: int, lags: Sequence[int]) -> tuple[float, float]:
    """Return the largest interior maximum of the correlation over the five periods before `end`, and its place."""
    past = np.concatenate([np.zeros(4 * period), x])
    end += 4 * period
    r = []
    for lag in lags:
        each = []
        for w in range(5):
            a = past[end - (w + 1) * period : end - w * period]
            b = past[end - (w + 1) * period - lag : end - w * period - lag]
            flat = np.ptp(a) == 0 or np.ptp(b) == 0
            each.append(np.nan if flat else np.corrcoef(a, b)[0, 1])
        r.append(np.mean(each))
    best = (np.nan, np.nan)
    for i in range(1, len(lags) - 1):
        if r[i - 1] < r[i] > r[i + 1]:
            p = np.polyfit([-1, 0, 1], r[i - 1 : i + 2], 2)
            place = -p[1] / (2 * p[0])
            height = np.polyval(p, place)
            if not height <= best[0]:
                best = (height, lags[i] + place)
    return min(best[0], 1.0), best[1]


def corner_times(x: NDArray[np.float64], delay: int, level: float) -> NDArray[np.intp]:
    """Return the samples of all corners of a record, by walking from t = 0 with an arming state."""
    found, above = [], 0
    difference = x - np.concatenate([np.zeros(delay), x])[: len(x)]
    for t, sign in enumerate((np.int8(difference > level) - np.int8(difference < -level)).tolist()):
        if sign and sign != above:
            found.append(t)
        above = sign
    return np.array(found, np.intp)


def corners(x: NDArray[np.float64], begin: int, end: int, delay: int, level: float) -> int:
    """Return the corners between two samples, in a walk from t = 0."""
    return int(np.count_nonzero(corner_times(x[:end], delay, level) >= begin))


def slip_ends(slipping: NDArray[np.bool_], speed: NDArray[np.float64], level: float) -> NDArray[np.intp]:
    """Return the first sticking sample after each slip of a record that exceeds the level."""
    found, total = [], 0.0
    for t, (slips_now, step) in enumerate(zip(slipping.tolist(), speed.tolist(), strict=True)):
        if slips_now:
            total += step
        else:
            if total > level:
                found.append(t)
            total = 0.0
    return np.array(found, np.intp)


def slips(slipping: NDArray[np.bool_], speed: NDArray[np.float64], begin: int, end: int, level: float) -> int:
    """Return the slips whose first sticking sample lies between two samples and that exceed the level."""
    return int(np.count_nonzero(slip_ends(slipping[:end], speed[:end], level) >= begin))
