"""The period of a sound, looked for near one that is expected."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

TAIL_PERIODS = 20
"""Nominal periods at the end of a waveform that are analysed, where it has as many."""

NEAR = 0.12
"""Share of the nominal period by which a period may differ from it and still be looked for."""

LEAST_CORRELATION = 0.7
"""Correlation of successive periods below which a motion is not periodic here; verdicts have their own thresholds."""

SILENCE = 1e-4
"""Amplitude below which a waveform is at rest; final bow speed = 1."""


def period_of(force: NDArray[np.floating], nominal: int) -> float | None:
    """Return the period of the end of a waveform.

    It is the lag of the largest autocorrelation near the nominal period, refined at the largest multiple of it that the
    tail has room for, with a parabola through three points: to a few thousandths of a sample in periodic motion.

    Parameters
    ----------
    force
        (samples,) bridge force.
    nominal
        Nominal period, samples.

    Returns
    -------
    float or None
        Samples; None where the waveform is too short, at rest, or not periodic near the nominal period.
    """
    tail = np.asarray(force[-TAIL_PERIODS * nominal :], float)
    if len(tail) < 3 * nominal or np.ptp(tail) < SILENCE:
        return None
    tail = tail - tail.mean()
    found = _peak(tail, nominal, max(2, round(NEAR * nominal)))
    if found is None or found[1] < LEAST_CORRELATION:
        return None
    lag, multiple = found[0], 2
    while (multiple + 1) * lag < len(tail):
        found = _peak(tail, round(multiple * lag), max(2, round(0.02 * nominal)))
        if found is None or found[1] < LEAST_CORRELATION:
            break
        lag, multiple = found[0] / multiple, 2 * multiple
    return lag


def _peak(wave: NDArray[np.float64], near: int, within: int) -> tuple[float, float] | None:
    """Return lag and height of the largest correlation of a waveform with itself; None where it is at an end."""
    lags = np.arange(max(1, near - within), min(len(wave) - 2, near + within) + 1)
    score = np.array([_correlation(wave, int(lag)) for lag in lags])
    best = int(np.argmax(score)) if len(score) else 0
    if not 0 < best < len(lags) - 1:
        return None
    left, middle, right = score[best - 1 : best + 2]
    bend = left - 2 * middle + right
    return float(lags[best] + (0.5 * (left - right) / bend if bend < 0 else 0.0)), float(middle)


def _correlation(wave: NDArray[np.float64], lag: int) -> float:
    early, late = wave[:-lag], wave[lag:]
    power = float(early @ early) * float(late @ late)
    return float(early @ late) / power**0.5 if power > 0 else 0.0
