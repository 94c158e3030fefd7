"""The regimes of a bowed string: code, name, definition and source of each.

The names are those of the literature (PHYSICS.md section 9). :mod:`bow_classifier.features` measures what the
definitions compare; :mod:`bow_classifier.verdict.decision` applies them in their order of precedence.

A new regime needs, in this file, a `Definition` at the end of `DEFINITIONS`, a constant with its code, and a rule in
:func:`count` if a number belongs to its name; then a rule in :mod:`bow_classifier.verdict.decision` and a row of
coefficients in :mod:`bow_classifier.verdict.confidence`. CONTRIBUTING.md has the whole recipe.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bow_sim.physics.parameters import CHUNK_PERIODS


class Definition(NamedTuple):
    """One regime: its `name`, what it `means` in terms of the features, and the `source` of both."""

    name: str
    means: str
    source: str


DEFINITIONS = (
    Definition(
        "no_oscillation",
        "The string and the bow don't alternate: no significant slip ends in the five periods (the string sticks, or "
        "slides, throughout, and what it still does is free vibration that decays or has only begun to grow), or the "
        "bridge force hardly moves: its r.m.s. deviation stays below the threshold *silence*.",
        "PHYSICS.md section 9, decaying/no oscillation: slipping without periodic energy",
    ),
    Definition(
        "helmholtz",
        "All three tests pass: periodic near the nominal period, five significant slips and five travelling corners in "
        "five nominal periods, and no other slip.",
        "Schumacher & Woodhouse, section III.B; PHYSICS.md section 7",
    ),
    Definition(
        "multiple_slip",
        "Periodic near the nominal period, with two or more significant slips a period, to the nearest whole number, "
        "and no multiple flyback.",
        "section III.B, test 2; PHYSICS.md section 9",
    ),
    Definition(
        "multiple_flyback",
        "Periodic near the nominal period; in place of the single flyback a cluster of 3, 5, 7 or more, closely "
        "spaced: three or more corners a period in one cluster (none further apart than *flyback_cluster*), fewer "
        "than the 1/beta ripples that would fill the period, and no S-motion. The string may stick between them.",
        "section IV.A",
    ),
    Definition(
        "other_periodic",
        "Periodic, and none of the other names fits: counts at odds, at the borders of a window or while one regime "
        "gives way to another. The honest remainder.",
        "",
    ),
    Definition(
        "aperiodic",
        "Moving, and no lag up to three nominal periods brings it back: raucous motion, transients.",
        "section III.B; PHYSICS.md section 9, raucous",
    ),
    Definition(
        "helmholtz_extra_slips",
        "Helmholtz motion, all three tests passed, in which further slips end that stay below the threshold *slip*. "
        "It counts as Helmholtz motion everywhere.",
        'section III.B: "almost Helmholtz, but with very brief slips during the nominal sticking phase"',
    ),
    Definition(
        "raman_higher",
        "Periodic near the nominal period, one significant slip a period (or one cluster), and neither a single "
        "sawtooth nor a flyback cluster: two corners a period, or more that are spread over it, or S-motion: the "
        "strongest harmonic around 1/beta at least *s_motion* (with a flyback cluster, *flyback_ripple*) times the "
        "stronger of the first two. S-motion is Helmholtz motion whose Schelleng ripples have grown to the size of the "
        "sawtooth; it may have a second slip beside the first.",
        "Raman's higher types, section III.B; S-motion, PHYSICS.md section 9 (there: strongest line above 2 f_0)",
    ),
    Definition(
        "anomalous_low_frequency",
        "Periodic, but only near N (1 + m (1 - beta)), m = 1, 2: the corner passes the bow m times without releasing "
        "the string; one significant slip, or one cluster, in each long period. The order is m.",
        "PHYSICS.md section 9",
    ),
    Definition(
        "subharmonic",
        "Repeats after m = 2 or 3 nominal periods only, each of which has its slips. The order is m.",
        "PHYSICS.md section 9; section III.B on periods not known in advance",
    ),
    Definition(
        "wolf",
        "A beat between string and body: in the last 100 periods (of 150 or more since the start) the share of periods "
        "with exactly one significant slip is between *wolf_share* and 1 - *wolf_share*, it changes between one and "
        "more at least *wolf_changes* times, and the r.m.s. bridge force comes back after some periods, the beat, with "
        "an autocorrelation above *wolf_beat*; the beat is longer than *lag_long*. One of more than 29 periods is "
        "hardly ever found. This name comes before all others.",
        "McIntyre, Schumacher & Woodhouse 1983, Fig 14; PHYSICS.md section 11",
    ),
)
"""Definitions by code. Bags contain the codes: append, never renumber. 255 is reserved for "pending"."""

REGIMES = tuple(definition.name for definition in DEFINITIONS)
"""Names of the codes in ``Verdicts.regime``."""

NO_OSCILLATION = 0
HELMHOLTZ = 1
MULTIPLE_SLIP = 2
MULTIPLE_FLYBACK = 3
OTHER_PERIODIC = 4
APERIODIC = 5
HELMHOLTZ_EXTRA_SLIPS = 6
RAMAN_HIGHER = 7
ANOMALOUS_LOW_FREQUENCY = 8
SUBHARMONIC = 9
WOLF = 10


def is_helmholtz(regime: ArrayLike) -> NDArray[np.bool_]:
    """Return where a regime is Helmholtz motion, with or without insignificant extra slips: all three tests passed.

    Parameters
    ----------
    regime
        (...) codes.
    """
    regime = np.asarray(regime)
    return np.asarray((regime == HELMHOLTZ) | (regime == HELMHOLTZ_EXTRA_SLIPS))


def count(
    regime: ArrayLike, period: ArrayLike, slips: ArrayLike, corners: ArrayLike, nominal: float, beta: ArrayLike
) -> NDArray[np.uint8]:
    """Return the number that belongs to a regime's name, from the published fields of verdicts.

    Multiple slip: slips a period. Multiple flyback and Raman's higher types: corners a period. Subharmonic and
    anomalous low frequency: the order m. Helmholtz motion, with extra slips or without: 1. The others: 0.

    Parameters
    ----------
    regime, period, slips, corners
        (...) fields of verdicts; period in samples, counts in a window of five nominal periods.
    nominal
        Nominal period N, samples.
    beta
        Bow position, one or (...).
    """
    regime, period = np.asarray(regime), np.asarray(period, np.float64)
    turns = np.nan_to_num(period / (CHUNK_PERIODS * nominal))  # of the window in one actual period
    order = np.nan_to_num(period / nominal)
    rules = {
        HELMHOLTZ: np.ones(regime.shape),
        HELMHOLTZ_EXTRA_SLIPS: np.ones(regime.shape),
        MULTIPLE_SLIP: np.asarray(slips) * turns,
        MULTIPLE_FLYBACK: np.asarray(corners) * turns,
        RAMAN_HIGHER: np.asarray(corners) * turns,
        SUBHARMONIC: order,
        ANOMALOUS_LOW_FREQUENCY: (order - 1.0) / (1.0 - np.asarray(beta, np.float64)),
    }
    result = np.zeros(np.broadcast_shapes(regime.shape, period.shape), np.float64)
    for code, number in rules.items():
        result = np.where(regime == code, number, result)
    return np.clip(np.round(result), 0, 255).astype(np.uint8)
