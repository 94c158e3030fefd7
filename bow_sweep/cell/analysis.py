"""The steady motion at the end of a waveform: its pitch, its spectrum, its harmonics."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_classifier.measured.pitch import SILENCE, TAIL_PERIODS, period_of

__all__ = [
    "SILENCE",
    "TAIL_PERIODS",
    "Harmonics",
    "Spectrum",
    "cents",
    "harmonics",
    "period_of",
    "spectrum",
    "steady_tail",
]

FLOOR_DB = -120.0
"""Lower end of spectra, relative to the strongest component."""

PADDING = 4
"""Spectra have this times as many points as the tail has samples for: smooth curves, no more information."""


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
