"""The thresholds of the verdicts.

They are not in :mod:`bow_classifier.verdict.decision`, which applies them, so that planning a sweep need not import
Numba.
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
from typing import Any

from bow_classifier.verdict.fingerprint import source_hash
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import Range


def _threshold(default: float, low: float, high: float, unit: str, reason: str) -> Any:
    limits = Range(low, high, True, True)
    return field(default=default, metadata={"unit": unit, "range": limits, "doc": reason})


@dataclass(frozen=True)
class Thresholds:
    """The thresholds of the verdicts, in units that no model changes: settings ``classifier.NAME`` of a sweep.

    Each field's ``metadata`` holds ``unit``, ``range`` (a
    :class:`bow_sim.physics.parameters.Range`) and the reason as ``doc``.

    Raises
    ------
    ParameterError
        If a value is not a number or out of its range; it names ``classifier.NAME``.
    """

    correlation: float = _threshold(
        0.95, -1, 1, "", "least autocorrelation of periodic motion; the trial's start, ripples alone cost 1-3 %"
    )
    slip: float = _threshold(
        0.10,
        0,
        1,
        "v_b period",
        "least integrated slip that counts; the eye passes over slips of up to 10 % where the sawtooth is intact",
    )
    corner: float = _threshold(
        0.38,
        0,
        10,
        "v_b/beta",
        "least jump of a corner; 0.35-0.45 keeps the force limit of 11(f) below 11(d); at 0.4 S-motion still passes",
    )
    lag_first: float = _threshold(
        0.971, 0.2, 1, "period", "shortest lag searched, to the nearest sample: 135 of 139 (sharpening by stiffness)"
    )
    lag_last: float = _threshold(
        1.043, 1, 5, "period", "longest lag searched, to the nearest sample: 145 of 139 (flattening by hysteresis)"
    )
    lag_long: float = _threshold(
        3.13,
        1.1,
        5,
        "period",
        "longest lag searched where none near the nominal period repeats: three flattened periods",
    )
    cluster: float = _threshold(
        1.5,
        0,
        100,
        "beta period",
        "longest stick within a cluster of slips: flybacks follow at the ripple period or less",
    )
    flyback_cluster: float = _threshold(
        3.0,
        0,
        100,
        "beta period",
        "longest time between two corners of a cluster: sparser ones are Raman's higher types",
    )
    s_motion: float = _threshold(
        0.45, 0, 10, "", "least line of the ripples, over the first two of the period, of S-motion; Helmholtz: 0.1-0.3"
    )
    flyback_ripple: float = _threshold(
        0.66, 0, 10, "", "the same line where there is a flyback cluster: more makes S-motion of it; flybacks: 0.1-0.6"
    )
    anomaly: float = _threshold(
        0.06,
        0,
        0.5,
        "",
        "how far, in parts of it, a long period may lie from N (1 + m (1 - beta)) or from m N: flattening",
    )
    silence: float = _threshold(
        0.02, 0, 1, "v_b/beta", "r.m.s. bridge force of no oscillation; a Helmholtz sawtooth of height 1 has 0.29"
    )
    wolf_share: float = _threshold(
        0.1, 0, 0.5, "", "wolf: least share of periods with exactly one slip, and of the others; our choice"
    )
    wolf_changes: float = _threshold(
        6, 0, 100, "", "wolf: least number of changes between one slip a period and more in 100 periods; our choice"
    )
    wolf_beat: float = _threshold(
        0.7, 0, 1, "", "wolf: least autocorrelation of the r.m.s. bridge force at the beat; wolves of 1983: 0.75-0.89"
    )

    def __post_init__(self) -> None:
        for name, entry in _fields().items():
            object.__setattr__(self, name, _number(name, getattr(self, name), entry.metadata["range"]))

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, object]) -> Thresholds:
        """Return the thresholds of ``preset``, one of `THRESHOLD_PRESETS` ("tuned" unless given), with others by name.

        Values may be text.

        Raises
        ------
        ParameterError
            If a name or the preset is unknown, or a value wrong; it names ``classifier.NAME``.
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
        return cls(**{**base, **given})  # __post_init__ converts and checks

    def settings(self) -> tuple[str, ...]:
        """Return every threshold as sorted "name=value" texts, which `from_mapping` reads back bit for bit."""
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

    def long_lags(self, period: int) -> tuple[int, int]:
        """Return the first and last of the long lags, in samples: they begin where `lags` end."""
        first = self.lags(period)[1] + 1
        return first, max(round(self.lag_long * period), first + 1)


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


DEFAULT_PRESET = "tuned"

THRESHOLD_PRESETS: dict[str, Thresholds] = {
    "tuned": Thresholds(),
    "trial": Thresholds(slip=0.04, corner=0.40),
}
"""Named sets of thresholds, set by ``classifier.preset``: *tuned* on half of the cells labelled by eye
(docs/verdicts.md), *trial* is that of the trial implementation."""
