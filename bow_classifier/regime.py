"""The verdict: what the three tests together say of a string.

Schumacher & Woodhouse (1995), section III.B, take three tests together; PHYSICS.md section 7 pins them down.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bow_sim.model import CHUNK_PERIODS

from .thresholds import (
    APERIODIC,
    HELMHOLTZ,
    MULTIPLE_FLYBACK,
    MULTIPLE_SLIP,
    NO_OSCILLATION,
    OTHER_PERIODIC,
    Thresholds,
)


class Decision(NamedTuple):
    """The verdicts on the cells of a block: `regime` (cells,) uint8 codes, `confidence` (cells,) float32, 0 ... 1."""

    regime: NDArray[np.uint8]
    confidence: NDArray[np.float32]


@njit(nogil=True, cache=True, error_model="numpy")
def _regime(correlation, period, slips, clusters, corners, loudness, periods, window, least, silence):
    """Return the code of one cell; the rule of section III.B, and what it is called where it fails."""
    periodic = correlation > least  # NaN, no interior maximum, is no period either
    if periodic and slips == periods and corners == periods:
        return HELMHOLTZ
    if loudness < silence:
        return NO_OSCILLATION
    if not periodic:
        return APERIODIC
    slips_a_period = round(slips * period / window)
    if (slips_a_period == 1 or round(clusters * period / window) == 1) and round(corners * period / window) >= 3:
        return MULTIPLE_FLYBACK
    if slips_a_period >= 2:
        return MULTIPLE_SLIP
    return OTHER_PERIODIC


@njit(nogil=True, cache=True, error_model="numpy")
def _confidence(regime, correlation, loudness, sure, least, silence):
    """Return the margin of one cell's verdict, 0 ... 1; see `decide`."""
    if not loudness >= 0.0:
        return 0.0
    if regime == NO_OSCILLATION:
        return 1.0 - loudness / silence
    heard = min(1.0, max(0.0, loudness / silence - 1.0))
    if not abs(correlation) <= 1.0:
        return min(heard, 0.5)
    periodic = min(1.0, abs(correlation - least) / (1.0 - least))
    return min(heard, periodic) * (sure if correlation > least else 1.0)


@njit(nogil=True, cache=True, error_model="numpy")
def _decide(
    correlation, period, slips, clusters, corners, loudness, sure, periods, window, least, silence, regime, confidence
):
    for i in range(correlation.shape[0]):
        regime[i] = _regime(
            correlation[i], period[i], slips[i], clusters[i], corners[i], loudness[i], periods, window, least, silence
        )
        confidence[i] = _confidence(regime[i], correlation[i], loudness[i], sure[i], least, silence)


def decide(
    correlation: NDArray[np.float32],
    period: NDArray[np.float32],
    slips: NDArray[np.uint16],
    clusters: NDArray[np.uint16],
    corners: NDArray[np.uint16],
    loudness: NDArray[np.float64],
    sure: NDArray[np.float64],
    window: int,
    thresholds: Thresholds,
) -> Decision:
    """Return regime and confidence of every cell from the results of the three tests.

    The confidence is a plain measure of margin, **not calibrated**: 0 at the threshold of periodicity or of silence
    and growing with the distance from it; for periodic motion times the share of neighbouring thresholds (0.8 ... 1.2
    times) under which the slips, and the corners, count the same. Without any maximum within the lags it is at most
    0.5, as there may be a period outside them.

    Parameters
    ----------
    correlation, period
        (cells,) as published, so that a reader of verdicts finds the rule kept; period in samples; NaN for none.
    slips, clusters, corners
        (cells,) counts in the window: significant slips, those that begin a cluster, corners.
    loudness
        (cells,) r.m.s. deviation of the bridge force from its mean over the window, in v_b/beta.
    sure
        (cells,) share of neighbouring thresholds that give the same counts, 0 ... 1.
    window
        Samples of the window.
    thresholds
        What is asked.
    """
    regime = np.empty(len(correlation), np.uint8)
    confidence = np.empty(len(correlation), np.float32)
    _decide(
        correlation,
        period,
        slips,
        clusters,
        corners,
        loudness,
        sure,
        CHUNK_PERIODS,
        window,
        thresholds.correlation,
        thresholds.silence,
        regime,
        confidence,
    )
    return Decision(regime, confidence)


def history(passed: NDArray[np.bool_]) -> tuple[NDArray[np.float32], NDArray[np.uint16]]:
    """Return transient length and regressions from a cell's sequence of tests (PHYSICS.md section 7).

    Parameters
    ----------
    passed
        (tests, ...) whether the test after each five periods found Helmholtz motion.

    Returns
    -------
    transient_periods
        (...) float32: the first multiple of five periods at which the tests pass; 0 = never.
    regressions
        (...) uint16: how often a test failed directly after one that passed.
    """
    passed = np.asarray(passed, dtype=bool)
    first = np.argmax(passed, axis=0) + 1 if len(passed) else np.zeros(passed.shape[1:], int)
    transient = np.where(passed.any(axis=0), CHUNK_PERIODS * first, 0).astype(np.float32)
    return transient, (passed[:-1] & ~passed[1:]).sum(axis=0).astype(np.uint16)
