"""The steady motion at the end of a waveform: its pitch, its spectrum, its harmonics."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

TAIL_PERIODS = 20
"""Nominal periods at the end of a waveform that are analysed, where it has as many."""

NEAR = 0.12
"""Share of the nominal period by which a period may differ from it and still be looked for."""

LEAST_CORRELATION = 0.7
"""Correlation of successive periods below which a motion is not periodic here; verdicts have their own thresholds."""

FLOOR_DB = -120.0
"""Lower end of spectra, relative to the strongest component."""

PADDING = 4
"""Spectra have this times as many points as the tail has samples for: smooth curves, no more information."""

SILENCE = 1e-4
"""Amplitude below which a waveform is at rest; final bow speed = 1."""


class Spectrum(NamedTuple):
    """Amplitudes over frequency.

    Attributes
    ----------
    frequency
        (lines,) Hz, from 0 to half the sample rate.
    level
        (lines,) dB; 0 dB is a sinusoid of amplitude 1 (final bow speed).
    """

    frequency: NDArray[np.float64]
    level: NDArray[np.float64]


class Harmonics(NamedTuple):
    """The harmonics of a periodic motion.

    Attributes
    ----------
    number
        (harmonics,) 1 ... n.
    frequency
        (harmonics,) Hz, whole multiples of the first.
    level
        (harmonics,) dB; 0 dB is a sinusoid of amplitude 1 (final bow speed).
    """

    number: NDArray[np.int64]
    frequency: NDArray[np.float64]
    level: NDArray[np.float64]


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


def steady_tail(force: NDArray[np.floating], period: float, periods: int = TAIL_PERIODS) -> NDArray[np.floating]:
    """Return the last whole periods of a waveform, to the nearest sample.

    Parameters
    ----------
    force
        (samples,) bridge force.
    period
        Period of the motion, samples; need not be whole.
    periods
        Number of periods; fewer where the waveform is shorter, at least one.
    """
    count = max(1, min(periods, int(len(force) / period)))
    return force[-min(len(force), round(count * period)) :]


def spectrum(
    force: NDArray[np.floating], sample_rate: float, period: float | None = None, periods: int = TAIL_PERIODS
) -> Spectrum:
    """Return the amplitude spectrum of a waveform, or of its steady end: Hann window, mean removed.

    Parameters
    ----------
    force
        (samples,) bridge force.
    sample_rate
        Hz.
    period
        Period of the motion, samples: only the last `periods` whole ones are looked at. None: all of `force`.
    periods
        See `period`.
    """
    from scipy.signal import periodogram  # late: it takes a third of a second to import

    tail = np.asarray(force if period is None else steady_tail(force, period, periods), float)
    frequency, power = periodogram(
        tail, sample_rate, "hann", nfft=PADDING * len(tail), detrend="constant", scaling="spectrum"
    )
    return Spectrum(frequency, _decibels(np.sqrt(2 * power)))


def harmonics(force: NDArray[np.floating], sample_rate: float, period: float, periods: int = TAIL_PERIODS) -> Harmonics:
    """Return the harmonics of the steady end of a waveform, up to half the sample rate.

    Parameters
    ----------
    force, sample_rate, periods
        As in :func:`spectrum`.
    period
        Period of the motion, samples, see :func:`period_of`.
    """
    tail = np.asarray(steady_tail(force, period, periods), float)
    tail = tail - tail.mean()
    number = np.arange(1, int(0.5 * period - 1e-9) + 1)
    window = np.hanning(len(tail) + 1)[:-1]
    phase = np.exp(-2j * np.pi / period * np.outer(number, np.arange(len(tail))))
    amplitude = 2 * np.abs(phase @ (tail * window)) / window.sum()
    return Harmonics(number, np.asarray(number * (sample_rate / period), np.float64), _decibels(amplitude))


def _decibels(amplitude: NDArray[np.float64]) -> NDArray[np.float64]:
    floor = max(float(np.max(amplitude, initial=0.0)), SILENCE) * 10 ** (FLOOR_DB / 20)
    return np.asarray(20 * np.log10(np.maximum(amplitude, floor)))


def cents(period: float, nominal: float) -> float:
    """Return how far a period is from the nominal one in pitch, cents; below 0 is flat."""
    return float(1200 * np.log2(nominal / period))
