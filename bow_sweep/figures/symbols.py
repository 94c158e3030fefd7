r"""Mathematical symbols and units of all parameters, for axes and captions, in the paper's units and in SI.

A symbol is TeX without dollar signs, of the part of TeX that Matplotlib has too: ``f_\mathrm{asym}``. A unit is text
with TeX between dollar signs: ``m s$^{-2}$``. So both can be set by Matplotlib and by LaTeX; :func:`plain` writes them
as text.

The paper's unit of force is ``y_t Z_0`` times the unit of speed, with Z_0 the characteristic impedance of the string:
``2 Z_0 v_b`` with the usual v_b = 1 and Y_T = 2 (docs/PHYSICS.md, section 10).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from bow_sim.physics.body import mode_setting
from bow_sim.physics.instruments import SI
from bow_sim.physics.kinds import THRESHOLD
from bow_sim.physics.parameters import FIELDS


class Symbol(NamedTuple):
    """How a parameter is written.

    Attributes
    ----------
    tex
        Its symbol, TeX without dollar signs.
    words
        What it is, in few words.
    unit
        Text with TeX between dollar signs; "" for a number.
    """

    tex: str
    words: str
    unit: str = ""


_TABLE: dict[str, Symbol] = {
    # the string
    "sample_rate": Symbol("f_s", "sampling rate", "Hz"),
    "period": Symbol("N", "period of the string", "samples"),
    "f_0": Symbol("f_0", "frequency of the string", "Hz"),
    "semitone": Symbol("n", "note above the open string", "semitones"),
    "y_t": Symbol("Y_T", "characteristic admittance"),
    "z_0": Symbol("Z_0", "characteristic impedance", "kg/s"),
    "string_length": Symbol("L", "length of the string", "m"),
    "stiffness_b": Symbol("B", "bending stiffness"),
    "torsion_admittance": Symbol("Y_R/Y_T", "torsional over transverse admittance"),
    "torsion_speed": Symbol("c_R/c_T", "torsional over transverse wave speed"),
    "torsion_width": Symbol(r"\tau_R", "width of torsional reflections", "samples"),
    "torsion_gain": Symbol("g_R", "torsional reflection"),
    "torsion_half": Symbol("n_R", "half length of torsional reflections", "samples"),
    "nut_cutoff": Symbol(r"\omega_a", "corner of the filter at the nut", r"$\pi$ rad/sample"),
    "nut_power": Symbol("p_a", "power of the filter at the nut"),
    "nut_gain": Symbol(r"r_\mathrm{nut}", "reflection at the nut"),
    "bridge_gain": Symbol(r"r_\mathrm{bridge}", "reflection at the bridge"),
    "corner_width": Symbol(r"\tau_c", "width of the reflections", "samples"),
    # bridge and body
    "bridge_r": Symbol("R", "dashpot of the bridge", "$Z_0$"),
    "bridge_w_c": Symbol(r"\omega_c", "corner of the bridge", r"$\omega_1$"),
    "body_scale": Symbol(r"s_\mathrm{body}", "mobility of the body"),
    # the bow
    "bow_bridge": Symbol(r"\beta N", "distance bow to bridge", "samples"),
    "bow_offset": Symbol(r"\delta", "distance bow to bridge beyond whole samples", "samples"),
    "beta": Symbol(r"\beta", "distance bow to bridge over length"),
    "bow_distance": Symbol("x_b", "distance bow to bridge", "mm"),
    "f_asym": Symbol(r"f_\mathrm{asym}", "asymptotic bow force"),
    "force": Symbol("F", "bow force", "N"),
    "f_init_ratio": Symbol(r"f_\mathrm{init}/f_\mathrm{asym}", "initial over asymptotic bow force"),
    "sustained": Symbol(r"f_\mathrm{init}/F_\mathrm{max}", "initial bow force over Schelleng's maximum"),
    "tau_f": Symbol(r"\tau_f", "time constant of the bow force", "samples"),
    "v_b": Symbol("v_b", "bow speed"),
    "speed": Symbol("v_b", "bow speed", "m/s"),
    "v_unit": Symbol("V", "unit of speed", "m/s"),
    "tau_v": Symbol(r"\tau_v", "time constant of the bow speed", "samples"),
    "acceleration": Symbol("a", "acceleration of the bow"),
    "bow_acceleration": Symbol("a", "acceleration of the bow", "m/s$^2$"),
    "hair_k": Symbol("k_h", "spring of the bow hair", "N/m"),
    "hair_r": Symbol("R_h", "dashpot of the bow hair", "kg/s"),
    "ribbon_width": Symbol("W", "width of the ribbon of hair", "m"),
    # friction
    "mu_s": Symbol(r"\mu_s", "friction coefficient on the point of sticking"),
    "mu_d": Symbol(r"\mu_d", "friction coefficient at high slip speed"),
    "v_mid": Symbol(r"v_\mathrm{mid}", "string speed where friction is midway"),
    "v_0": Symbol("v_0", "slip speed where friction is midway", "m/s"),
    "rosin_t_g": Symbol("T_g", "temperature where friction has fallen halfway", "K"),
    "rosin_hot": Symbol("y", "friction of hot rosin", r"$\mu_s$"),
    "rosin_heat": Symbol("a_T", "heat capacity of the contact", "m/K"),
    "rosin_flow": Symbol("b_T", "heat taken away by sliding", "W$^{1/2}$ m$^{-1/2}$ K$^{-1}$"),
    "rosin_rest": Symbol("c_T", "heat lost always", "m s$^{-1}$ K$^{-1}$"),
    "periods": Symbol("n", "length of the simulation", "periods"),
    "model": Symbol("", "model of the string"),
}

_MODES: dict[str, tuple[str, str, str]] = {
    "f": ("f_{b%d}", "frequency of body mode %d", "Hz"),
    "ratio": ("f_{b%d}/f_0", "frequency of body mode %d over that of the string", ""),
    "q": ("Q_{b%d}", "Q factor of body mode %d", ""),
    "m": ("m_{b%d}", "mass of body mode %d", "kg"),
    "k": (r"\kappa_{b%d}", "mobility of body mode %d", ""),
}
"""Symbol, meaning and unit of the settings of a single mode of the body, with a place for its number."""

_LIMITS = {
    "schelleng_max": r"F_\mathrm{max}",
    "schelleng_min": r"F_\mathrm{min}",
    "guettler_low": r"a_\mathrm{low}",
    "guettler_high": r"a_\mathrm{high}",
}
"""Limits of theory (:mod:`bow_sweep.maps.limits`) to their symbols."""

DASHED = ("schelleng_min", "guettler_high")
"""Limits whose lines are broken, so that two of them are told apart without their labels."""

GREEK = {
    "beta": "β", "delta": "δ", "kappa": "κ", "mu": "µ", "omega": "ω", "pi": "π", "tau": "τ", "Delta": "Δ",
    "times": "×", "geq": "≥", "max": "max", "min": "min",
}  # fmt: skip
"""Commands of TeX to letters, for plain text."""


def symbol_of(name: str, settings: Mapping[str, str] | Iterable[str] = (), moving: Iterable[str] = ()) -> Symbol:
    r"""Return symbol, words and unit of a parameter, in the paper's units or in SI by its name.

    Parameters
    ----------
    name
        Of a parameter (`bow settings`), of a setting in SI units, or of a mode of the body. An unknown name is its own
        symbol.
    settings
        Of the sweep, by name or as "name=value": the units of force and acceleration depend on them.
    moving
        Names of the parameters that differ between cells.

    Examples
    --------
    >>> symbol_of("f_asym")
    Symbol(tex='f_\\mathrm{asym}', words='asymptotic bow force', unit='$2 Z_0 v_b$')
    >>> symbol_of("bow_acceleration").unit
    'm/s$^2$'
    """
    given = dict(settings) if isinstance(settings, Mapping) else dict(line.partition("=")[::2] for line in settings)
    known = _TABLE.get(name) or _of_mode(name) or _unknown(name)
    return known._replace(unit=unit) if (unit := _depending(name, given, set(moving))) else known


def _of_mode(name: str) -> Symbol | None:
    found = mode_setting(name)
    if not found:
        return None
    tex, words, unit = _MODES[found[1]]
    return Symbol(tex % found[0], words % found[0], unit)


def _unknown(name: str) -> Symbol:
    words, unit = (SI[name].doc, SI[name].unit) if name in SI else ("", "")
    if name.startswith(THRESHOLD):
        name, words = name.removeprefix(THRESHOLD), "threshold of the classifier:"
    if name in FIELDS:
        about = FIELDS[name].metadata
        words, unit = str(about["doc"]).partition(";")[0].rpartition(": ")[2], str(about.get("unit", ""))
    return Symbol(r"\mathrm{" + re.sub(r"[_. ]+", r"\\ ", name) + "}", words, unit)


def _depending(name: str, given: Mapping[str, str], moving: set[str]) -> str:
    """Return the unit of a parameter that is counted in the speed of the bow, or in speed and impedance."""
    speed = speed_unit(given, moving)
    if name == "v_mid":
        return f"${speed}$"
    if name == "acceleration":
        return f"${speed}/T$"
    if name == "f_asym":
        admittance = "Y_T" if "y_t" in moving else _short(given.get("y_t", "2"))
        return f"${admittance} Z_0 {speed}$"
    return "$V$" if name == "v_b" and speed == "V" else ""


def speed_unit(given: Mapping[str, str], moving: Iterable[str] = ()) -> str:
    """Return the symbol of the unit of speed: that of the bow speed where it is 1 and the bow has one, else V."""
    fixed = not {"v_b", "speed"} & set(moving) and _short(given.get("v_b", "1")) == "1"
    return "v_b" if fixed and given.get("gesture") != "guettler" else "V"


def _short(number: str) -> str:
    try:
        return f"{float(number):g}"
    except ValueError:
        return number


def limit_symbol(name: str) -> str:
    """Return the symbol of a limit of theory by its name in ``map.npz``; TeX without dollar signs."""
    return _LIMITS.get(name, name.replace("_", r"\ "))


def label(symbol: Symbol, words: bool = False) -> str:
    """Return the title of an axis for Matplotlib: symbol and unit, and before them the words if asked for."""
    unit = f" ({symbol.unit})" if symbol.unit else ""
    if not symbol.tex:
        return symbol.words
    return f"{symbol.words} ${symbol.tex}${unit}".lstrip() if words else f"${symbol.tex}${unit}"


def plain(text: str) -> str:
    r"""Return text with TeX between dollar signs as plain text.

    Examples
    --------
    >>> plain(r"$f_\mathrm{asym}$ ($2 Z_0 v_b$)")
    'f_asym (2 Z_0 v_b)'
    """
    return re.sub(r"\$([^$]*)\$", lambda found: _plain_mathematics(found[1]), text)


_POWERS = str.maketrans("0123456789-/", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻ᐟ")


def _plain_mathematics(tex: str) -> str:
    text = re.sub(r"\\math[a-z]+\{([^{}]*)\}", r"\1", tex)
    text = re.sub(r"\^(?:\{([^{}]*)\}|(.))", lambda found: (found[1] or found[2]).translate(_POWERS), text)
    text = re.sub(r"\\([A-Za-z]+)(?:\s+(?=[A-Za-z]))?", lambda found: GREEK.get(found[1], found[1]), text)
    return re.sub(r"[{}]", "", text.replace("\\ ", " ").replace("\\", ""))
