"""What is the same in every cell of a map: the settings that its pictures name in their captions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from bow_sim.physics.body import mode_unit
from bow_sim.physics.instruments import SI, in_si
from bow_sim.physics.kinds import value_text
from bow_sim.physics.parameters import FIELDS, FLOATS
from bow_sweep.maps.axes import PLAIN_SYMBOLS
from bow_sweep.maps.plane import MODEL_NAMES, Plane

GESTURE_SETTINGS = {
    "exponential": ("f_asym", "f_init_ratio", "tau_f"),
    "martele": ("f_asym", "f_init_ratio", "tau_f", "tau_v"),
    "string_crossing": ("f_asym", "tau_f"),
    **dict.fromkeys(
        ("accelerate_to", "guettler", "constant_acceleration"), ("f_asym", "f_init_ratio", "tau_f", "acceleration")
    ),
}
"""The settings that each gesture uses (sections II.A and III.C, PHYSICS.md 14); one has its name in older maps."""

LAW_SETTINGS = {
    "hyperbola": ("v_mid", "mu_s", "mu_d"),
    "coulomb": ("mu_s", "mu_d"),
    "curve": ("mu_s", "mu_d"),
    "thermal": ("mu_s",),
}
"""The settings that each friction law uses, of those that another one does not."""

ALWAYS = ("v_mid", "bow_bridge", "mu_s", "mu_d", "v_b", "y_t")
"""Settings that every caption names, because every map depends on them; v_b and y_t are the units of the others."""

ELSEWHERE = ("model", "gesture", "periods", "dtype", "period", "bow_offset", "v_unit", "string_length")
"""Settings that a caption has in other words, or that change no map."""

ALSO_MOVES = {"bow_acceleration": {"sample_rate"}, "v_0": {"v_b"}, "bow_distance": {"string_length"}}
"""Settings beside the units themselves on which a value in SI units depends."""

SYSTEM = {"y_t", "z_0", "v_unit"}
"""The settings that tie the paper's units to SI units."""

UNITS = {"f_asym": "2 Z_0 v_b", "f_init_ratio": "", "v_b": "", "y_t": ""}
"""Units where those of the parameters would be no help: v_b and y_t are numbers by definition of the units."""

PLAIN = {**PLAIN_SYMBOLS, "y_t": "Y_T", "bow_bridge": "beta"}
CLOSE = {"f_init_ratio": "f_init/f_asym", "bow_bridge": "beta N", "y_t": "Y_T"}
"""Symbols where space is short."""


class Held(NamedTuple):
    """A setting that all cells share: its `name`, its value as `text`, its `unit` ("" for a number).

    `beside` is the same in the other system of units, as text; "" where there is none.
    """

    name: str
    text: str
    unit: str
    beside: str = ""

    def line(self) -> str:
        """Return "symbol = value unit"."""
        return f"{self.symbol()} = {self.text} {self.unit}".rstrip() + f" ({self.beside})" * bool(self.beside)

    def symbol(self) -> str:
        """Return the symbol of the setting as plain text."""
        return PLAIN.get(self.name, self.name)


def held_fixed(plane: Plane) -> list[Held]:
    """Return the settings that all cells of a map share and that decide what it shows.

    Those of the gesture come first, then those of every map, then others that differ from their defaults. A map of a
    file without settings has none.
    """
    given = plane.values
    axes = moving(plane)
    gesture = GESTURE_SETTINGS.get(given.get("gesture", "exponential"), ())
    law = LAW_SETTINGS.get(given.get("friction", "hyperbola"), ())
    unused = {name for names in LAW_SETTINGS.values() for name in names} - {*law} if law else set()
    sustained = "sustained" in axes or _short(given.get("sustained", "0")) != "0"
    if sustained:
        gesture = ("sustained", *(name for name in gesture if name != "f_init_ratio"))
    elif "f_init_ratio" not in axes and _short(given.get("f_init_ratio", "")) == "1":
        # a force that does not change has no time constant
        gesture = tuple(name for name in gesture if name != "tau_f")
    unusual = [
        name
        for name, known in FIELDS.items()
        if name in given and name not in ELSEWHERE and _short(given[name]) != _short(str(known.default))
    ]
    wanted = dict.fromkeys([*gesture, *ALWAYS, *unusual])
    others = _Beside(plane)
    return [
        _held(name, given, others(name, given[name]))
        for name in wanted
        if name in given and name not in axes and name not in unused
    ]


def moving(plane: Plane) -> set[str]:
    """Return the parameters that differ between the cells of a map, in both systems of units."""
    return _both_names((plane.x_name, plane.y_name))


def _both_names(axes: Iterable[str]) -> set[str]:
    both = {same for name in axes for same in (name, SI[name].same if name in SI else name)}
    return both | {"string_length"} if "semitone" in both else both  # a stopped string is shorter


def _held(name: str, given: dict[str, str], beside: str) -> Held:
    if name == "bow_bridge" and "period" in given:
        trip = float(given[name]) + float(given.get("bow_offset", 0))
        return Held(name, f"{trip:g}/{_short(given['period'])}", "", beside)
    if name.endswith("_function") or name in ("body_modes", "friction_curve"):
        return Held(name, "own", "")
    return Held(name, _short(given[name]), unit_of(name), beside)


def beside(name: str, value: float, values: Mapping[str, Any]) -> str:
    """Return a value in the other system of units, as "0.31 N" or "f_asym 4.4 2 Z_0 v_b"; "" where there is none.

    Parameters
    ----------
    name, value
        A parameter of the paper or a setting in SI units, and its value.
    values
        The parameters of the cell in the paper's units, by name.
    """
    if not (values["z_0"] and values["v_unit"]):
        return ""
    if name == "semitone":
        return f"{SI[name].convert(value, values) / values['period']:.4g} Hz"
    if name in ("beta", "bow_bridge"):
        share = value if name == "beta" else (value + values["bow_offset"]) / values["period"]
        return f"{1000 * share * values['string_length']:.3g} mm" if values["string_length"] else ""
    if name == "bow_distance":
        return f"beta {SI[name].convert(value, values) / values['period']:.4g}"
    if name in SI:
        same = SI[name].same
        return f"{CLOSE.get(same, same)} {SI[name].convert(value, values):.4g} {unit_of(same)}".rstrip()
    for quantity in SI.values():
        if quantity.same == name and quantity.back is not None:
            return f"{quantity.back(value, values):.4g} {quantity.unit}"
    return ""


class _Beside:
    """Values of a map's parameters in the other system of units; "" where that differs from cell to cell."""

    def __init__(self, plane: Plane) -> None:
        given = plane.values
        self.moving = moving(plane)
        numbers = FLOATS | {"bow_bridge", "period"}
        self.values: dict[str, Any] = {name: FIELDS[name].default for name in numbers}
        self.values |= {name: float(given[name]) for name in numbers & given.keys()}

    def __call__(self, name: str, value: str | float) -> str:
        ways = [other for other in SI if name in (other, SI[other].same)]
        needs = SYSTEM.union(*(ALSO_MOVES.get(other, set()) for other in ways))
        if not ways or needs & self.moving - {name, *(SI[other].same for other in ways)}:
            return ""
        return beside(name, float(value), self.values)


def in_the_other_system(plane: Plane, name: str, value: float) -> str:
    """Return a value of a parameter of a map in the other system of units, as "0.31 N"; "" where it differs by cell."""
    return _Beside(plane)(name, value)


def unit_of(name: str) -> str:
    """Return the unit of a setting, in the paper's units or in SI; "" for a number."""
    if name in UNITS:
        return UNITS[name]
    if name in SI:
        return SI[name].unit
    if mode := mode_unit(name):
        return mode[0]
    return str(FIELDS[name].metadata["unit"] or "") if name in FIELDS else ""


def cell_names(plane: Plane) -> list[str]:
    """Return the two parameters of every cell with values and units as text, in the order of the cells.

    Where a speed and an impedance in SI units are known, each value stands in both systems.
    """
    x, y = (
        [
            f"{CLOSE.get(axis.name, axis.name)} {value_text(axis.name, value)}{unit}"
            for value, unit in zip(axis.values.tolist(), units, strict=True)
        ]
        for axis, units in zip(plane.axes, axis_units(plane), strict=True)
    )
    return [f"{along}, {up}" for up in y for along in x]


def axis_units(plane: Plane) -> tuple[list[str], list[str]]:
    """Return what follows each value of the two axes: its unit, and the same in the other system, as text."""
    others = _Beside(plane)
    made = []
    for axis in plane.axes:
        unit = f" {unit_of(axis.name)}".rstrip()
        same = [others(axis.name, value) for value in axis.values.tolist()]
        made.append([f"{unit} ({other})" if other else unit for other in same])
    return made[0], made[1]


def common_in_si(values: Mapping[str, Any], axes: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Return what all cells of a sweep share in SI units: name -> ``{"value": number, "unit": text}``.

    Parameters
    ----------
    values
        The parameters that all cells share, by name.
    axes
        Names of the two axes.
    """
    moved = _both_names(axes)
    return {
        name: {"value": value, "unit": SI[name].unit}
        for name, value in in_si(values).items()
        if not {name, SI[name].same, *SYSTEM, *ALSO_MOVES.get(name, ())} & moved
    }


def cell_name(plane: Plane, cell: int) -> str:
    """Return the two parameters of a cell with values and units as text."""
    iy, ix = divmod(cell, plane.shape[1])
    x, y = plane.axes
    return f"{_named(x.name, x.values[ix])}, {_named(y.name, y.values[iy])}"


def _named(name: str, value: float) -> str:
    return f"{CLOSE.get(name, name)} {value_text(name, value)} {unit_of(name)}".rstrip()


def string_of(plane: Plane) -> str:
    """Return which string a map is of."""
    model = plane.values.get("model", "")
    return f"{MODEL_NAMES.get(model, model)} string" if model else "Map of the bowed string"


def gesture_of(plane: Plane) -> str:
    """Return the gesture of a map, as text; "" for the usual one, whose force goes exponentially to its end."""
    gesture = plane.values.get("gesture", "exponential")
    return "" if gesture == "exponential" else gesture.replace("_", " ")


def subject(plane: Plane) -> str:
    """Return which string and which gesture a map is of."""
    return ", ".join(filter(None, [string_of(plane), gesture_of(plane)]))


def caption(plane: Plane, width: int) -> list[str]:
    """Return string, gesture and what is held fixed as lines of at most `width` characters where words allow it."""
    parts = [subject(plane), *(held.line() for held in held_fixed(plane)), f"{plane.periods:g} periods"]
    lines = [""]
    for part in parts:
        longer = f"{lines[-1]}  \u00b7  {part}" if lines[-1] else part
        if len(longer) <= width or not lines[-1]:
            lines[-1] = longer
        else:
            lines.append(part)
    return lines


def _short(number: str) -> str:
    try:
        return f"{float(number):g}"
    except ValueError:
        return number
