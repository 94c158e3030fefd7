"""The axes of a map from settings: what is not given comes from the parameter on the axis.

Settings come in layers: the defaults of the package, a preset, a preset file of a user, the command line. A later layer
that puts another parameter on an axis takes nothing but the number of cells from the earlier ones.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.physics import body
from bow_sim.physics.applicability import check_axes
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.instruments import SI
from bow_sim.physics.kinds import MODEL, MODEL_NAMES, THRESHOLD, with_values
from bow_sim.physics.parameters import TYPES, Parameters
from bow_sim.physics.usual_axes import Span, rounded, scale_of, span
from bow_sim.protocol.axis_names import check_name
from bow_sim.protocol.sweep_spec import (
    VALUES,
    Axis,
    check_names,
    in_full,
    read_values,
    real_number,
    whole_number,
)

SPANNED = ("scale", "first", "last")
"""Settings that, like ``x.values``, say which values an axis has."""


class AxisError(ParameterError):
    """Two parameters cannot make a plane with the other settings as they are; has their names as `axes`."""

    def __init__(self, reason: str, x: str, y: str) -> None:
        super().__init__(reason)
        self.axes = (x, y)


class AxisSettings:
    """What is said of an axis, layer by layer.

    Parameters
    ----------
    key
        "x" or "y".
    default
        The axis without settings.
    """

    def __init__(self, key: str, default: Axis) -> None:
        self.key, self._cells = key, default.count
        self.given: dict[str, object] = default.settings()
        self.own_count = False

    @property
    def name(self) -> str:
        """The parameter of the axis."""
        return str(self.given["name"])

    def gives(self, name: str) -> bool:
        """Return whether a setting is the parameter of the axis, or gives it in SI units."""
        return name == self.name or (name in SI and _same(name) == _same(self.name))

    def take(self, settings: Iterable[tuple[str, object]]) -> None:
        """Take settings in their order, those of other groups left out.

        A name that comes a second time begins a new layer: a preset file stands before the command line.
        """
        layer: dict[str, object] = {}
        for full, value in settings:
            group, _, name = in_full(full).partition(".")
            if group != self.key or not name:
                continue
            check_names(self.key, [name])
            if name in layer:
                self._take(layer)
                layer = {}
            layer[name] = value
        self._take(layer)

    def _take(self, layer: Mapping[str, object]) -> None:
        if str(layer.get("name", self.name)) != self.name:
            self.given = {"count": self.given.get("count", self._cells)}
            self.own_count = False
        for name, value in layer.items():
            if name == "values":
                for other in (*SPANNED, "count"):
                    self.given.pop(other, None)
            elif name in SPANNED and value != VALUES and self.given.pop("values", None) is not None:
                self.given.pop("scale", None)
            self.given[name] = value
        self.own_count |= "count" in layer

    def axis(self, p: Parameters, swept: Mapping[str, float]) -> Axis:
        """Return the axis.

        Parameters
        ----------
        p
            What all cells share.
        swept
            A value of the parameter of the other axis, by name, if it is known.

        Raises
        ------
        ParameterError
            For an axis that cannot be; names the setting and its value.
        """
        given = dict(self.given)
        if self.name == MODEL and "values" not in given:
            given = {"name": MODEL, "values": list(MODEL_NAMES)}
        if "values" in given:
            values = read_values(f"{self.key}.values", given["values"], self.name)
            of_values: dict[str, Any] = {"scale": VALUES, "first": values[0], "last": values[-1], "count": len(values)}
            return Axis.of(self.key, {**of_values, **given})
        given.setdefault("count", self._cells)
        missing = [name for name in SPANNED if name not in given]
        if missing:
            check_name(self.key, self.name)
            if given.get("scale") == VALUES:
                raise ParameterError(f"{self.key}.scale = {VALUES!r}: needs {self.key}.values=[...]")
            if self.name.startswith(THRESHOLD):
                usual = of_threshold(self.name.removeprefix(THRESHOLD))
            elif missing == ["scale"]:  # a range may depend on what is not known, a scale does not
                usual = Span(scale_of(self.name), 1.0, 1.0)
            else:
                usual = span(self.name, self.key, p, swept)
            given |= self._spanned(usual)
        return Axis.of(self.key, given)

    def _spanned(self, usual: Span) -> dict[str, object]:
        """Return scale, ends and count of the usual axis, as far as they suit what is given."""
        first = self._number("first", usual.first)
        last = self._number("last", usual.last)
        self._check_sides(usual, first, last)
        scale = self.given.get("scale", usual.scale if min(first, last) > 0 else "linear")
        made: dict[str, object] = {"scale": scale, "first": first, "last": last}
        if TYPES.get(self.name) is int and "scale" not in self.given:
            made["scale"] = "linear"
            made |= self._whole(int(first), int(last))
        return made

    def _number(self, name: str, usual: float) -> float:
        return real_number(f"{self.key}.{name}", self.given[name]) if name in self.given else usual

    def _check_sides(self, usual: Span, first: float, last: float) -> None:
        """Raise ParameterError where one end is given, and lies beyond the usual other one."""
        for name, other in (("first", "last"), ("last", "first")):
            if name in self.given and other not in self.given and first >= last:
                raise ParameterError(
                    f"{self.key}.{name} = {self.given[name]}: the usual axis of {self.name} is {usual.first:g} ... "
                    f"{usual.last:g}; give {self.key}.{other} too"
                )

    def _whole(self, first: int, last: int) -> dict[str, object]:
        """Return the end and the number of values of an axis of whole numbers."""
        if not self.own_count:
            return {"count": abs(last - first) + 1} | {"last": float(last)}
        count = whole_number(f"{self.key}.count", self.given["count"])
        if "last" in self.given or count < 2:
            return {}
        step = max(1, (last - first) // (count - 1))
        return {"last": float(first + step * (count - 1))}


def axes(
    defaults: tuple[Axis, Axis], layers: Iterable[Iterable[tuple[str, object]]]
) -> tuple[AxisSettings, AxisSettings]:
    """Return what settings say of both axes, later layers over earlier ones."""
    x, y = AxisSettings("x", defaults[0]), AxisSettings("y", defaults[1])
    for layer in layers:
        entries = list(layer)
        for axis in (x, y):
            axis.take(entries)
    return x, y


THRESHOLDS: dict[str, Any] = Thresholds.__dataclass_fields__
"""The thresholds, by name."""

_THRESHOLDS = {
    "correlation": Span("linear", 0.8, 0.99),
    "lag_first": Span("linear", 0.9, 0.99),
    "lag_last": Span("linear", 1.01, 1.1),
    "lag_long": Span("linear", 2.1, 4.2),
    "wolf_beat": Span("linear", 0.5, 0.95),
}
"""Usual axes of thresholds near a bound, which half of them and half as much again would cross."""


def of_threshold(name: str) -> Span:
    """Return the usual axis of a threshold: from half of it to half as much again."""
    value = float(THRESHOLDS[name].default)
    return _THRESHOLDS.get(name, Span("linear", rounded(0.5 * value), rounded(1.5 * value)))


def check_threshold(axis: AxisSettings, values: Iterable[float]) -> None:
    """Raise ParameterError where a value on an axis cannot be the threshold that it is of."""
    if not axis.name.startswith(THRESHOLD):
        return
    for value in values:
        try:
            Thresholds.from_mapping({axis.name.removeprefix(THRESHOLD): value})
        except ParameterError as error:
            raise ParameterError(f"{axis.key}.name = {axis.name!r}: {error}") from None


def check_axes_of_models(p: Parameters, x: AxisSettings, y: AxisSettings) -> None:
    """Raise ParameterError where a setting along x or y has an effect in none of the models of a map."""
    names = [x.name, y.name]
    if MODEL not in names:
        check_axes(p, names)
        return
    models = (x if x.name == MODEL else y).axis(p, {}).given
    errors = []
    for number in models:
        try:
            check_axes(with_values(p, {MODEL: number}), names)
        except ParameterError as error:
            errors.append(error)
    if len(errors) == len(models):
        raise errors[0]


def check_two(x: AxisSettings, y: AxisSettings) -> None:
    """Check the parameters of two axes, before anything is known of their values.

    Raises
    ------
    ParameterError
        For one that cannot be swept, or two that are the same thing in other units.
    """
    for axis in (x, y):
        check_name(axis.key, axis.name)
        if axis.name.startswith(THRESHOLD):
            check_threshold(axis, [math.nan] if axis.name.removeprefix(THRESHOLD) not in THRESHOLDS else [])
    if x.name != y.name and _same(x.name) == _same(y.name):
        raise ParameterError(
            f"y.name = {y.name!r}: gives {_same(y.name)}, as x.name = {x.name!r} does; the axes should differ"
        )


def _same(name: str) -> str:
    if mode := body.mode_setting(name):
        return f"body_{mode[0]}_{({'ratio': 'f', 'k': 'm'}).get(mode[1], mode[1])}"
    return SI[name].same if name in SI and not SI[name].relative else name


def made(x: AxisSettings, y: AxisSettings, p: Parameters) -> tuple[Axis, Axis]:
    """Return both axes; one in SI units comes last, because its range may depend on the other one."""
    first, second = (y, x) if x.name in SI and y.name not in SI else (x, y)
    one = first.axis(p, {})
    values = one.values()
    other = second.axis(p, {} if one.name in SI else {one.name: float(values[len(values) // 2])})
    check_threshold(first, (one.first, one.last))
    check_threshold(second, (other.first, other.last))
    return (other, one) if first is y else (one, other)
