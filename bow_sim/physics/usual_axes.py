"""Which values a setting takes along an axis of a map, where only its name is given.

The values are those of real strings, bows and players, or those of the paper's figures. A setting in SI units takes
those of the paper's setting that it stands for, converted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from bow_sim.physics import body
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.instruments import NEEDS, SI
from bow_sim.physics.parameters import FIELDS, TYPES, Parameters


class Usual(NamedTuple):
    """The usual axis of a setting.

    Parameters
    ----------
    scale : str
        "log" or "linear".
    first, last : float
        In the unit of the setting, or as factors of `of`.
    why : str
        Reason, or source.
    of : str
        A setting of which `first` and `last` are factors; "" for none.
    """

    scale: str
    first: float
    last: float
    why: str
    of: str = ""

    def __str__(self) -> str:
        times = f" times {self.of}" if self.of else ""
        return f"{self.scale} {self.first:g} ... {self.last:g}{times}; {self.why}"


class Span(NamedTuple):
    """Scale and ends of an axis."""

    scale: str
    first: float
    last: float


USUAL: dict[str, Usual] = {
    "sample_rate": Usual("log", 0.5, 2, "an octave down and up", "sample_rate"),
    "bow_bridge": Usual("linear", 0.036, 0.26, "playable bow positions, as in preset schelleng", "period"),
    "bow_offset": Usual("linear", 0, 0.9, "all of a sample"),
    "y_t": Usual("log", 1, 4, "half and twice the usual 2"),
    "torsion_admittance": Usual("linear", 0.1, 1, "cello strings have 0.3, violin strings 0.6"),
    "torsion_speed": Usual("linear", 2, 4.8, "violin strings have 2.4; more needs a bow farther from the bridge"),
    "torsion_width": Usual("log", 0.7, 2.8, "half and twice the Appendix"),
    "torsion_gain": Usual("linear", 0.8, 1, "from losses of 20 % to none"),
    "torsion_half": Usual("linear", 3, 6, "about the 5 of PHYSICS.md 3"),
    "bridge_r": Usual("log", 5, 200, "from a bridge of great losses to a monochord (PHYSICS.md 10)"),
    "bridge_w_c": Usual("linear", 0, 8, "from rigid to twice the usual 4"),
    "stiffness_b": Usual("log", 1e-6, 3e-4, "from less than the thinnest to more than the stiffest string"),
    "nut_cutoff": Usual("linear", 0.25, 0.75, "about the usual 0.55"),
    "nut_power": Usual("linear", 3, 8, "about the usual 4 and twice of it"),
    "nut_gain": Usual("linear", 0.8, 1, "from losses of 20 % to none"),
    "bridge_gain": Usual("linear", 0.7, 1, "from losses of 30 % to none"),
    "corner_width": Usual("log", 0.5, 4, "a third and three times the usual 1.4"),
    "mu_s": Usual("linear", 0.4, 1.2, "rosins of the literature; above the usual mu_d"),
    "mu_d": Usual("linear", 0.1, 0.35, "rosins of the literature; below all usual mu_s"),
    "v_mid": Usual("linear", -2, 0.9, "from Fig 11(e), (f) to Fig 11(a), (b)"),
    "v_b": Usual("log", 1, 4, "faster bows; slower ones would not be above all usual v_mid"),
    "f_asym": Usual("log", 0.5, 20, "Figs 10 and 11"),
    "f_init_ratio": Usual("linear", 0, 2, "Figs 10 and 11"),
    "sustained": Usual("linear", 0.1, 1.2, "up to above Schelleng's maximum"),
    "tau_f": Usual("log", 50, 5000, "from a third of the usual period to 36 of them"),
    "tau_v": Usual("log", 50, 5000, "from a third of the usual period to 36 of them"),
    "acceleration": Usual("log", 0.005, 1, "full speed after 200 periods ... after one"),
    "z_0": Usual("log", 0.15, 1.2, "violin E to cello G (PHYSICS.md 10)"),
    "string_length": Usual("log", 0.32, 0.7, "violin to cello"),
    "v_unit": Usual("log", 0.03, 0.3, "slow and fast bows"),
    "body_scale": Usual("log", 0.1, 3, "from a heavy body to a light one"),
    "hair_k": Usual("log", 300, 3e5, "beyond the springs of PHYSICS.md 12"),
    "hair_r": Usual("log", 1, 30, "about the dashpots 3 and 10 of PHYSICS.md 12"),
    "rosin_t_g": Usual("linear", 15, 40, "soft to hard rosin (PHYSICS.md 13)"),
    "rosin_hot": Usual("linear", 0.2, 0.6, "half of the usual 0.4 and more"),
    "rosin_heat": Usual("log", 3e-7, 3e-6, "about the 1e-6 of PHYSICS.md 13"),
    "rosin_flow": Usual("linear", 0.1, 0.5, "about the 0.22 of PHYSICS.md 13"),
    "rosin_rest": Usual("log", 3e-5, 3e-4, "about the 1e-4 of PHYSICS.md 13"),
    "ribbon_width": Usual("linear", 0.003, 0.012, "tilted to flat hair"),
    "beta": Usual("log", 0.04, 0.25, "playable bow positions"),
    "bow_distance": Usual("log", 40, 250, "playable bow positions, beta 0.04 ... 0.25", "string_length"),
    "semitone": Usual("linear", 0, 24, "two octaves"),
    "body_f": Usual("log", 0.8, 1.25, "four semitones down and up", "its own"),
    "body_ratio": Usual("log", 0.8, 1.25, "through the note of the string"),
    "body_q": Usual("log", 10, 100, "strongly to weakly damped modes"),
    "body_m": Usual("log", 0.3, 3, "light and heavy modes", "its own"),
    "body_k": Usual("log", 0.3, 3, "heavy and light modes", "its own"),
}
"""The usual axes, by setting; ``body_f`` and so on stand for the settings of single modes, as ``body_1_f``."""


def usual(name: str) -> Usual | None:
    """Return the usual axis of a setting, as it is in the table; None for one in SI units that is converted."""
    if mode := body.mode_setting(name):
        return USUAL[f"body_{mode[1]}"]
    return USUAL.get(name)


def scale_of(name: str) -> str:
    """Return the scale of the usual axis of a sweepable setting."""
    return (usual(name) or USUAL[SI[name].same]).scale


def span(name: str, key: str, p: Parameters, swept: Mapping[str, float]) -> Span:
    """Return scale and ends of the usual axis of a setting.

    Parameters
    ----------
    name : str
        A sweepable setting.
    key : str
        "x" or "y", for errors.
    p : Parameters
        What all cells share.
    swept : Mapping
        A value of the parameter of the other axis, by name, if it is known.

    Raises
    ------
    ParameterError
        Where the range depends on what is not given, as that of ``force`` on ``v_unit``.
    """
    values: dict[str, Any] = {field: getattr(p, field) for field in FIELDS} | dict(swept)
    entry = usual(name)
    if name in SI:
        for needed in SI[name].needs:
            if not values[needed]:
                raise ParameterError(f"{key}.name = {name!r}: needs {NEEDS[needed]}")
    if entry is None:
        quantity = SI[name]
        assert quantity.back is not None  # the table has the others; a test holds this
        same = USUAL[quantity.same]
        factor = values[same.of] if same.of else 1.0
        ends = sorted(float(quantity.back(end * factor, values)) for end in (same.first, same.last))
        return Span(same.scale if ends[0] > 0 else "linear", *map(rounded, ends))
    factor = 1.0
    if entry.of == "its own":
        factor = _own(name, key, p)
    elif entry.of:
        factor = float(values[entry.of])
    if TYPES.get(name) is int:
        return Span(entry.scale, float(round(entry.first * factor)), float(round(entry.last * factor)))
    return Span(entry.scale, rounded(entry.first * factor), rounded(entry.last * factor))


def rounded(value: float) -> float:
    """Return a number with four digits: ends of an axis that can be read."""
    return float(f"{value:.4g}")


def _own(name: str, key: str, p: Parameters) -> float:
    """Return frequency (Hz), mass (kg) or kappa of the mode that a setting changes, as it is without it."""
    number, kind = body.mode_setting(name) or (0, "")
    found = body.modes_of(p)
    if number > len(found):
        has = f"the body has {len(found)} mode{'s'[: len(found) != 1]}"
        raise ParameterError(f"{key}.name = {name!r}: {has}; give its first and last value")
    mode = found[number - 1]
    if kind == "f":
        return mode.f
    kappa = mode.kappa / p.body_scale if p.body_scale else mode.kappa
    if kind == "k":
        return kappa
    if not p.z_0:
        raise ParameterError(f"{key}.name = {name!r}: a mass needs {NEEDS['z_0']}")
    return p.z_0 / (kappa * 2 * math.pi * mode.f)
