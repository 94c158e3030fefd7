"""The verdict: what the three tests together say of a string, and what it is called where they fail.

Schumacher & Woodhouse (1995), section III.B, take three tests together; PHYSICS.md section 7 pins them down. The names
beyond are defined in :mod:`bow_classifier.verdict.regimes`; here is the order in which they are tried.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_classifier.verdict.confidence import COEFFICIENTS, margins, probability
from bow_classifier.verdict.fingerprint import LEAN, VERSION
from bow_classifier.verdict.regimes import (
    ANOMALOUS_LOW_FREQUENCY,
    APERIODIC,
    HELMHOLTZ,
    HELMHOLTZ_EXTRA_SLIPS,
    MULTIPLE_FLYBACK,
    MULTIPLE_SLIP,
    NO_OSCILLATION,
    OTHER_PERIODIC,
    RAMAN_HIGHER,
    SUBHARMONIC,
)
from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sim.simd.jit import njit

ORDERS = (1, 2)
"""Orders m of anomalous low frequencies (PHYSICS.md section 9)."""

MULTIPLES = (2, 3)
"""Orders m of subharmonics."""

LONG = 1.25
"""From so many nominal periods on a period is long: what is shorter is a nominal one, flattened or sharpened."""


class Evidence(NamedTuple):
    """What the tests found in the window, for every cell of a block; arrays are (cells,).

    Attributes
    ----------
    correlation, period
        float32, as published, so that a reader of verdicts finds the rules kept; period in samples; NaN for none.
    slips, slip_clusters, small_slips
        uint16: significant slips, those of them that begin a cluster, and insignificant ones.
    corners, corner_clusters
        uint16: corners, and those of them that begin a cluster.
    loudness
        float64: r.m.s. deviation of the bridge force from its mean, in v_b/beta.
    ripple
        float64: strongest line of the ripples over the stronger of the first two of the period, see
        `bow_classifier.features.ripples`; 0 where it was not asked for.
    sure_slips, sure_corners
        float64, 0 ... 1: share of neighbouring thresholds that give the same counts.
    beta
        float64: bow position.
    """

    correlation: NDArray[np.float32]
    period: NDArray[np.float32]
    slips: NDArray[np.uint16]
    slip_clusters: NDArray[np.uint16]
    small_slips: NDArray[np.uint16]
    corners: NDArray[np.uint16]
    corner_clusters: NDArray[np.uint16]
    loudness: NDArray[np.float64]
    ripple: NDArray[np.float64]
    sure_slips: NDArray[np.float64]
    sure_corners: NDArray[np.float64]
    beta: NDArray[np.float64]

    @classmethod
    def empty(cls, beta: NDArray[np.float64]) -> Evidence:
        """Return room for what the tests find of cells with these bow positions."""
        kinds = [np.float32] * 2 + [np.uint16] * 5 + [np.float64] * 4
        return cls._make([*(np.empty(len(beta), kind) for kind in kinds), beta])


class Decision(NamedTuple):
    """The verdicts on the cells of a block.

    Attributes
    ----------
    regime
        (cells,) uint8: index into `bow_classifier.verdict.regimes.REGIMES`.
    confidence
        (cells,) float32, 0 ... 1: probability that the name is right, see `bow_classifier.verdict.confidence`.
    margins
        (cells, margins) float64: what the confidence was made of.
    """

    regime: NDArray[np.uint8]
    confidence: NDArray[np.float32]
    margins: NDArray[np.float64]

    @classmethod
    def empty(cls, cells: int) -> Decision:
        """Return room for the verdicts."""
        return cls(np.empty(cells, np.uint8), np.empty(cells, np.float32), np.empty((cells, COEFFICIENTS.shape[1])))


@njit(**LEAN)
def _near(period, place, tolerance):
    return abs(period - place) <= tolerance * place


@njit(**LEAN)
def _long(period, slips, clusters, beta, nominal, tolerance):
    """Return the code of a cell that repeats after a long lag; slips and clusters are whole numbers a period."""
    if slips == 1 or clusters == 1:
        for order in ORDERS:
            if _near(period, nominal * (1 + order * (1 - beta)), tolerance):
                return ANOMALOUS_LOW_FREQUENCY
    for multiple in MULTIPLES:
        if slips >= 2 and _near(period, nominal * multiple, tolerance):
            return SUBHARMONIC
    return OTHER_PERIODIC


@njit(**LEAN)
def _near_nominal(slips, clusters, corners, corner_clusters, ripple, beta, s_motion, most):
    """Return the code of a cell that repeats after about one nominal period; whole numbers a period."""
    cluster = corner_clusters == 1 or (corner_clusters == 0 and slips == 1)  # 0: they fill the period, but for one slip
    if 3 <= corners < 1 / beta and cluster:  # as many as ripples in a period would be no cluster
        return MULTIPLE_FLYBACK if ripple < most else RAMAN_HIGHER
    if slips == 1 and (corners >= 2 or ripple >= s_motion):
        return RAMAN_HIGHER
    if slips >= 2:
        return RAMAN_HIGHER if clusters == 1 and corners == 2 and corner_clusters == 1 else MULTIPLE_SLIP
    return OTHER_PERIODIC


@njit(**LEAN)
def _regime(correlation, period, slips, slip_clusters, small, corners, corner_clusters, loudness, ripple, beta, limits):
    """Return the code of one cell; the rule of section III.B, and what it is called where it fails."""
    periods, nominal, last, least, silence, tolerance, s_motion, most = limits
    periodic = correlation > least  # NaN, no interior maximum, is no period either
    if periodic and period < last + 1.0 and slips == periods and corners == periods:
        return HELMHOLTZ_EXTRA_SLIPS if round(small / periods) >= 1 else HELMHOLTZ
    if slips == 0 or loudness < silence:
        return NO_OSCILLATION
    if not periodic:
        return APERIODIC
    turns = period / (periods * nominal)
    slips_a_period, clusters_a_period = round(slips * turns), round(slip_clusters * turns)
    if period >= LONG * nominal:
        return _long(period, slips_a_period, clusters_a_period, beta, nominal, tolerance)
    corners_a_period, corner_clusters_a_period = round(corners * turns), round(corner_clusters * turns)
    return _near_nominal(
        slips_a_period, clusters_a_period, corners_a_period, corner_clusters_a_period, ripple, beta, s_motion, most
    )


@njit(**LEAN)
def decide_cell(i, e, limits, decision):
    """Write regime, confidence and margins of cell i to the decision, from the evidence e."""
    periods, nominal, _, least, silence, _, _, _ = limits
    regime, confidence, out = decision
    correlation, period, loudness = e.correlation[i], e.period[i], e.loudness[i]
    slips, corners = e.slips[i], e.corners[i]
    regime[i] = _regime(
        correlation, period, slips, e.slip_clusters[i], e.small_slips[i], corners, e.corner_clusters[i],
        loudness, e.ripple[i], e.beta[i], limits,
    )  # fmt: skip
    if not loudness >= 0.0:  # samples that are no numbers
        out[i] = 0.0
        confidence[i] = 0.0
        return
    turns = period / (periods * nominal) if correlation > least else 1.0 / periods
    margins(
        correlation, slips * turns, corners * turns, e.sure_slips[i], e.sure_corners[i],
        loudness, least, silence, out[i],
    )  # fmt: skip
    confidence[i] = probability(COEFFICIENTS[regime[i]], out[i])


def build(version: int) -> Any:
    """Make the compiled rule, to be cached as this version; see `bow_classifier.verdict.fingerprint`."""

    @njit(nogil=True, cache=True, error_model="numpy")
    def decide(evidence, limits, decision):
        for i in range(evidence.correlation.shape[0]):
            decide_cell(i, evidence, limits, decision)
        return version

    return decide


_decide = build(VERSION)


def decide(evidence: Evidence, period: int, thresholds: Thresholds) -> Decision:
    """Return regime and confidence of every cell from what the tests found.

    Parameters
    ----------
    evidence
        Of the cells, in a window of five nominal periods.
    period
        Nominal period N, samples.
    thresholds
        What is asked.
    """
    result = Decision.empty(len(evidence.correlation))
    _decide(evidence, limits_of(period, thresholds), result)
    return result


def limits_of(period: int, thresholds: Thresholds) -> tuple[float, ...]:
    """Return what the compiled rule must know of the string and of the thresholds."""
    return (
        CHUNK_PERIODS,
        float(period),
        float(thresholds.lags(period)[1]),
        thresholds.correlation,
        thresholds.silence,
        thresholds.anomaly,
        thresholds.s_motion,
        thresholds.flyback_ripple,
    )


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
