"""Modes of the violin body at the bridge (PHYSICS.md section 11).

The driving-point admittance of the bridge is Cremer's, in series with resonators::

    Y = Y_Cremer + sum_k s/(m_k (s**2 + s w_k/Q_k + w_k**2))

Only the ratio to the string matters, ``kappa_k = Z_0/(m_k w_k)``. Each resonator becomes a filter of second order by
the bilinear transform, exact at its own frequency. The reflection is passive for all positive f, Q and kappa.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics import exact
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.fields import Range, as_number
from bow_sim.physics.number_files import COMMENTS, number, read_file, table

STOPPANI = (
    "273.8/43.1/1.327792, 280.2/45.4/2.964635, 390.4/48.9/4.783186, 408.0/26.8/1.376636, 436.4/24.2/0.326922, "
    "451.8/26.6/0.118541, 464.6/23.4/0.242474, 534.2/23.0/0.035866, 591.2/11.7/0.2297, 656.2/24.0/0.741882, "
    "668.4/16.3/1.238272, 741.8/28.6/2.172429, 753.8/28.0/0.695702, 771.0/23.4/3.539366, 800.8/21.5/1.50234, "
    "839.3/27.9/0.554107, 847.0/27.7/0.72315, 903.9/25.4/1.269251, 925.5/28.6/0.841771, 1009.3/23.2/0.0466, "
    "1069.4/43.7/0.161447, 1130.0/70.3/0.364971, 1141.9/47.2/0.23366, 1181.1/29.8/0.639764, 1246.4/69.1/0.362411, "
    "1265.0/80.0/1.218971, 1296.3/79.7/1.762591, 1393.6/31.5/0.05524, 1480.9/18.2/0.026298, 1552.5/41.9/0.099885, "
    "1623.6/49.2/0.775085, 1705.5/31.9/0.097038, 1754.6/43.4/0.046873, 1776.5/55.1/0.162698, "
    "1857.3/48.9/0.142808, 1931.5/21.9/0.020967, 2015.8/29.7/0.057187, 2072.4/57.1/0.124582, "
    "2094.0/80.0/0.240151, 2217.5/14.1/0.025237, 2356.5/18.2/0.005813, 2543.9/79.8/0.071192, "
    "2582.4/46.6/0.043924, 2663.9/55.2/0.056525, 2743.7/25.5/0.015059, 2817.9/35.5/0.04376, 2947.9/22.7/0.031728, "
    "3108.3/30.3/0.024181, 3141.8/44.5/0.03229, 3210.5/19.7/0.236633, 3305.2/46.5/0.058138, 3417.5/30.1/0.056983, "
    "3490.3/31.8/0.036636, 3661.7/46.6/0.021511, 3713.3/37.3/0.030715, 3850.9/59.5/0.061424, 3907.1/38.1/0.08878, "
    "4033.4/31.7/0.022316, 4116.2/43.1/0.040779, 4158.5/53.1/0.091535, 4346.6/22.4/0.018807, 4540.7/32.4/0.05664, "
    "4887.1/33.7/0.11691, 4896.4/8.9/0.019769, 5236.9/48.1/0.048959, 5453.2/28.5/0.042776, 5698.2/14.8/0.04675, "
    "6175.7/20.6/0.275042, 6376.6/20.9/0.076363, 6540.3/37.6/0.324694, 6695.9/18.2/0.057046, "
    "7076.7/43.1/0.252464, 7156.7/48.4/0.213332, 7298.4/47.2/0.106294, 7424.3/76.8/1.098507, 8050.5/19.8/0.05641"
)
"""Modes fitted to the measured bridge admittance of a violin (CNSM violin, Zenodo 18696786, CC BY 4.0)."""

SIGNATURE = "272/40/1.33, 407/27/1.38, 462/27/0.12, 551/23/0.036"
"""A0, CBR, B1- and B1+ (Woodhouse, Euphonics 5.3); Q and masses borrowed from `STOPPANI`."""

SETS: dict[str, str] = {
    "none": "",
    "wolf_83": "64/65 of f_0/30/k0.01",
    "stoppani": STOPPANI,
    "signature": SIGNATURE,
}
"""Sets of modes by name; *wolf_83* is that of McIntyre, Schumacher and Woodhouse 1983, Figs 14 and 15."""

LEFT_OUT = 0.45
"""Modes above this share of the sample rate are left out."""

MOST = 1000
"""Modes, at most."""

KINDS: dict[str, tuple[str, str]] = {
    "f": ("Hz", "frequency"),
    "ratio": ("", "frequency over that of the string"),
    "q": ("", "Q factor"),
    "m": ("kg", "mass"),
    "k": ("", "kappa"),
}
"""What a setting of a single mode may be, ``body_1_f`` and so on: unit and meaning. *ratio* is another way to give *f*,
and *k* another way to give *m*."""

MODE_RANGE = Range(0.0, math.inf, low_open=True)
"""The values of a setting of a single mode."""

_SAME_AS = {"ratio": "f", "k": "m"}
MODE_SETTING = re.compile(rf"body_([1-9][0-9]{{0,3}})_({'|'.join(KINDS)})")
"""The names of these settings: number and kind."""


class Mode(NamedTuple):
    """A mode: frequency (Hz), Q factor, and mobility ``Z_0/(m w)``."""

    f: float
    q: float
    kappa: float


class Resonators(NamedTuple):
    """Filters of modes, arrays of shape (modes,): see PHYSICS.md section 11."""

    b0: NDArray[np.float64]
    a1: NDArray[np.float64]
    a2: NDArray[np.float64]


def mode_setting(name: str) -> tuple[int, str] | None:
    """Return number and kind of a setting of a single mode, ``body_1_f`` and so on; None for another name."""
    found = MODE_SETTING.fullmatch(name)
    return (int(found[1]), found[2]) if found else None


def mode_unit(name: str) -> tuple[str, str] | None:
    """Return unit and meaning of a setting of a single mode; None for another name."""
    found = mode_setting(name)
    return (KINDS[found[1]][0], f"{KINDS[found[1]][1]} of mode {found[0]}") if found else None


def changed(changes: str, given: Mapping[str, object], path: str = "") -> str:
    """Return the text of changes of single modes with some more of them.

    Parameters
    ----------
    changes : str
        As this function returns it, ``body_1_f=440.0 body_2_q=30.0``.
    given : Mapping
        Values by the names of settings of single modes; they take the place of what the text has.

    Raises
    ------
    ParameterError
        Where a value is no positive number, or one thing is given in two ways.
    """
    values = {slot(name): (name, value) for name, value in _changes(changes, path)}
    before: dict[tuple[int, str], str] = {}
    for name, value in given.items():
        own = as_number(value)
        if own is None or not MODE_RANGE.holds(own):
            unit, what = mode_unit(name) or ("", "")
            raise ParameterError(
                f"{path}{name} = {value!r}: must be a number > 0{f' in {unit}' if unit else ''} ({what})"
            )
        if slot(name) in before:
            raise ParameterError(f"{path}{name} = {value!r}: {before[slot(name)]} is given too; give one of them")
        before[slot(name)] = name
        values[slot(name)] = (name, own)
    return " ".join(f"{name}={value!r}" for _, (name, value) in sorted(values.items()))


def slot(name: str) -> tuple[int, str]:
    """Return the mode and the property that a setting changes: the same for a frequency and its ratio."""
    number_, kind = mode_setting(name) or (0, "")
    return number_, _SAME_AS.get(kind, kind)


def _changes(text: str, path: str) -> Iterator[tuple[str, float]]:
    for word in text.split():
        name, _, value = word.partition("=")
        if mode_setting(name) is None:
            raise ParameterError(
                f"{path}body_changes: {word!r}: must be body_NUMBER_KIND=VALUE, with one of {', '.join(KINDS)}"
            )
        yield name, _positive(value, f"{path}body_changes: {name}")


@functools.lru_cache(maxsize=4096)
def modes(
    name: str,
    text: str,
    sample_rate: float,
    period: int,
    z_0: float,
    scale: float = 1.0,
    path: str = "",
    changes: str = "",
) -> tuple[Mode, ...]:
    """Return the modes of a body that take part, by the name of a set or from a text.

    Parameters
    ----------
    name : str
        One of :data:`SETS`.
    text : str
        Modes of one's own, ``f/Q/m`` separated by commas or white space: Hz, and kg; ``k0.01`` in place of m is kappa.
    sample_rate : float
        Hz.
    period : int
        Of the string, samples.
    z_0 : float
        Characteristic impedance of the string, kg/s; 0 if it is not known.
    scale : float
        Factor on all kappa.
    changes : str
        Single modes that differ, as :func:`changed` returns them.

    Raises
    ------
    ParameterError
        Naming the mode that cannot be, and what would be right.
    """
    found = _listed(name, text, sample_rate, period, z_0, path, changes)
    limit = LEFT_OUT * sample_rate
    return tuple(mode._replace(kappa=mode.kappa * scale) for mode in found if mode.f <= limit)


def modes_of(p: Any) -> tuple[Mode, ...]:
    """Return the modes of the body of `Parameters` that take part, with all changes of single modes."""
    return modes(
        p.body, p.body_modes, p.sample_rate, p.period, p.z_0, p.body_scale, changes=p.body_changes
    )  # one order of arguments: it is the key of the cache


def left_out(p: Any) -> int:
    """Return how many modes of the body of `Parameters` lie too high to take part."""
    return len(_listed(p.body, p.body_modes, p.sample_rate, p.period, p.z_0, "", p.body_changes)) - len(modes_of(p))


def _listed(
    name: str, text: str, sample_rate: float, period: int, z_0: float, path: str, changes: str
) -> tuple[Mode, ...]:
    """Return all modes of a body, also those that are too high to take part, without the factor on all kappa."""
    own = bool(text)
    where = f"{path}body_modes" if own else f"{path}body = {name!r}"
    words = (text or SETS[name]).replace(",", " ").split() if name != "wolf_83" else ["64/65 of f_0/30/k0.01"]
    if len(words) > MOST:
        raise ParameterError(f"{where}: {len(words)} modes: must be at most {MOST}")
    other = _numbered(changes, len(words), path)
    found = []
    for place, word in enumerate(words, 1):
        mine = other.get(place, {})
        if name == "wolf_83":
            f, q, kappa, mass = 64 / 65 * sample_rate / period, 30.0, 0.01, 0.0
        else:
            f, q, kappa, mass = _read(word, where)
        if "m" in mine or "k" in mine:
            mass, kappa = mine.get("m", 0.0), mine.get("k", 0.0)
        f, q = mine.get("f", mine.get("ratio", 0.0) * sample_rate / period) or f, mine.get("q", q)
        if not f < sample_rate / 2 and (own or mine.keys() & {"f", "ratio"}):
            what = f"{path}body_{place}_f = {f:g}" if mine.keys() & {"f", "ratio"} else f"{where}: {word!r}"
            raise ParameterError(f"{what}: f must be less than half the sample rate, {sample_rate / 2:g} Hz")
        if mass:
            if not z_0:
                raise ParameterError(f"{where}: {word!r}: a mass needs string=NAME, or z_0=NUMBER in kg/s")
            kappa = z_0 / (mass * 2 * math.pi * f)
        found.append(Mode(f, q, kappa))
    return tuple(found)


def _read(word: str, where: str) -> tuple[float, float, float, float]:
    """Return f, Q, kappa and m of a mode as text; the one of the last two that is not given is 0."""
    parts = word.split("/")
    if len(parts) != 3:
        raise ParameterError(f"{where}: {word!r}: must be f/Q/m, in Hz and kg, or f/Q/k with kappa, as 440/30/k0.01")
    f, q = _positive(parts[0], f"{where}: {word!r}: f"), _positive(parts[1], f"{where}: {word!r}: Q")
    if parts[2].startswith("k"):
        return f, q, _positive(parts[2][1:], f"{where}: {word!r}: kappa"), 0.0
    return f, q, 0.0, _positive(parts[2], f"{where}: {word!r}: m")


def _numbered(changes: str, count: int, path: str) -> dict[int, dict[str, float]]:
    """Return the changes of each mode, by its number."""
    found: dict[int, dict[str, float]] = {}
    for name, value in _changes(changes, path):
        place, kind = mode_setting(name) or (0, "")
        if place > count:
            has = f"the body has {count} mode{'s'[: count != 1]}, body_1_{kind} ... body_{count}_{kind}"
            none = "there is no body: body=NAME, or body_modes=f/Q/m, ..."
            raise ParameterError(f"{path}{name} = {value!r}: {has if count else none}")
        found.setdefault(place, {})[kind] = value
    return found


def read_modes(path: str | Path) -> str:
    """Return the modes in a file as text: a mode in each line, either as in :func:`modes`, or f, Q and m in columns.

    Raises
    ------
    ParameterError
        If the file cannot be read, or a line is neither.
    """
    text = read_file(path)
    bare = COMMENTS.sub("", text)
    if "/" in bare:
        return ", ".join(bare.replace(",", " ").split())
    return table(path, text, 3, "f in Hz, Q, and m in kg")


def _positive(word: str, what: str) -> float:
    try:
        value = number(word)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise ParameterError(f"{what} = {word!r}: must be a number > 0")
    return value


def resonators(found: tuple[Mode, ...], sample_rate: float) -> Resonators:
    """Return the filters of modes: the bilinear transform, exact at the frequency of each."""
    f, q, kappa = np.array(found).T if found else np.empty((3, 0))
    w = 2 * np.pi * f / sample_rate
    c = w / np.array([exact.tan(x) for x in (w / 2).tolist()])
    d = c * c + c * w / q + w * w
    return Resonators(kappa * w * c / d, 2 * (w * w - c * c) / d, (c * c - c * w / q + w * w) / d)
