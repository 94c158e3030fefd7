"""What the claims are about, measured on slips, on rows of a map, and on the velocity of the bridge."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bow_sweep.beyond.sweeps import THRESHOLDS
from bow_sweep.maps.slips import Slips

WOLF_PERIODS = 100
"""Periods that the regime *wolf* looks back."""


def lower_limit(forces: ArrayLike, succeeds: ArrayLike) -> float:
    """Return the force that parts a row of a map best: failures below, successes above.

    It is the force with the fewest cells on the wrong side; between the two neighbours, in the middle of their
    logarithms; of several the lowest. Cells above the last success are left out.

    Parameters
    ----------
    forces : (cells,)
        Rising.
    succeeds : (cells,) of bool

    Returns
    -------
    float
        NaN where no cell succeeds, or the lowest one does and nothing is below it.
    """
    forces, succeeds = np.asarray(forces, float), np.asarray(succeeds, bool)
    if not succeeds.any():
        return np.nan
    last = np.flatnonzero(succeeds)[-1]
    row = succeeds[: last + 1]
    wrong = np.append(0, np.cumsum(row)) + np.append(np.cumsum(~row[::-1])[::-1], 0)  # successes below, failures above
    cut = int(np.argmin(wrong[: last + 1]))
    return float(np.sqrt(forces[cut - 1] * forces[cut])) if cut else np.nan


def upper_limit(forces: ArrayLike, succeeds: ArrayLike) -> float:
    """Return the force that parts a row of a map best with successes below it; as :func:`lower_limit`."""
    forces, succeeds = np.asarray(forces, float), np.asarray(succeeds, bool)
    return 1 / lower_limit(1 / forces[::-1], succeeds[::-1])


def rank_correlation(a: ArrayLike, b: ArrayLike) -> float:
    """Return Spearman's rank correlation; equal values share their ranks."""
    return float(np.corrcoef(_ranks(np.asarray(a, float)), _ranks(np.asarray(b, float)))[0, 1])


def _ranks(values: NDArray[np.float64]) -> NDArray[np.float64]:
    _, where, count = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(count)
    return np.asarray((last - (count - 1) / 2)[where], np.float64)


def beat(bridge_velocity: ArrayLike, period: int) -> tuple[float, float]:
    """Return the beat of a wolf, in periods, and how clear it is (PHYSICS.md section 11).

    The r.m.s. of the bridge velocity over one period is taken every N/16 samples. The beat is the lag of the highest
    value of its autocorrelation beyond the first zero and below half the record; how clear it is, that value.

    Parameters
    ----------
    bridge_velocity : (samples,)
    period : int
        N, samples.

    Returns
    -------
    tuple of float
        NaN and 0 where the autocorrelation has no zero.
    """
    hop = max(1, period // 16)
    energy = np.cumsum(np.append(0.0, np.square(np.asarray(bridge_velocity, float))))
    rms = np.sqrt(np.maximum(0, energy[period:] - energy[:-period])[::hop] / period)
    rms = rms - rms.mean()
    size = 1 << (2 * len(rms)).bit_length()
    spectrum = np.fft.rfft(rms, size)
    correlation = np.fft.irfft(spectrum * spectrum.conj(), size)[: len(rms) // 2]
    below = np.flatnonzero(correlation < 0)
    if not len(below) or not correlation[0] > 0:
        return np.nan, 0.0
    lag = int(below[0] + np.argmax(correlation[below[0] :]))
    return lag * hop / period, float(correlation[lag] / correlation[0])


def right_edge(accelerations: ArrayLike, forces: ArrayLike, succeeds: ArrayLike) -> tuple[float, float]:
    """Return the straight line ``F = m a + c`` along the side of high acceleration of a region in Guettler's plane.

    For each force the edge is the acceleration that :func:`upper_limit` gives; rows whose region reaches the end of the
    axis, or that have fewer than two successes, are left out. The line is that of least squares of a over F.

    Parameters
    ----------
    accelerations : (nx,)
    forces : (ny,)
    succeeds : (ny, nx) of bool

    Returns
    -------
    m, c : float
        NaN where fewer than three forces have an edge.
    """
    a, f, rows = np.asarray(accelerations, float), np.asarray(forces, float), np.asarray(succeeds, bool)
    edge = np.array([upper_limit(a, row) if row.sum() >= 2 else np.nan for row in rows])
    known = np.isfinite(edge)
    if known.sum() < 3:
        return np.nan, np.nan
    slope, offset = np.polyfit(f[known], edge[known], 1)
    return float(1 / slope), float(-offset / slope)


def wolf_counts(slips: Slips, period: int, periods: int) -> tuple[float, float, int]:
    """Return what the regime *wolf* is decided by, over the last 100 periods of a run (PHYSICS.md section 11).

    Parameters
    ----------
    slips
        Of one cell.
    period, periods
        N in samples, and the length of the run in periods.

    Returns
    -------
    share, mean : float
        Share of periods in which exactly one significant slip ends, and mean number of slips.
    changes : int
        How often the number changes between one and others.
    """
    ends = slips.end[slips.slip > THRESHOLDS.slip * period]
    counts = np.bincount(np.minimum((ends - 1) // period, periods - 1), minlength=periods)[-WOLF_PERIODS:]
    one = counts == 1
    return float(one.mean()), float(counts.mean()), int(np.count_nonzero(one[1:] != one[:-1]))
