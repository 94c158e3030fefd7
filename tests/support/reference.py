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


def corners(x: NDArray[np.float64], begin: int, end: int, delay: int, level: float) -> int:
    """Return the corners between two samples by walking from t = 0 with an arming state."""
    count, above = 0, 0
    for t in range(end):
        y = x[t] - (x[t - delay] if t >= delay else 0.0)
        sign = int(y > level) - int(y < -level)
        if sign and sign != above and t >= begin:
            count += 1
        above = sign
    return count


def slips(slipping: NDArray[np.bool_], speed: NDArray[np.float64], begin: int, end: int, level: float) -> int:
    """Return the slips whose first sticking sample lies between two samples and that exceed the level."""
    count, total = 0, 0.0
    for t in range(end):
        if slipping[t]:
            total += speed[t]
        else:
            count += t >= begin and total > level
            total = 0.0
    return count
