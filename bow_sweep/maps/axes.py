"""An axis of a map in a picture: positions of cells and ticks, and its title.

Positions are in cells, all of one size; :mod:`bow_sweep.figures.panel` draws uneven ones otherwise. Where the values
have neither equal steps nor equal ratios, as those of ``x.values``, the ticks are the values themselves, and a position
between two cells is interpolated between theirs.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bow_sim.physics.body import mode_unit
from bow_sim.physics.instruments import SI, Quantity
from bow_sim.physics.kinds import MODEL, THRESHOLD, model_name
from bow_sim.physics.parameters import FIELDS

TITLES = {
    "f_asym": "asymptotic bow force",
    "f_init_ratio": "initial / asymptotic bow force",
    "v_mid": "string speed where friction is midway",
    "tau_f": "time constant of the bow force",
    "tau_v": "time constant of the bow speed",
    "acceleration": "rise of the bow speed",
    "bow_bridge": "round trip from bow to bridge",
    "stiffness_b": "bending stiffness",
    "torsion_width": "width of torsional reflections",
    "corner_width": "width of the reflections",
    "bridge_w_c": "corner of Cremer's bridge K/R",
    "bow_acceleration": "acceleration of the bow",
    "beta": "position of the bow over length",
}
"""Titles of axes; other parameters have the first words of their own description as title."""

PLAIN_SYMBOLS = {"f_init_ratio": "f_init / f_asym"}
"""Symbols in plain text, where they differ from the name of the parameter."""


MOST_TICKS = 12
"""Largest number of labelled ticks where each value has a tick of its own."""


class Tick(NamedTuple):
    """A mark on an axis, at a position in cells; `text` is empty for a minor tick."""

    position: float
    text: str


@dataclass(frozen=True, eq=False)
class PlotAxis:
    """One axis of a map in a picture. Positions are in cells: cell i is from i to i + 1, its value at i + 1/2.

    Attributes
    ----------
    name
        Name of the parameter.
    values
        (cells,) rising or falling, in the parameter's unit.
    scale
        "log", "linear", or "values" for values with neither equal ratios nor equal steps.
    """

    name: str
    values: np.ndarray
    scale: str

    @classmethod
    def of(cls, name: str, values: np.ndarray) -> PlotAxis:
        """Return the axis of `values`; its scale follows from them.

        Raises
        ------
        ValueError
            Where there are no values, or they are not finite or do not rise or fall throughout.
        """
        values = np.asarray(values, float)
        steps = np.diff(values)
        if values.ndim != 1 or not values.size or not np.isfinite(values).all():
            raise ValueError(f"axis {name}: should be one or more finite numbers, is {values!r}")
        if not ((steps > 0).all() or (steps < 0).all()):
            raise ValueError(f"axis {name}: its values should rise or fall throughout")
        if name == MODEL:
            return cls(name, values, "values")
        if _is_geometric(name, values):
            return cls(name, values, "log")
        even = len(steps) < 2 or np.ptp(steps) <= 1e-6 * abs(steps).max()
        return cls(name, values, "linear" if even else "values")

    @property
    def count(self) -> int:
        """Number of cells."""
        return len(self.values)

    def position(self, value: float) -> float:
        """Return the position of a value, in cells; values beyond the ends have positions outside the map."""
        if self.count == 1:
            return 0.5
        if self.scale == "values":
            return self._between(float(value))
        first, last = self._scaled(self.values[0]), self._scaled(self.values[-1])
        return (self._scaled(value) - first) / (last - first) * (self.count - 1) + 0.5

    def _between(self, value: float) -> float:
        """Return the position of a value, interpolated between the two cells beside it, or continued beyond the end."""
        sign = 1 if self.values[-1] > self.values[0] else -1
        rising = sign * self.values
        cell = int(np.clip(np.searchsorted(rising, sign * value), 1, self.count - 1)) - 1
        return cell + 0.5 + float((sign * value - rising[cell]) / (rising[cell + 1] - rising[cell]))

    def _text(self, value: float) -> str:
        return model_name(value).replace("_", " ") if self.name == MODEL else _number(value)

    def _scaled(self, value: float) -> float:
        return math.log10(value) if self.scale == "log" else float(value)

    def _at(self, position: float) -> float:
        """Return the value at a position: the inverse of :meth:`position`."""
        if self.count == 1:
            return float(self.values[0])
        first, last = self._scaled(self.values[0]), self._scaled(self.values[-1])
        scaled = first + (position - 0.5) / (self.count - 1) * (last - first)
        return 10**scaled if self.scale == "log" else scaled

    def ticks(self) -> list[Tick]:
        """Return the ticks of the axis, with and without labels, by rising position."""
        if self.count == 1:
            return [Tick(0.5, self._text(self.values[0]))]
        if self.scale == "values":
            step = -(-self.count // MOST_TICKS)
            return [Tick(i + 0.5, "" if i % step else self._text(value)) for i, value in enumerate(self.values)]
        low, high = sorted((self._at(0.0), self._at(float(self.count))))
        if self.scale == "log" and high / low >= 3:
            major, minor = _log_ticks(low, high)
        else:
            major, minor = _linear_ticks(low, high)
        labelled = {round(self.position(value), 9): Tick(self.position(value), _number(value)) for value in major}
        plain = {round(self.position(value), 9): Tick(self.position(value), "") for value in minor}
        inside = {**plain, **labelled}
        return sorted(tick for tick in inside.values() if -1e-9 <= tick.position <= self.count + 1e-9)

    def title(self, settings: Iterable[str] = ()) -> str:
        """Return the title of the axis as plain text: what it is, the name of its setting, and its unit.

        Figures have symbols instead: :mod:`bow_sweep.figures.symbols`.

        Parameters
        ----------
        settings
            "name=value" of the sweep: the unit of bow force depends on bow speed and admittance.
        """
        known = FIELDS.get(self.name)
        words = TITLES.get(self.name) or (known.metadata["doc"] if known else _si(self.name).doc).partition(";")[0]
        symbol = PLAIN_SYMBOLS.get(self.name, self.name)
        unit = self._unit(settings)
        label = words if symbol == words else f"{words}  {symbol}"
        return f"{label}  ({unit})" if unit else label

    def _unit(self, settings: Iterable[str]) -> str:
        if self.name == "f_init_ratio":
            return ""
        if self.name == "f_asym":  # force = speed / admittance
            given = dict(setting.partition("=")[::2] for setting in settings)
            speed, admittance = (_tidy(given.get(key, usual)) for key, usual in (("v_b", "1"), ("y_t", "2")))
            return f"units: v_b = {speed}, Y_T = {admittance}"
        known = FIELDS.get(self.name)
        return str(known.metadata["unit"]) if known else _si(self.name).unit


def _si(name: str) -> Quantity:
    """Return what a setting in SI units, or of one mode of a body, is; of an unknown one only the name."""
    if name.startswith(THRESHOLD):
        return Quantity(name, "", f"threshold {name.removeprefix(THRESHOLD)}", (), lambda x, _: x)
    if mode := mode_unit(name):
        return Quantity(name, *mode, (), lambda x, _: x)
    return SI.get(name) or Quantity(name, "", name, (), lambda x, _: x)


def _tidy(number: str) -> str:
    try:
        return f"{float(number):g}"
    except ValueError:
        return number


def _is_geometric(name: str, values: np.ndarray) -> bool:
    if len(values) < 2 or values.min() <= 0:
        return False
    if len(values) == 2:  # two points fit any scale: take that of the parameter
        known = FIELDS.get(name)
        return known is not None and known.metadata.get("scale") == "log"
    logs = np.diff(np.log(values))
    steps = np.diff(values)
    return bool(np.ptp(logs) < 1e-6 * abs(logs).max() and np.ptp(steps) > 1e-6 * abs(steps).max())


def _log_ticks(low: float, high: float) -> tuple[list[float], list[float]]:
    """Return (labelled, minor) values: 1, 2, 5 in each decade, or only whole decades where there are many."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    wide = len(decades) > 5
    heads: tuple[int, ...] = (1,) if wide else (1, 2, 5)
    step = -(-len(decades) // 8) if wide else 1
    major = [head * 10.0**decade for decade in decades if decade % step == 0 for head in heads]
    minor = [head * 10.0**decade for decade in decades for head in ((1,) if step > 1 else range(1, 10))]
    return _inside(major, low, high), _inside(minor, low, high)


def _linear_ticks(low: float, high: float) -> tuple[list[float], list[float]]:
    """Return (labelled, minor) values: about five round numbers, with four or five minor steps between two."""
    rough = (high - low) / 5
    power = 10.0 ** math.floor(math.log10(rough))
    factor, parts = next((f, p) for f, p in ((1, 5), (2, 4), (2.5, 5), (5, 5), (10, 5)) if f * power >= rough * 0.8)
    step = factor * power
    major = np.arange(math.floor(low / step), math.ceil(high / step) + 1) * step
    fine = step / parts
    minor = np.arange(math.floor(low / fine), math.ceil(high / fine) + 1) * fine
    return _inside(major, low, high), _inside(minor, low, high)


def _inside(values: Iterable[float], low: float, high: float) -> list[float]:
    slack = 1e-9 * (high - low)
    return [float(value) for value in values if low - slack <= value <= high + slack]


def _number(value: float) -> str:
    """Return a number as text, without trailing zeros and rounding errors; small ones as 5e-5."""
    text = f"{float(value):.6g}"
    if 0 < abs(float(text)) < 1e-3:
        head, _, power = f"{float(value):.5e}".partition("e")
        return f"{head.rstrip('0').rstrip('.')}e{int(power)}"
    return "0" if float(text) == 0 else text
