"""The decision: from the features of a cell to its regime, and the confidence in it.

Schumacher & Woodhouse (1995), section III.B, combine three tests; PHYSICS.md section 7 states them exactly. The regimes
are defined in :mod:`bow_classifier.verdict.regimes`; :func:`_regime` tries them in their order of precedence. A new
regime needs an entry there and a rule here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_classifier.verdict.confidence import COEFFICIENTS, margins, probabilities
from bow_classifier.verdict.fingerprint import LEAN
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
    WOLF,
)
from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sim.simd.jit import part

ORDERS = (1, 2)
"""Orders m of anomalous low frequencies (PHYSICS.md section 9)."""

MULTIPLES = (2, 3)
"""Orders m of subharmonics."""

LONG = 1.25
"""A period of at least so many nominal ones is long; a shorter one is a nominal period, flattened or sharpened."""


class Limits(NamedTuple):
    """The numbers that the rules compare features with.

    Attributes
    ----------
    periods
        Nominal periods in the window.
    period
        Nominal period N, samples.
    last_lag
        Longest lag near the nominal period that is searched, samples.
    correlation, silence, anomaly, s_motion, flyback_ripple, wolf_share, wolf_changes, wolf_beat
        The thresholds of these names, see `bow_classifier.verdict.thresholds.Thresholds`.
    """

    periods: int
    period: float
    last_lag: float
    correlation: float
    silence: float
    anomaly: float
    s_motion: float
    flyback_ripple: float
    wolf_share: float
    wolf_changes: float
    wolf_beat: float

    @classmethod
    def of(cls, period: int, thresholds: Thresholds) -> Limits:
        """Return the limits for a string of a nominal period, in samples."""
        return cls(
            CHUNK_PERIODS,
            float(period),
            float(thresholds.lags(period)[1]),
            thresholds.correlation,
            thresholds.silence,
            thresholds.anomaly,
            thresholds.s_motion,
            thresholds.flyback_ripple,
            thresholds.wolf_share,
            thresholds.wolf_changes,
            thresholds.wolf_beat,
        )


class Features(NamedTuple):
    """What was measured in the window, for every cell of a block; arrays are (cells,).

    Attributes
    ----------
    correlation, period
        float32, as they are published: a reader of verdicts can apply the rules to the same numbers. Period in samples;
        NaN for none.
    slips, slip_clusters, small_slips
        uint16: significant slips, those of them that begin a cluster, and insignificant ones.
    corners, corner_clusters
        uint16: corners, and those of them that begin a cluster.
    loudness
        float64: r.m.s. deviation of the bridge force from its mean, in v_b/beta.
    ripple
        float64: strongest line of the ripples over the stronger of the first two of the period, see
        `bow_classifier.features.ripples`; 0 where no rule needs it.
    sure_slips, sure_corners
        float64, 0 ... 1: share of neighbouring thresholds that give the same counts.
    beat
        float32, nominal periods: the beat of a wolf, published too; NaN for none.
    transient
        float32, nominal periods: Guettler's transient, published too; NaN where the gesture is another one.
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
    beat: NDArray[np.float32]
    transient: NDArray[np.float32]
    beta: NDArray[np.float64]

    @classmethod
    def empty(cls, beta: NDArray[np.float64]) -> Features:
        """Return arrays to be filled, for cells with these bow positions."""
        kinds = [np.float32] * 2 + [np.uint16] * 5 + [np.float64] * 4 + [np.float32] * 2
        return cls._make([*(np.empty(len(beta), kind) for kind in kinds), beta])


class Decision(NamedTuple):
    """The regimes of the cells of a block, and the confidence in them.

    Attributes
    ----------
    regime
        (cells,) uint8: index into `bow_classifier.verdict.regimes.REGIMES`.
    confidence
        (cells,) float32, 0 ... 1: probability that the regime is right, see `bow_classifier.verdict.confidence`.
    margins
        (cells, margins) float64: what the confidence was computed from.
    """

    regime: NDArray[np.uint8]
    confidence: NDArray[np.float32]
    margins: NDArray[np.float64]

    @classmethod
    def empty(cls, cells: int) -> Decision:
        """Return arrays to be filled."""
        return cls(np.empty(cells, np.uint8), np.empty(cells, np.float32), np.empty((cells, COEFFICIENTS.shape[1])))


@part(**LEAN)
def _near(period, place, tolerance):
    return abs(period - place) <= tolerance * place


@part(**LEAN)
def _long(period, slips, clusters, beta, limits):
    """Return the regime of a cell with a long period; slips and clusters are counts a period."""
    if slips == 1 or clusters == 1:
        for order in ORDERS:
            if _near(period, limits.period * (1 + order * (1 - beta)), limits.anomaly):
                return ANOMALOUS_LOW_FREQUENCY
    for multiple in MULTIPLES:
        if slips >= 2 and _near(period, limits.period * multiple, limits.anomaly):
            return SUBHARMONIC
    return OTHER_PERIODIC


@part(**LEAN)
def _near_nominal(slips, clusters, corners, corner_clusters, ripple, beta, limits):
    """Return the regime of a cell with a period near the nominal one; the four counts are whole numbers a period."""
    # with one slip a period, no cluster begins where the corners follow each other all round the period
    cluster = corner_clusters == 1 or (corner_clusters == 0 and slips == 1)
    if 3 <= corners < 1 / beta and cluster:  # 1/beta corners would be one for every ripple of a period, no cluster
        return MULTIPLE_FLYBACK if ripple < limits.flyback_ripple else RAMAN_HIGHER
    if slips == 1 and (corners >= 2 or ripple >= limits.s_motion):
        return RAMAN_HIGHER
    if slips >= 2:
        return RAMAN_HIGHER if clusters == 1 and corners == 2 and corner_clusters == 1 else MULTIPLE_SLIP
    return OTHER_PERIODIC


@part(**LEAN)
def _regime(i, features, limits):
    """Return the regime of cell i: the rules in their order of precedence."""
    if features.beat[i] > 0.0:  # first of all: within five periods a wolf looks like one regime after another
        return WOLF
    correlation, period = features.correlation[i], features.period[i]
    slips, corners = features.slips[i], features.corners[i]
    periodic = correlation > limits.correlation  # false for NaN: without an interior maximum there is no period
    if periodic and period < limits.last_lag + 1.0 and slips == limits.periods and corners == limits.periods:
        return HELMHOLTZ_EXTRA_SLIPS if round(features.small_slips[i] / limits.periods) >= 1 else HELMHOLTZ
    if slips == 0 or features.loudness[i] < limits.silence:
        return NO_OSCILLATION
    if not periodic:
        return APERIODIC
    per_period = period / (limits.periods * limits.period)  # turns a count in the window into a count a period
    slips_a_period, clusters_a_period = round(slips * per_period), round(features.slip_clusters[i] * per_period)
    if period >= LONG * limits.period:
        return _long(period, slips_a_period, clusters_a_period, features.beta[i], limits)
    corners_a_period = round(corners * per_period)
    corner_clusters_a_period = round(features.corner_clusters[i] * per_period)
    return _near_nominal(
        slips_a_period, clusters_a_period, corners_a_period, corner_clusters_a_period,
        features.ripple[i], features.beta[i], limits,
    )  # fmt: skip


@part(**LEAN)
def decide_eight(first, number, features, limits, decision, workspace):
    """Write regime, confidence and margins of eight cells to `decision`.

    Parameters
    ----------
    first, number : int
        The first of the cells, and how many they are.
    features : Features
    limits : Limits
    decision : Decision
        Changed in place.
    workspace : Workspace
        Of `bow_classifier.verdict.confidence`.
    """
    regime, confidence, rows = decision
    for i in range(first, first + number):
        regime[i] = _regime(i, features, limits)
    margins(first, number, features, limits, workspace, rows)
    probabilities(first, number, regime, rows, workspace, confidence)
    for i in range(first, first + number):
        if not features.loudness[i] >= 0.0:  # NaN: some samples were not finite
            rows[i] = 0.0
            confidence[i] = 0.0


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
