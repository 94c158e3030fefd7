"""Real strings, bows and rosins by name, and values in SI units (PHYSICS.md sections 10, 12 and 13).

A string has a characteristic impedance ``z_0`` (Z_0, kg/s); a speed of 1 is ``v_unit`` (V, m/s). With these::

    f_asym = force/(2 Z_0 V)      v_b = speed/V      acceleration = bow_acceleration/(f_0 V)      v_mid = v_b - v_0/V

where f_0 is ``sample_rate/period``, and the 2 is y_t. ``beta period`` is ``bow_bridge``, and what is left of it is
``bow_offset``; ``bow_distance`` (mm) is ``beta`` times ``string_length``. A note is ``semitone`` above the open string:
it multiplies ``sample_rate`` by 2^(1/12) each, and divides ``string_length``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics import exact
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.fields import as_number

VIOLIN_TORSION = {"torsion_speed": 2.4, "torsion_admittance": 0.617, "torsion_gain": 0.95}
CELLO_TORSION = {"torsion_speed": 5.5, "torsion_admittance": 0.30, "torsion_gain": 0.94}

STRINGS: dict[str, dict[str, float]] = {
    "violin_g": {"f_0": 196.0, "z_0": 0.350, "string_length": 0.32, "stiffness_b": 1.6e-5, **VIOLIN_TORSION},
    "violin_d": {"f_0": 293.66, "z_0": 0.303, "string_length": 0.32, "stiffness_b": 1.4e-5, **VIOLIN_TORSION},
    "violin_a": {"f_0": 440.0, "z_0": 0.203, "string_length": 0.32, "stiffness_b": 1.3e-5, **VIOLIN_TORSION},
    "violin_e": {"f_0": 659.26, "z_0": 0.173, "string_length": 0.32, "stiffness_b": 4.7e-5, **VIOLIN_TORSION},
    "violin_d_steel": {"f_0": 293.66, "z_0": 0.25, "string_length": 0.325, "stiffness_b": 1.4e-5, **VIOLIN_TORSION},
    "cello_g_at1": {"f_0": 98.0, "z_0": 1.059, "string_length": 0.70, "stiffness_b": 4.2e-5, **CELLO_TORSION},
    "cello_g_a": {"f_0": 98.0, "z_0": 1.090, "string_length": 0.70, "stiffness_b": 4.2e-5, **CELLO_TORSION},
    "cello_g_b": {"f_0": 98.0, "z_0": 1.117, "string_length": 0.70, "stiffness_b": 4.2e-5, **CELLO_TORSION},
    "cello_g_c": {"f_0": 98.0, "z_0": 0.848, "string_length": 0.70, "stiffness_b": 4.2e-5, **CELLO_TORSION},
    "cello_g_d": {"f_0": 98.0, "z_0": 1.119, "string_length": 0.70, "stiffness_b": 4.2e-5, **CELLO_TORSION},
}
"""Strings: fundamental f_0 (Hz), Z_0, length (m), stiffness and torsion. Sources are in PHYSICS.md section 10."""

BRIDGES: dict[str, dict[str, float]] = {
    "surrogate": {"bridge_r": 25.0, "bridge_w_c": 4.0},
    "t60": {"bridge_r": 63.5, "bridge_w_c": 1.4},
    "monochord": {"bridge_r": 100.0, "bridge_w_c": 1.4},
    "rigid": {"bridge_r": 1000.0, "bridge_w_c": 0.0},
}
"""Cremer's spring and dashpot: *surrogate* is calibrated to the Q factors of an open A string, *t60* is fitted to
published decay times (PHYSICS.md section 3); *monochord*, and *rigid* for a body of its own: the string's own losses
(section 10)."""

HAIRS: dict[str, dict[str, float]] = {
    "rigid": {"hair_k": 0.0, "hair_r": 0.0},
    "hair_soft": {"hair_k": 1000.0, "hair_r": 3.0},
    "hair_ribbon": {"hair_k": 1.1e5, "hair_r": 10.0},
}
"""Bow hair: *hair_soft* is fitted to a measured cello string and stands for hair, stick and hand; *hair_ribbon* is
10 mm of ribbon (Pitteroff and Woodhouse; PHYSICS.md section 12)."""

ROSINS: dict[str, dict[str, float]] = {
    "rosin": {"rosin_t_g": 25.0, "mu_s": 1.05},
    "rosin_hard": {"rosin_t_g": 35.0, "mu_s": 1.05},
    "rosin_soft": {"rosin_t_g": 18.0, "mu_s": 1.05},
}
"""Rosins for thermal friction (van Walstijn et al. 2026; PHYSICS.md section 13)."""

WHOLE = 1e-9
"""A round trip this near to a whole number of samples is one."""

PRESETS: dict[str, dict[str, dict[str, float]]] = {
    "string": STRINGS,
    "bridge": BRIDGES,
    "hair": HAIRS,
    "rosin": ROSINS,
}
"""Settings that name a preset, and the presets."""


class Quantity(NamedTuple):
    """A setting in SI units, another way to give one of the paper's.

    Parameters
    ----------
    same : str
        The setting in the paper's units.
    unit, doc : str
    needs : tuple of str
        Settings without which it has no meaning.
    convert : callable
        Returns the value of `same`, from this one and from all settings by name; numbers or arrays.
    back : callable or None
        The inverse of `convert`; None where this is not the usual way to give `same` in SI units.
    relative : bool
        Whether it changes a `same` that may be given too, and may be 0.
    """

    same: str
    unit: str
    doc: str
    needs: tuple[str, ...]
    convert: Callable[[Any, Mapping[str, Any]], Any]
    back: Callable[[Any, Mapping[str, Any]], Any] | None = None
    relative: bool = False


def _higher(semitones: Any) -> Any:
    """Return the ratio of frequencies; each power by itself, rounded alike everywhere."""
    if isinstance(semitones, np.ndarray):
        return np.array([exact.power(2.0, n / 12) for n in semitones.tolist()])
    return exact.power(2.0, semitones / 12)


SI: dict[str, Quantity] = {
    "f_0": Quantity(
        "sample_rate",
        "Hz",
        "frequency of the string",
        (),
        lambda x, p: p["period"] * x,
        lambda x, p: x / p["period"],
    ),
    "semitone": Quantity(
        "sample_rate",
        "semitones",
        "note above the open string",
        (),
        lambda x, p: p["sample_rate"] * _higher(x),
        relative=True,
    ),
    "speed": Quantity(
        "v_b", "m/s", "final bow speed", ("v_unit",), lambda x, p: x / p["v_unit"], lambda x, p: x * p["v_unit"]
    ),
    "force": Quantity(
        "f_asym",
        "N",
        "asymptotic bow force",
        ("z_0", "v_unit"),
        lambda x, p: x / (p["y_t"] * p["z_0"] * p["v_unit"]),
        lambda x, p: x * (p["y_t"] * p["z_0"] * p["v_unit"]),
    ),
    "bow_acceleration": Quantity(
        "acceleration",
        "m/s^2",
        "accelerate_to, guettler: rise of the bow speed",
        ("v_unit",),
        lambda x, p: x / (p["sample_rate"] / p["period"] * p["v_unit"]),
        lambda x, p: x * (p["sample_rate"] / p["period"] * p["v_unit"]),
    ),
    "v_0": Quantity(
        "v_mid",
        "m/s",
        "slip speed where friction is midway",
        ("v_unit",),
        lambda x, p: p["v_b"] - x / p["v_unit"],
        lambda x, p: (p["v_b"] - x) * p["v_unit"],
    ),
    "beta": Quantity(
        "bow_bridge",
        "",
        "distance of the bow from the bridge over length",
        (),
        lambda x, p: x * p["period"],
        lambda x, p: (x + p["bow_offset"]) / p["period"],
    ),
    "bow_distance": Quantity(
        "bow_bridge",
        "mm",
        "distance of the bow from the bridge",
        ("string_length",),
        lambda x, p: x / 1000 / p["string_length"] * p["period"],
    ),
}
"""Settings in SI units by name; those that others need come first."""


ACCELERATED = ("guettler", "accelerate_to")
"""The gestures that have an acceleration."""

NEEDS = {
    "z_0": "string=NAME, or z_0=NUMBER in kg/s",
    "v_unit": "v_unit=NUMBER in m/s",
    "string_length": "string=NAME, or string_length=NUMBER in m",
}
"""What gives the settings that others need."""


def in_si(values: Mapping[str, Any]) -> dict[str, float]:
    """Return settings in SI units, by name, from all settings in the paper's: {} where there are no SI units.

    Those that gesture and friction law use are there; `force` in N, `speed` in m/s and so on, as in :data:`SI`.

    Parameters
    ----------
    values : Mapping
        All parameters by name.
    """
    if not (values["z_0"] and values["v_unit"]):
        return {}
    unused = {"v_0": values["friction"] != "hyperbola", "bow_acceleration": values["gesture"] not in ACCELERATED}
    out = {
        name: float(q.back(values[q.same], values))
        for name, q in SI.items()
        if q.back is not None and not unused.get(name)
    }
    if values["string_length"]:
        out["bow_distance"] = 1000 * out["beta"] * values["string_length"]
    return out


def take_presets(given: dict[str, Any], path: str = "") -> dict[str, Any]:
    """Take the names of presets out of settings; return the values that they stand for, `f_0` left in the settings.

    Thermal friction without a rosin is that of the preset ``rosin``.

    Raises
    ------
    ParameterError
        For a name that there is not.
    """
    if given.get("friction") == "thermal":
        given.setdefault("rosin", "rosin")
    if given.get("gesture") == "constant_acceleration":  # its name until version 1
        given["gesture"] = "accelerate_to"
    values: dict[str, Any] = {}
    for key, presets in PRESETS.items():
        if key not in given:
            continue
        name = given.pop(key)
        if not isinstance(name, str) or name not in presets:
            raise ParameterError(f"{path}{key} = {name!r}: must be one of {', '.join(presets)}")
        values |= presets[name]
    f_0 = values.pop("f_0", None)
    if f_0 is not None and "sample_rate" not in given:
        given.setdefault("f_0", f_0)
    return values


def overridden(preset: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of a preset without those that `given` has in another way, as `v_b` for `speed`."""
    same = {SI[name].same if name in SI else name for name in given}
    return {name: value for name, value in preset.items() if (SI[name].same if name in SI else name) not in same}


def in_paper_units(
    si: Mapping[str, Any], given: Mapping[str, Any], everything: Mapping[str, Any], path: str = ""
) -> dict[str, Any]:
    """Return values in SI units as values of the paper's settings.

    Parameters
    ----------
    si : Mapping
        Values by name, of :data:`SI`.
    given : Mapping
        The settings that were given in the paper's units: a setting may be given in one way only.
    everything : Mapping
        All settings in the paper's units, defaults included.

    Raises
    ------
    ParameterError
        Where a value is no positive number, is given twice, or ``z_0`` or ``v_unit`` is missing.
    """

    def read(name: str, quantity: Quantity) -> tuple[str, Any]:
        number, unit = as_number(si[name]), f" in {quantity.unit}" if quantity.unit else ""
        where = f"{path}{name} = {si[name]!r}"
        if number is None or not _allowed(quantity, number):
            raise ParameterError(f"{where}: must be a number {_least(quantity)}{unit} ({quantity.doc})")
        return where, number

    return _converted(si, given, everything, read, _split)


def lanes_in_paper_units(
    lanes: Mapping[str, NDArray[np.float64]], everything: Mapping[str, Any], path: str = ""
) -> dict[str, NDArray[np.float64]]:
    """Return the values of cells with those in SI units as values of the paper's settings.

    Parameters
    ----------
    lanes : Mapping of str to ndarray, each of shape (cells,)
        Values by the name of a setting.
    everything : Mapping
        What all cells share, in the paper's units.

    Raises
    ------
    ParameterError
        As :func:`in_paper_units`.
    """

    def read(name: str, quantity: Quantity) -> tuple[str, Any]:
        values = np.asarray(lanes[name], np.float64)
        for i in np.flatnonzero(~_allowed(quantity, values))[:1]:
            right = f"must be a number {_least(quantity)} ({quantity.doc})"
            raise ParameterError(f"{path}{name}[{i}] = {float(values[i])!r}: {right}")
        return f"{path}{name}", values

    def split(values: dict[str, Any]) -> dict[str, Any]:
        ((same, column),) = values.items()
        rows = [_split({same: value}) for value in np.asarray(column).tolist()]
        return {key: np.array([row[key] for row in rows], np.float64) for key in rows[0]}

    plain = {name: values for name, values in lanes.items() if name not in SI}
    ways = dict.fromkeys(lanes, "")
    return plain | _converted(ways, dict.fromkeys(plain, ""), {**everything, **plain}, read, split)


def _converted(
    si: Mapping[str, Any],
    given: Mapping[str, Any],
    everything: Mapping[str, Any],
    read: Callable[[str, Quantity], tuple[str, Any]],
    split: Callable[[dict[str, Any]], dict[str, Any]],
) -> dict[str, Any]:
    """Return values in SI units as values of the paper's settings, those that others need first.

    Parameters
    ----------
    si, given, everything : Mapping
        As in :func:`in_paper_units`; where the values differ between cells, only the names of the first two count.
    read : callable
        Returns the checked value of a setting, and how an error names it.
    split : callable
        Takes a setting and its value; a bow position becomes two settings.
    """
    out: dict[str, Any] = {}
    known = dict(everything)
    for name, quantity in SI.items():
        if name not in si:
            continue
        where, value = read(name, quantity)
        if (other := _other_way(name, given, si)) is not None:
            raise ParameterError(f"{where}: {other} is given too; give one of them")
        _check_needs(name, where, known)
        out |= split({quantity.same: quantity.convert(value, known)}) | _stopped(name, value, known)
        known |= out
    return out


def _allowed(quantity: Quantity, value: Any) -> Any:
    """Return whether a value, or each of an array, can be."""
    return value >= 0 if quantity.relative else value > 0


def _least(quantity: Quantity) -> str:
    return ">= 0" if quantity.relative else "> 0"


def _other_way(name: str, given: Mapping[str, Any], si: Mapping[str, Any]) -> str | None:
    """Return another setting that gives the same as this one, if there is one; with its value, if that is known.

    Parameters
    ----------
    given, si : Mapping
        Settings in the paper's and in SI units.
    """
    if SI[name].relative:
        return None
    same = SI[name].same
    if same in given:
        return f"{same} = {given[same]!r}" if given[same] != "" else same
    for other, quantity in SI.items():
        if other in si and other != name and quantity.same == same and not quantity.relative:
            return f"{other} = {si[other]!r}" if si[other] != "" else other
    return None


def _stopped(name: str, value: Any, known: Mapping[str, Any]) -> dict[str, Any]:
    """Return the length of a string that is stopped for a note; {} where it is open or its length is not known."""
    if name != "semitone" or not np.all(known["string_length"]):
        return {}
    return {"string_length": known["string_length"] / _higher(value)}


def _check_needs(name: str, where: str, known: Mapping[str, Any]) -> None:
    for needed in SI[name].needs:
        if not np.all(known[needed]):
            raise ParameterError(f"{where}: needs {NEEDS[needed]}")


def _split(values: dict[str, float]) -> dict[str, float]:
    """Divide the round trip bow-bridge-bow into whole samples and what is left."""
    if "bow_bridge" not in values:
        return values
    delay = values["bow_bridge"]
    near = round(delay)
    if abs(delay - near) < WHOLE:
        return {"bow_bridge": near, "bow_offset": 0.0}
    return {"bow_bridge": math.floor(delay), "bow_offset": delay - math.floor(delay)}
