"""The parameters of one simulation as flat, typed, serialisable data, and the names of models, gestures and laws.

Command line, presets, messages, ledger and bag all hold a simulation as a :class:`Parameters`. Units are the paper's
(Appendix): the final bow speed is 1, the transverse characteristic admittance is 2, time is counted in samples.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from bow_sim.physics.errors import ParameterError
from bow_sim.physics.reflection_text import FUNCTIONS, check, parse

CHUNK_PERIODS = 5
"""Periods in a chunk: the paper tests every five periods (section IV.A)."""

MODELS: dict[str, str] = {
    "friedlander": "rigid ends, unit delta reflections, no torsion (section II.B, Friedlander 1953)",
    "raman": "delta reflections with a coefficient below 1, no torsion (section II.B, Raman 1918)",
    "rounded_corner": "narrow Gaussian reflections, no torsion (section II.B)",
    "torsion_absorbed": "as delta_cremer, but torsional waves never come back: the friction curve is sheared (II.B)",
    "delta_cremer": "Cremer's spring and dashpot at the bridge, unit delta at the nut, torsion (III.A)",
    "stiff_cremer": "as delta_cremer, with the dispersion of a stiff string on the long side (III.A)",
}
"""Names of the models of sections II.B and III.A, with descriptions."""

TORSION_REFLECTED = ("delta_cremer", "stiff_cremer")
"""The models in which torsional waves come back."""

GESTURES: dict[str, str] = {
    "exponential": "bow force from f_init to f_asym with time constant tau_f, bow speed constant (III.C)",
    "martele": "bow force as exponential while bow speed rises from 0 to v_b with time constant tau_v (II.A)",
    "string_crossing": "bow already moving at v_b, force rising from 0 to f_asym with time constant tau_f (II.A)",
    "constant_acceleration": "bow speed rises by acceleration per period until v_b; force as exponential (Guettler)",
}
"""Names of the bowing gestures, with descriptions."""

FRICTIONS: dict[str, str] = {
    "hyperbola": "rectangular hyperbola in slip speed, with the hysteresis rule (III.C, Appendix)"
}
"""Names of the friction laws, with descriptions."""

DTYPES = ("float64", "float32")

BRIDGES: dict[str, dict[str, float]] = {
    "surrogate": {"bridge_r": 25.0, "bridge_w_c": 4.0},
    "t60": {"bridge_r": 63.5, "bridge_w_c": 1.4},
}
"""Named values of Cremer's spring and dashpot, set by ``bridge=NAME``: *surrogate* is calibrated to the Q factors of an
open A string, *t60* is fitted to published decay times (PHYSICS.md section 3)."""


class Range(NamedTuple):
    """The values that a number may have; an open end is not allowed itself."""

    low: float
    high: float
    low_open: bool = False
    high_open: bool = False

    def holds(self, value: float) -> bool:
        """Return whether the value lies in the range; NaN does not."""
        above = value > self.low if self.low_open else value >= self.low
        below = value < self.high if self.high_open else value <= self.high
        return above and below

    def __str__(self) -> str:
        low = f"> {self.low:g}" if self.low_open else f">= {self.low:g}"
        high = f"< {self.high:g}" if self.high_open else f"<= {self.high:g}"
        return f"{low} and {high}"


def _number(
    default: float, low: float, high: float, unit: str, source: str, doc: str, ends: str = "[]", scale: str = "linear"
) -> Any:
    """Return a field with a range; ``ends`` is one of ``[] () (] [)`` as in mathematics."""
    limits = Range(low, high, ends[0] == "(", ends[1] == ")")
    return field(
        default=default, metadata={"doc": doc, "unit": unit, "source": source, "range": limits, "scale": scale}
    )


def _function(side: str) -> Any:
    """Return a field for a reflection function as text; see :func:`bow_sim.physics.reflection_text.parse`."""
    doc = f"reflection function {side} in place of the model's own, as text; empty for the model's own"
    return field(default="", metadata={"doc": doc, "unit": "", "source": "section II.B"})


def _choice(default: str, choices: Iterable[str], source: str, doc: str) -> Any:
    return field(default=default, metadata={"doc": doc, "unit": "", "source": source, "choices": tuple(choices)})


@dataclass(frozen=True)
class Parameters:
    """All parameters that decide the waveforms of one cell.

    Each field's ``metadata`` holds ``doc``, ``unit``, ``source`` and either ``range`` (a
    :class:`Range`) or ``choices``.

    Raises
    ------
    ParameterError
        If a value is out of its range, of the wrong type, NaN, or contradicts another one.
    """

    model: str = _choice("stiff_cremer", MODELS, "sections II.B, III.A", "model of the string")
    sample_rate: float = _number(61160.0, 1000, 1e7, "Hz", "Appendix", "samples per second")
    period: int = _number(139, 8, 4096, "samples", "Appendix", "nominal period of the string")
    bow_bridge: int = _number(15, 1, 4095, "samples", "Appendix", "round trip bow-bridge-bow; beta = bow_bridge/period")
    y_t: float = _number(2.0, 0, 1000, "1/impedance", "Appendix", "transverse characteristic admittance", "(]")
    torsion_admittance: float = _number(0.617, 0, 10, "y_t", "Appendix", "torsional over transverse admittance")
    torsion_speed: float = _number(2.4, 1, 20, "", "Appendix", "torsional over transverse wave speed")
    torsion_width: float = _number(1.4, 0.1, 20, "samples", "Appendix", "tau of the Gaussian exp(-(t/tau)^2)")
    torsion_gain: float = _number(0.95, 0, 1, "", "Appendix", "minus the sum of a torsional reflection function")
    torsion_half: int = _number(5, 1, 64, "samples", "PHYSICS.md 3", "half the length of a torsional reflection")
    bridge_r: float = _number(25.0, 1, 1e6, "1/y_t", "PHYSICS.md 3", "Cremer's dashpot at the bridge", "(]")
    bridge_w_c: float = _number(4.0, 0, 1000, "w_1", "PHYSICS.md 3", "corner K/R of Cremer's bridge, w_1 = 2 pi/period")
    stiffness_b: float = _number(5e-5, 0, 0.1, "", "PHYSICS.md 3", "bending stiffness B: f_n = n f_1 sqrt(1 + B n^2)")
    nut_cutoff: float = _number(0.55, 0.01, 4, "pi rad/sample", "PHYSICS.md 3", "corner of the anti-alias filter")
    nut_power: float = _number(4.0, 1, 64, "", "PHYSICS.md 3", "power of the anti-alias filter")
    nut_gain: float = _number(0.98, 0, 1, "", "section II.B", "Raman: minus the reflection coefficient at the nut")
    bridge_gain: float = _number(0.9, 0, 1, "", "section II.B", "Raman: minus the reflection coefficient at the bridge")
    corner_width: float = _number(1.4, 0.1, 20, "samples", "section II.B", "rounded corner: tau of the Gaussians")
    bridge_function: str = _function("at the bridge")
    nut_function: str = _function("at the nut")
    torsion_bridge_function: str = _function("of torsional waves at the bridge")
    torsion_nut_function: str = _function("of torsional waves at the nut")
    friction: str = _choice("hyperbola", FRICTIONS, "section III.C", "law of friction between bow and string")
    mu_s: float = _number(0.8, 0, 100, "", "Appendix", "friction coefficient on the point of sticking", "(]")
    mu_d: float = _number(0.3, 0, 100, "", "Appendix", "friction coefficient at high slip speed")
    v_mid: float = _number(0.2, -1e6, 1e6, "v_b", "Appendix", "string speed where mu is midway; below v_b")
    v_b: float = _number(1.0, 0, 1e6, "bow speed", "Appendix", "final bow speed", "(]")
    gesture: str = _choice("exponential", GESTURES, "sections II.A, III.C", "how force and speed of the bow start")
    f_asym: float = _number(5.5, 0, 1e6, "v_b impedance", "section III.C", "asymptotic bow force", "(]", "log")
    f_init_ratio: float = _number(1.0, 0, 1e3, "f_asym", "section III.C", "initial bow force f_init/f_asym")
    tau_f: float = _number(400.0, 0, 1e9, "samples", "Appendix", "time constant of the bow force", "(]")
    tau_v: float = _number(400.0, 0, 1e9, "samples", "section II.A", "martele: time constant of the bow speed", "(]")
    acceleration: float = _number(
        0.2, 0, 1e6, "v_b/period", "Guettler 2002", "constant_acceleration: rise of the bow speed", "(]", "log"
    )
    periods: int = _number(100, 5, 1_000_000, "periods", "section IV.A", "length of the simulation")
    dtype: str = _choice("float64", DTYPES, "PHYSICS.md 8", "arithmetic of the simulation")

    def __post_init__(self) -> None:
        for name in FIELDS:
            object.__setattr__(self, name, coerce(name, getattr(self, name)))
        self._check_together()

    def _check_together(self, path: str = "") -> None:
        check_friction(self.mu_s, self.mu_d, self.v_mid, self.v_b, path)
        if self.bow_bridge >= self.period:
            raise ParameterError(
                f"{path}bow_bridge = {self.bow_bridge}: must be less than period = {self.period}: "
                "the bow is on the string"
            )
        if self.periods % CHUNK_PERIODS:
            near = max(CHUNK_PERIODS, round(self.periods / CHUNK_PERIODS) * CHUNK_PERIODS)
            raise ParameterError(
                f"{path}periods = {self.periods}: must be a multiple of {CHUNK_PERIODS}, for instance {near}"
            )
        for name in FUNCTIONS:
            text = getattr(self, name)
            if text:
                if name.startswith("torsion") and not self.has_torsion:
                    raise ParameterError(f"{path}{name}: must be empty: {self.model} has no torsional reflections")
                check(parse(text, path + name), path + name, self.sample_rate)

    @property
    def has_torsion(self) -> bool:
        """Whether torsional waves return to the bow."""
        return self.model in TORSION_REFLECTED

    @property
    def beta(self) -> float:
        """Distance of the bow from the bridge, as a fraction of the string's length."""
        return self.bow_bridge / self.period

    @property
    def nut_lag(self) -> int:
        """Round trip bow-nut-bow of an ideal string, samples."""
        return self.period - self.bow_bridge

    @property
    def chunk_samples(self) -> int:
        """Samples of a chunk: five nominal periods."""
        return CHUNK_PERIODS * self.period

    @property
    def chunks(self) -> int:
        """Chunks of the whole simulation."""
        return self.periods // CHUNK_PERIODS

    @property
    def samples(self) -> int:
        """Samples of the whole simulation."""
        return self.periods * self.period

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, object], path: str = "") -> Parameters:
        """Return parameters by name, for instance from YAML; the others have their defaults.

        Parameters
        ----------
        mapping : Mapping[str, object]
            Values by field name; numbers may be text. The extra key ``bridge`` names one of :data:`BRIDGES`.
        path : str
            Where the mapping comes from, written before each key in error messages, for instance ``"fig11d.yaml: "``.
        """
        return cls._from(cls(), mapping, path)

    @classmethod
    def from_settings(cls, settings: Iterable[str], path: str = "") -> Parameters:
        """Return parameters from ``name=value`` texts, as :meth:`settings` writes them; the last of a name counts."""
        return cls.from_mapping(parse_settings(settings, path), path)

    @staticmethod
    def _from(base: Parameters, mapping: Mapping[str, object], path: str) -> Parameters:
        given = {str(key): value for key, value in mapping.items()}
        values: dict[str, Any] = {}
        if "bridge" in given:
            values.update(_bridge(given.pop("bridge"), path))
        for key, value in given.items():
            if key not in FIELDS:
                raise ParameterError(f"{path}{key} = {value!r}: unknown parameter{_nearest(key)}")
            values[key] = coerce(key, value, path)
        try:
            return dataclasses.replace(base, **values)
        except ParameterError as error:
            raise ParameterError(f"{path}{error}") from None

    def settings(self) -> tuple[str, ...]:
        """Return every parameter as ``name=value``, sorted; :meth:`from_settings` reads them back bit for bit."""
        texts = []
        for name in sorted(FIELDS):
            value = getattr(self, name)
            texts.append(f"{name}={value!r}" if isinstance(value, float) else f"{name}={value}")
        return tuple(texts)

    def replace(self, **changes: object) -> Parameters:
        """Return a copy with some parameters changed, checked like a new one."""
        return self._from(self, changes, "")


FIELDS: dict[str, dataclasses.Field[Any]] = {f.name: f for f in dataclasses.fields(Parameters)}
"""The fields of :class:`Parameters` by name."""


def _types() -> dict[str, type]:
    kinds: dict[str, type] = {"str": str, "int": int, "float": float}
    return {name: kinds[str(f.type)] for name, f in FIELDS.items()}


TYPES: dict[str, type] = _types()
"""The type of each field: str, int or float."""

FLOATS: frozenset[str] = frozenset(name for name, kind in TYPES.items() if kind is float)
"""The fields that are real numbers."""

SWEEPABLE: frozenset[str] = FLOATS | {"bow_bridge", "torsion_half"}
"""The fields that may differ between the cells of a sweep: all numbers but those that set its length."""


def coerce(name: str, value: object, path: str = "") -> Any:
    """Return a value converted to the type of its field.

    Raises
    ------
    ParameterError
        If the value has the wrong type, is NaN, out of range, or none of the choices.
    """
    meta = FIELDS[name].metadata
    where = f"{path}{name} = {value!r}"
    if "choices" in meta:
        if not isinstance(value, str) or value not in meta["choices"]:
            raise ParameterError(f"{where}: must be one of {', '.join(meta['choices'])}")
        return value
    if TYPES[name] is str:
        if not isinstance(value, str):
            raise ParameterError(f"{where}: must be text ({meta['doc']})")
        if value.startswith("@"):
            raise ParameterError(
                f"{where}: must be the reflection function itself; only the command line reads files "
                "(bow_sim.physics.reflection_text.embed_files)"
            )
        return value
    limits: Range = meta["range"]
    right = f"must be {_article(TYPES[name])} {limits} ({meta['doc']}" + (
        f", in {meta['unit']})" if meta["unit"] else ")"
    )
    number = _as_number(value)
    if number is None or not limits.holds(number):
        raise ParameterError(f"{where}: {right}")
    if TYPES[name] is int:
        if number != int(number):
            raise ParameterError(f"{where}: {right}")
        return int(number)
    return float(number)


def _as_number(value: object) -> float | None:
    """Return a value, or its text, as a finite number; None if it is not one."""
    if isinstance(value, (bool, bytes)):
        return None
    try:
        number = float(value)  # type: ignore[arg-type]  # whatever float() takes, NumPy scalars too
    except (TypeError, ValueError):
        return None
    return number if math.isfinite(number) else None


def _article(kind: type) -> str:
    return "a whole number" if kind is int else "a number"


def _bridge(name: object, path: str) -> dict[str, float]:
    if not isinstance(name, str) or name not in BRIDGES:
        raise ParameterError(f"{path}bridge = {name!r}: must be one of {', '.join(BRIDGES)}")
    return BRIDGES[name]


@functools.lru_cache(maxsize=64)
def _nearest(key: str) -> str:
    import difflib

    close = difflib.get_close_matches(key, FIELDS, n=1)
    return f"; did you mean {close[0]}?" if close else f"; the parameters are {', '.join(sorted(FIELDS))}"


def parse_settings(settings: Iterable[str], path: str = "") -> dict[str, str]:
    """Return ``name=value`` texts as a mapping of texts; the last of a name counts."""
    mapping: dict[str, str] = {}
    for text in settings:
        name, separator, value = text.partition("=")
        if not separator or not name.strip():
            raise ParameterError(f"{path}{text!r}: must have the form name=value")
        mapping[name.strip()] = value.strip()
    return mapping


def check_friction(mu_s: float, mu_d: float, v_mid: float, v_b: float, path: str = "") -> None:
    """Raise ParameterError if the friction curve does not fall with slip speed (Appendix)."""
    if not mu_d < mu_s:
        raise ParameterError(f"{path}mu_d = {mu_d!r}: must be less than mu_s = {mu_s!r}")
    if not v_mid < v_b:
        raise ParameterError(f"{path}v_mid = {v_mid!r}: must be less than v_b = {v_b!r}")
