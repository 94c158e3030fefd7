"""The parameters of one simulation as flat, typed, serialisable data, and the names of models, gestures and laws.

Command line, presets, messages, ledger and bag all hold a simulation as a :class:`Parameters`. Units are the paper's
(Appendix): the final bow speed is 1, the transverse characteristic admittance is 2, time is counted in samples.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from bow_sim.physics import body, friction_curve, instruments
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.fields import Range, article, as_number, choice, function, number, text
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
    "accelerate_to": "bow speed rises by acceleration per period until v_b; force as exponential",
    "guettler": "bow speed rises by acceleration per period without end; force as exponential (PHYSICS.md 14)",
}
"""Names of the bowing gestures, with descriptions."""

SUSTAINED = ("exponential", "martele")
"""The gestures whose force may begin at a share of Schelleng's maximum."""

FRICTIONS: dict[str, str] = {
    "hyperbola": "rectangular hyperbola in slip speed, with the hysteresis rule (III.C, Appendix)",
    "coulomb": "mu_s on the point of sticking, mu_d sliding; sticks whenever it can (PHYSICS.md 13)",
    "thermal": "falls with the temperature of the rosin, needs z_0 and v_unit (PHYSICS.md 13)",
    "curve": "a curve of your own, straight between its points: friction_curve (PHYSICS.md 13)",
}
"""Names of the friction laws, with descriptions."""

DTYPES = ("float64", "float32")


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

    model: str = choice("stiff_cremer", MODELS, "sections II.B, III.A", "model of the string")
    sample_rate: float = number(61160.0, 1000, 1e7, "Hz", "Appendix", "samples per second")
    period: int = number(139, 8, 4096, "samples", "Appendix", "nominal period of the string")
    bow_bridge: int = number(15, 1, 4095, "samples", "Appendix", "round trip bow-bridge-bow; beta = bow_bridge/period")
    bow_offset: float = number(
        0.0, 0, 1, "samples", "PHYSICS.md 10", "what the round trip bow-bridge-bow has beyond bow_bridge", "[)"
    )
    y_t: float = number(2.0, 0, 1000, "1/impedance", "Appendix", "transverse characteristic admittance", "(]")
    torsion_admittance: float = number(0.617, 0, 10, "y_t", "Appendix", "torsional over transverse admittance")
    torsion_speed: float = number(2.4, 1, 20, "", "Appendix", "torsional over transverse wave speed")
    torsion_width: float = number(1.4, 0.1, 20, "samples", "Appendix", "tau of the Gaussian exp(-(t/tau)^2)")
    torsion_gain: float = number(0.95, 0, 1, "", "Appendix", "minus the sum of a torsional reflection function")
    torsion_half: int = number(5, 1, 64, "samples", "PHYSICS.md 3", "half the length of a torsional reflection")
    bridge_r: float = number(25.0, 1, 1e6, "1/y_t", "PHYSICS.md 3", "Cremer's dashpot at the bridge", "(]")
    bridge_w_c: float = number(4.0, 0, 1000, "w_1", "PHYSICS.md 3", "corner K/R of Cremer's bridge, w_1 = 2 pi/period")
    stiffness_b: float = number(5e-5, 0, 0.1, "", "PHYSICS.md 3", "bending stiffness B: f_n = n f_1 sqrt(1 + B n^2)")
    nut_cutoff: float = number(0.55, 0.01, 4, "pi rad/sample", "PHYSICS.md 3", "corner of the anti-alias filter")
    nut_power: float = number(4.0, 1, 64, "", "PHYSICS.md 3", "power of the anti-alias filter")
    nut_gain: float = number(0.98, 0, 1, "", "section II.B", "Raman: minus the reflection coefficient at the nut")
    bridge_gain: float = number(0.9, 0, 1, "", "section II.B", "Raman: minus the reflection coefficient at the bridge")
    corner_width: float = number(1.4, 0.1, 20, "samples", "section II.B", "rounded corner: tau of the Gaussians")
    bridge_function: str = function("at the bridge")
    nut_function: str = function("at the nut")
    torsion_bridge_function: str = function("of torsional waves at the bridge")
    torsion_nut_function: str = function("of torsional waves at the nut")
    friction: str = choice("hyperbola", FRICTIONS, "section III.C", "law of friction between bow and string")
    friction_curve: str = text(
        "PHYSICS.md 13", "curve: points s/mu, s/mu, ...; slip speed s from 0 on, in m/s with v_unit, else in bow speeds"
    )
    mu_s: float = number(0.8, 0, 100, "", "Appendix", "friction coefficient on the point of sticking", "(]")
    mu_d: float = number(0.3, 0, 100, "", "Appendix", "friction coefficient at high slip speed")
    v_mid: float = number(0.2, -1e6, 1e6, "v_b", "Appendix", "string speed where mu is midway; below v_b")
    v_b: float = number(1.0, 0, 1e6, "bow speed", "Appendix", "final bow speed", "(]")
    gesture: str = choice("exponential", GESTURES, "sections II.A, III.C", "how force and speed of the bow start")
    f_asym: float = number(5.5, 0, 1e6, "v_b impedance", "section III.C", "asymptotic bow force", "(]", "log")
    f_init_ratio: float = number(1.0, 0, 1e3, "f_asym", "section III.C", "initial bow force f_init/f_asym")
    sustained: float = number(
        0.0, 0, 10, "F_max", "PHYSICS.md 14", "initial bow force over Schelleng's maximum; 0: f_init_ratio counts"
    )
    tau_f: float = number(400.0, 0, 1e9, "samples", "Appendix", "time constant of the bow force", "(]")
    tau_v: float = number(400.0, 0, 1e9, "samples", "section II.A", "martele: time constant of the bow speed", "(]")
    acceleration: float = number(
        0.2, 0, 1e6, "v_b/period", "Guettler 2002", "accelerate_to, guettler: rise of the bow speed", "(]", "log"
    )
    z_0: float = number(0.0, 0, 1000, "kg/s", "PHYSICS.md 10", "characteristic impedance of the string; 0: not given")
    string_length: float = number(0.0, 0, 100, "m", "PHYSICS.md 10", "length of the string; 0: not given")
    v_unit: float = number(0.0, 0, 1000, "m/s", "PHYSICS.md 10", "what a speed of 1 is; 0: not given")
    body: str = choice("none", body.SETS, "PHYSICS.md 11", "modes of the body at the bridge, by name")
    body_modes: str = text(
        "PHYSICS.md 11", "modes of a body of your own: f/Q/m, f/Q/m, ... in Hz and kg, or k0.01 for m"
    )
    body_changes: str = text(
        "PHYSICS.md 11", "single modes of the body that differ: body_1_f=440 body_2_q=30 ..., settings of their own"
    )
    body_scale: float = number(1.0, 0, 1000, "", "PHYSICS.md 11", "factor on the mobility of all modes of the body")
    hair_k: float = number(0.0, 0, 1e12, "N/m", "PHYSICS.md 12", "spring of the bow hair")
    hair_r: float = number(0.0, 0, 1e12, "kg/s", "PHYSICS.md 12", "dashpot of the bow hair; 0: a rigid bow")
    rosin_t_g: float = number(25.0, 0, 1000, "K", "PHYSICS.md 13", "thermal: where friction has fallen halfway", "(]")
    rosin_hot: float = number(0.4, 0, 1, "mu_s", "PHYSICS.md 13", "thermal: friction coefficient of hot rosin")
    rosin_heat: float = number(1e-6, 0, 1, "m/K", "PHYSICS.md 13", "thermal: a_T, heat capacity", "(]")
    rosin_flow: float = number(
        0.22, 0, 1000, "W^(1/2)/(m^(1/2) K)", "PHYSICS.md 13", "thermal: b_T, heat taken away by sliding"
    )
    rosin_rest: float = number(1e-4, 0, 1, "m/(s K)", "PHYSICS.md 13", "thermal: c_T, heat lost always", "(]")
    ribbon_width: float = number(0.01, 0, 1, "m", "PHYSICS.md 13", "thermal: width of the ribbon of hair", "(]")
    periods: int = number(100, 5, 1_000_000, "periods", "section IV.A", "length of the simulation")
    dtype: str = choice("float64", DTYPES, "PHYSICS.md 8", "arithmetic of the simulation")

    def __post_init__(self) -> None:
        for name in FIELDS:
            object.__setattr__(self, name, coerce(name, getattr(self, name)))
        if self.friction == "curve" and self.friction_curve:
            curve = friction_curve.parse(self.friction_curve)
            object.__setattr__(self, "mu_s", float(curve.mu[0]))
            object.__setattr__(self, "mu_d", float(curve.mu[-1]))
        self._check_together()

    def _check_together(self, path: str = "") -> None:
        if self.friction != "curve":
            check_friction(self.mu_s, self.mu_d, self.v_mid, self.v_b, path)
        if self.bow_bridge + self.bow_offset > self.period - 1:
            raise ParameterError(
                f"{path}bow_bridge = {self.bridge_delay:g}: must be less than period = {self.period}: "
                "the bow is on the string"
            )
        if self.periods % CHUNK_PERIODS:
            near = max(CHUNK_PERIODS, round(self.periods / CHUNK_PERIODS) * CHUNK_PERIODS)
            raise ParameterError(
                f"{path}periods = {self.periods}: must be a multiple of {CHUNK_PERIODS}, for instance {near}"
            )
        if self.sustained:
            self._check_sustained(path)
        for name in FUNCTIONS:
            function_text = getattr(self, name)
            if function_text:
                if name.startswith("torsion") and not self.has_torsion:
                    raise ParameterError(f"{path}{name}: must be empty: {self.model} has no torsional reflections")
                check(parse(function_text, path + name), path + name, self.sample_rate)
        friction_curve.check(self.friction, self.friction_curve, path)
        self._check_instrument(path)

    def _check_sustained(self, path: str) -> None:
        where = f"{path}sustained = {self.sustained:g}"
        if self.f_init_ratio != FIELDS["f_init_ratio"].default:
            raise ParameterError(f"{where}: f_init_ratio = {self.f_init_ratio:g} is given too; give one of them")
        if self.gesture not in SUSTAINED:
            right = f"gesture must be {' or '.join(SUSTAINED)}, for which Schelleng's maximum has a bow speed"
            raise ParameterError(f"{where}: gesture = {self.gesture!r}: {right}")

    def _check_instrument(self, path: str) -> None:
        """Check what needs SI units."""
        missing = "z_0" if not self.z_0 else "v_unit"
        right = "string=NAME, or z_0=NUMBER in kg/s" if missing == "z_0" else "v_unit=NUMBER in m/s"
        if self.friction == "thermal":
            if not (self.z_0 and self.v_unit):
                raise ParameterError(f"{path}friction = 'thermal': needs SI units, and there is no {missing}: {right}")
            if self.dtype != "float64":
                raise ParameterError(
                    f"{path}dtype = {self.dtype!r}: thermal friction needs float64: its steps are small"
                )
        if self.hair_r and not self.z_0:
            raise ParameterError(f"{path}hair_r = {self.hair_r!r}: needs SI units, and there is no z_0: {right}")
        if self.body_modes and self.body != "none":
            raise ParameterError(f"{path}body_modes: must be empty with body = {self.body!r}; give one of them")
        try:
            body.modes_of(self)
        except ParameterError as error:
            raise ParameterError(f"{path}{error}") from None

    @property
    def has_torsion(self) -> bool:
        """Whether torsional waves return to the bow."""
        return self.model in TORSION_REFLECTED

    @property
    def beta(self) -> float:
        """Distance of the bow from the bridge, as a fraction of the string's length."""
        return self.bridge_delay / self.period

    @property
    def bridge_delay(self) -> float:
        """Round trip bow-bridge-bow, samples; a whole number where ``bow_offset`` is 0."""
        return self.bow_bridge + self.bow_offset

    @property
    def nut_delay(self) -> float:
        """Round trip bow-nut-bow of an ideal string, samples."""
        return self.period - self.bow_bridge - self.bow_offset

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
            Values by field name; numbers may be text. Extra keys name a preset, or give a value in SI units:
            :mod:`bow_sim.physics.instruments` has both.
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
        values: dict[str, Any] = instruments.take_presets(given, path)
        si = {key: given.pop(key) for key in instruments.SI & given.keys()}
        single = {key: given.pop(key) for key in list(given) if body.mode_setting(key)}
        for key, value in given.items():
            if key not in FIELDS:
                raise ParameterError(f"{path}{key} = {value!r}: unknown parameter{_nearest(key)}")
            values[key] = coerce(key, value, path)
        if single:
            values["body_changes"] = body.changed(values.get("body_changes", base.body_changes), single, path)
        everything = {name: getattr(base, name) for name in FIELDS} | values
        _check_beta(si, everything["period"], path)
        values |= instruments.in_paper_units(si, values, everything, path)
        try:
            made = dataclasses.replace(base, **values)
        except ParameterError as error:
            raise ParameterError(f"{path}{error}") from None
        for name in {"mu_s", "mu_d"} & given.keys():
            if getattr(made, name) != values[name]:
                is_ = f"is {getattr(made, name):g} by friction_curve: leave it out"
                raise ParameterError(f"{path}{name} = {given[name]!r}: {is_}")
        return made

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


def is_sweepable(name: str) -> bool:
    """Return whether a setting may differ between cells: a number, in the paper's units or SI, or one of a mode."""
    return name in SWEEPABLE or name in instruments.SI or body.mode_setting(name) is not None


SWEEPABLE_NAMES = ", ".join([*sorted(SWEEPABLE | instruments.SI.keys()), *(f"body_1_{kind}" for kind in body.KINDS)])
"""The names for which :func:`is_sweepable` holds, for error messages; ``body_2_f`` and so on too."""


def coerce(name: str, value: object, path: str = "") -> Any:
    """Return a value converted to the type of its field.

    Raises
    ------
    ParameterError
        If the value has the wrong type, is NaN, out of range, or none of the choices.
    """
    meta = FIELDS[name].metadata
    kind = TYPES[name]
    if "choices" in meta:
        if isinstance(value, str) and value in meta["choices"]:
            return value
        right = f"must be one of {', '.join(meta['choices'])}"
    elif kind is str:
        if isinstance(value, str) and not value.startswith("@"):
            return value
        right = f"must be text ({meta['doc']})"
        if isinstance(value, str):
            right = (
                "must be the text itself; only the command line reads files "
                "(bow_sim.physics.reflection_text.embed_files)"
            )
    else:
        limits: Range = meta["range"]
        number = as_number(value)
        if number is not None and limits.holds(number) and (kind is float or number == int(number)):
            return kind(number)
        unit = f", in {meta['unit']}" if meta["unit"] else ""
        right = f"must be {article(kind)} {limits} ({meta['doc']}{unit})"
    raise ParameterError(f"{path}{name} = {value!r}: {right}")


@functools.lru_cache(maxsize=64)
def _nearest(key: str) -> str:
    import difflib

    known = [*FIELDS, *instruments.SI, *instruments.PRESETS, *(f"body_1_{kind}" for kind in body.KINDS)]
    close = difflib.get_close_matches(key, known, n=1)
    return f"; did you mean {close[0]}?" if close else f"; the parameters are {', '.join(sorted(FIELDS))}"


def parse_settings(settings: Iterable[str], path: str = "") -> dict[str, str]:
    """Return ``name=value`` texts as a mapping of texts; the last of a name counts."""
    mapping: dict[str, str] = {}
    for setting in settings:
        name, separator, value = setting.partition("=")
        if not separator or not name.strip():
            raise ParameterError(f"{path}{setting!r}: must have the form name=value")
        mapping[name.strip()] = value.strip()
    return mapping


def _check_beta(si: Mapping[str, object], period: int, path: str) -> None:
    """Raise ParameterError, in the words of the user, for a bow that is not on the string."""
    beta = as_number(si.get("beta"))
    if beta is not None and beta > 0 and not 1 <= round(beta * period, 9) <= period - 1:
        raise ParameterError(
            f"{path}beta = {beta:g}: must be {1 / period:.4g} ... {1 - 1 / period:.4g}: the bow is on the string, and "
            f"at least a sample of period = {period} from its ends"
        )


def check_friction(mu_s: float, mu_d: float, v_mid: float, v_b: float, path: str = "") -> None:
    """Raise ParameterError if the friction curve does not fall with slip speed (Appendix)."""
    if not mu_d < mu_s:
        raise ParameterError(f"{path}mu_d = {mu_d!r}: must be less than mu_s = {mu_s!r}")
    if not v_mid < v_b:
        raise ParameterError(f"{path}v_mid = {v_mid!r}: must be less than v_b = {v_b!r}")
