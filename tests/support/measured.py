"""The force at the bridge of an ideal string, as a sensor gives it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

RATE, F0, BETA = 48000.0, 440.0, 15 / 139
"""Of the recording; a period is 109.09 samples."""


def played(seconds: float, noise: float = 0.0, f0: float = F0) -> NDArray[np.float64]:
    """Return Helmholtz motion at the bridge: a sawtooth, softened as a string and a sensor do, upside down.

    Parameters
    ----------
    noise
        R.m.s. of noise over that of the sound.
    """
    t = np.arange(round(seconds * RATE))
    harmonics = np.arange(1, int(0.45 * RATE / f0))
    phase = 2 * np.pi * f0 / RATE * np.outer(harmonics, t)
    wave = (np.exp(-((harmonics / 30) ** 2)) / harmonics) @ np.sin(phase)
    wave = 2.5 - 0.01 * wave
    return wave + noise * np.std(wave) * np.random.default_rng(3).normal(size=len(wave))


def blocks(wave: NDArray[np.float64], length: int = 480) -> Iterator[tuple[NDArray[np.float64], float]]:
    """Yield a recording in blocks as they come, and when."""
    for first in range(0, len(wave), length):
        yield wave[first : first + length], (first + length) / RATE
