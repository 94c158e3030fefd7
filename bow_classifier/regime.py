"""The verdict: what the three tests together say of a string, with the thresholds that decide it.

Schumacher & Woodhouse (1995), section III.B, take three tests together; PHYSICS.md section 7 pins them down. The
names beyond Helmholtz motion are those of the literature (PHYSICS.md section 9).
"""

from __future__ import annotations

import dataclasses
import difflib
import functools
import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bow_sim.model import CHUNK_PERIODS, ParameterError, Range

from .sources import source_hash

REGIMES = ("no_oscillation", "helmholtz", "multiple_slip", "multiple_flyback", "other_periodic", "aperiodic")
"""Names of the codes in ``Verdicts.regime``. Codes are in bags: append, never renumber. 255 is kept for "pending"."""

NO_OSCILLATION = 0
"""The bridge force hardly moves: its deviation from its own mean over the window stays below the threshold *silence*.
The string sticks, or slips steadily (PHYSICS.md section 9, "decaying/no oscillation")."""

HELMHOLTZ = 1
"""All three tests pass: periodic, five significant slips and five corners in five periods (section III.B)."""

MULTIPLE_SLIP = 2
"""Periodic, with two or more significant slips a period, to the nearest whole number, and no multiple flyback."""

MULTIPLE_FLYBACK = 3
"""Periodic, three or more corners a period, to the nearest whole number, and one significant slip a period or one
cluster of them: in place of the single flyback there are 3, 5, 7 or more, closely spaced (section IV.A). The string may
stick between them; sticks within a cluster are no longer than the threshold *cluster*."""

OTHER_PERIODIC = 4
"""Periodic and none of the above: Raman's higher types, S-motion, counts at odds at the window's borders."""

APERIODIC = 5
"""Moving, and not periodic within the lags that are searched: raucous motion, long periods, transients."""


def _threshold(default: float, low: float, high: float, unit: str, reason: str) -> Any:
    limits = Range(low, high, True, True)
    return field(default=default, metadata={"unit": unit, "range": limits, "doc": reason})


@dataclass(frozen=True)
class Thresholds:
    """The numbers that decide a verdict, free of the model's units: settings ``classifier.NAME`` of a sweep.

    Each field's ``metadata`` holds ``unit``, ``range`` (a :class:`bow_sim.model.Range`) and the reason as ``doc``.

    Raises
    ------
    ParameterError
        For a value that is no number or out of its range, named ``classifier.NAME``.
    """

    correlation: float = _threshold(
        0.95, -1, 1, "", "least autocorrelation of periodic motion; the trial's start, ripples alone cost 1-3 %"
    )
    slip: float = _threshold(
        0.04, 0, 1, "v_b period", "least integrated slip that counts; 3-5 % passes over the slips of Schelleng ripples"
    )
    corner: float = _threshold(
        0.40, 0, 10, "v_b/beta", "least jump of a corner; 0.35-0.45 keeps the force limit of 11(f) below 11(d), not 0.5"
    )
    lag_first: float = _threshold(
        0.971, 0.2, 1, "period", "shortest lag searched, to the nearest sample: 135 of 139 (sharpening by stiffness)"
    )
    lag_last: float = _threshold(
        1.043, 1, 5, "period", "longest lag searched, to the nearest sample: 145 of 139 (flattening by hysteresis)"
    )
    cluster: float = _threshold(
        1.5,
        0,
        100,
        "beta period",
        "longest stick within a cluster of slips: flybacks follow at the ripple period or less",
    )
    silence: float = _threshold(
        0.02, 0, 1, "v_b/beta", "r.m.s. bridge force of no oscillation; a Helmholtz sawtooth of height 1 has 0.29"
    )

    def __post_init__(self) -> None:
        for name, entry in _fields().items():
            object.__setattr__(self, name, _number(name, getattr(self, name), entry.metadata["range"]))

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, object]) -> Thresholds:
        """Return thresholds by name over those of ``preset`` (one of `THRESHOLD_PRESETS`, "trial" where not given).

        Values may be text.

        Raises
        ------
        ParameterError
            For an unknown name or preset, or a value that cannot be; it names ``classifier.NAME``.
        """
        given = {str(key): value for key, value in mapping.items()}
        preset = given.pop("preset", DEFAULT_PRESET)
        if not isinstance(preset, str) or preset not in THRESHOLD_PRESETS:
            raise ParameterError(f"classifier.preset = {preset!r}: must be one of {', '.join(THRESHOLD_PRESETS)}")
        for key, value in given.items():
            if key not in _fields():
                close = difflib.get_close_matches(key, _fields(), n=1) or list(_fields())
                raise ParameterError(
                    f"classifier.{key} = {value!r}: unknown threshold; there {'is' if len(close) == 1 else 'are'} "
                    + ", ".join(close)
                )
        base = dataclasses.asdict(THRESHOLD_PRESETS[preset])
        return cls(**{**base, **given})  # __post_init__ makes numbers of texts, or refuses

    def settings(self) -> tuple[str, ...]:
        """Return every threshold as sorted "name=value" texts that read back to an equal object, bit for bit."""
        return tuple(f"{name}={getattr(self, name)!r}" for name in sorted(_fields()))

    @functools.cached_property
    def hash(self) -> str:
        """Hash of the thresholds and of the sources that apply them, 16 hexadecimal digits.

        Two classifiers that share it give the same verdicts.
        """
        return hashlib.sha256(json.dumps([self.settings(), source_hash()]).encode()).hexdigest()[:16]

    def lags(self, period: int) -> tuple[int, int]:
        """Return the first and last lag to search, in samples, for a nominal period in samples.

        There is always a lag on either side of the nominal period: a maximum has neighbours.
        """
        return min(round(self.lag_first * period), period - 1), max(round(self.lag_last * period), period + 1)


@functools.cache
def _fields() -> dict[str, dataclasses.Field[Any]]:
    return {entry.name: entry for entry in dataclasses.fields(Thresholds)}


def _number(name: str, value: object, limits: Range) -> float:
    try:
        number = math.nan if isinstance(value, bool) else float(value)  # type: ignore[arg-type]  # what float() takes
    except (TypeError, ValueError):
        number = math.nan
    if not limits.holds(number):
        entry = _fields()[name].metadata
        unit = f", in {entry['unit']}" if entry["unit"] else ""
        raise ParameterError(f"classifier.{name} = {value!r}: must be a number {limits} ({entry['doc']}{unit})")
    return number


DEFAULT_PRESET = "trial"

THRESHOLD_PRESETS: dict[str, Thresholds] = {"trial": Thresholds()}
"""Named sets of thresholds, chosen by ``classifier.preset``: *trial* is that of the trial implementation."""


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
