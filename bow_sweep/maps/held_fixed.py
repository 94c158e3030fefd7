"""What is the same in every cell of a map: the settings that its pictures name in their captions."""

from __future__ import annotations

from typing import NamedTuple

from bow_sim.physics.body import mode_unit
from bow_sim.physics.instruments import SI
from bow_sim.physics.parameters import FIELDS
from bow_sweep.maps.axes import PLAIN_SYMBOLS, SYMBOLS
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

ALWAYS = ("v_mid", "bow_bridge", "mu_s", "mu_d", "v_b", "y_t")
"""Settings that every caption names, because every map depends on them; v_b and y_t are the units of the others."""

ELSEWHERE = ("model", "gesture", "periods", "dtype", "period", "bow_offset")
"""Settings that a caption has in other words, or that change no map."""

UNITS = {"f_asym": "v_b/Y_T", "f_init_ratio": "", "v_b": "", "y_t": ""}
"""Units where those of the parameters would be no help: v_b and y_t are numbers by definition of the units."""

PLAIN = {**PLAIN_SYMBOLS, "y_t": "Y_T", "bow_bridge": "beta"}
CLOSE = {"f_init_ratio": "f_init/f_asym", "bow_bridge": "beta N", "y_t": "Y_T"}
"""Symbols where space is short."""

MATHEMATICS = {
    **SYMBOLS,
    "mu_s": r"$\mu_s$",
    "mu_d": r"$\mu_d$",
    "v_b": r"$v_b$",
    "y_t": r"$Y_T$",
    "bow_bridge": r"$\beta$",
    "tau_v": r"$\tau_v$",
}


class Held(NamedTuple):
    """A setting that all cells share: its `name`, its value as `text`, and its `unit` ("" for a number)."""

    name: str
    text: str
    unit: str

    def line(self, mathematics: bool = False) -> str:
        """Return "symbol = value unit"; `mathematics` writes symbols for Matplotlib."""
        unit = self.unit.replace("v_b", r"$v_b$").replace("Y_T", r"$Y_T$") if mathematics else self.unit
        text = self.text.replace("-", "\N{MINUS SIGN}") if mathematics else self.text
        return f"{self.symbol(mathematics)} = {text} {unit}".rstrip()

    def symbol(self, mathematics: bool = False) -> str:
        """Return the symbol of the setting; `mathematics` writes it for Matplotlib."""
        return MATHEMATICS.get(self.name, self.name) if mathematics else PLAIN.get(self.name, self.name)


def held_fixed(plane: Plane) -> list[Held]:
    """Return the settings that all cells of a map share and that decide what it shows.

    Those of the gesture come first, then those of every map, then others that differ from their defaults. A map of a
    file without settings has none.
    """
    given = plane.values
    axes = {same for name in (plane.x_name, plane.y_name) for same in (name, SI[name].same if name in SI else name)}
    gesture = GESTURE_SETTINGS.get(given.get("gesture", "exponential"), ())
    if "f_init_ratio" not in axes and _short(given.get("f_init_ratio", "")) == "1":
        # a force that does not change has no time constant
        gesture = tuple(name for name in gesture if name != "tau_f")
    unusual = [
        name
        for name, known in FIELDS.items()
        if name in given and name not in ELSEWHERE and _short(given[name]) != _short(str(known.default))
    ]
    wanted = dict.fromkeys([*gesture, *ALWAYS, *unusual])
    return [_held(name, given) for name in wanted if name in given and name not in axes]


def _held(name: str, given: dict[str, str]) -> Held:
    if name == "bow_bridge" and "period" in given:
        trip = float(given[name]) + float(given.get("bow_offset", 0))
        return Held(name, f"{trip:g}/{_short(given['period'])}", "")
    if name.endswith("_function"):
        return Held(name, "own", "")
    return Held(name, _short(given[name]), unit_of(name))


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
    """Return the two parameters of every cell with values and units as text, in the order of the cells."""
    x, y = ([_named(axis.name, value) for value in axis.values.tolist()] for axis in plane.axes)
    return [f"{along}, {up}" for up in y for along in x]


def cell_name(plane: Plane, cell: int) -> str:
    """Return the two parameters of a cell with values and units as text."""
    iy, ix = divmod(cell, plane.shape[1])
    x, y = plane.axes
    return f"{_named(x.name, x.values[ix])}, {_named(y.name, y.values[iy])}"


def _named(name: str, value: float) -> str:
    return f"{CLOSE.get(name, name)} {value:.4g} {unit_of(name)}".rstrip()


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
