"""The written form of a sweep: "name=value" settings.

Names are those of :class:`bow_sim.physics.parameters.Parameters`, ``x.*`` and ``y.*`` for the two axes of the map,
``classifier.*`` for the thresholds of the verdicts, ``block_cells``, ``adaptive``, ``repeats``, ``jitter`` and
``seed`` (:mod:`bow_sim.protocol.repeats`), and ``record`` (:mod:`bow_sim.protocol.recording`). Here the
settings are only sorted into these groups and the axes are read: :mod:`bow_sweep.plan.sweep` fills in the defaults
before a sweep starts, and :mod:`bow_sim.protocol.sweep_outline` reads the complete settings that a plan announces.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import SWEEPABLE_NAMES, TYPES, Parameters, is_sweepable, parse_settings
from bow_sim.protocol.limits import MAX_CELLS

GROUPS = ("x", "y", "classifier")
"""Prefixes of settings that are not parameters of the string."""


@dataclass(frozen=True)
class Axis:
    """One axis of the map: a parameter and the values it takes.

    Attributes
    ----------
    name
        One for which :func:`bow_sim.physics.parameters.is_sweepable` holds.
    scale
        "log" or "linear".
    first, last
        Both included, in the parameter's unit.
    count
        Number of values.
    """

    name: str
    scale: str
    first: float
    last: float
    count: int

    @classmethod
    def of(cls, key: str, given: Mapping[str, object], default: Axis | None = None) -> Axis:
        """Read the settings of an axis.

        Parameters
        ----------
        key
            "x" or "y".
        given
            Values by the names of the attributes, as text or numbers.
        default
            Values of the names that are not given; without it every name must be given.

        Raises
        ------
        ParameterError
            For an unknown or missing name, or an axis that cannot be.
        """
        names = [part.name for part in fields(cls)]
        if unknown := set(given) - set(names):
            known = ", ".join(f"{key}.{name}" for name in sorted(names))
            raise ParameterError(f"{key}.{min(unknown)}: no such setting; the axis has {known}")
        if default is None and (missing := set(names) - set(given)):
            raise ParameterError(f"there is no setting {key}.{min(missing)}: an axis needs all of {', '.join(names)}")
        values = {name: given.get(name, getattr(default, name, None)) for name in names}
        axis = cls(
            name=str(values["name"]),
            scale=str(values["scale"]),
            first=real_number(f"{key}.first", values["first"]),
            last=real_number(f"{key}.last", values["last"]),
            count=whole_number(f"{key}.count", values["count"]),
        )
        axis._check(key)
        return axis

    def values(self) -> NDArray[np.float64]:
        """Return the values along the axis, (count,), both ends exact."""
        space = np.geomspace if self.scale == "log" else np.linspace
        values: NDArray[np.float64] = space(self.first, self.last, self.count)
        values[0] = self.first
        if self.count > 1:
            values[-1] = self.last
        return values

    def _check(self, key: str) -> None:
        """Raise ParameterError, which names the setting, for an axis that cannot be."""
        if not is_sweepable(self.name):
            raise ParameterError(f"{key}.name = {self.name!r}: cannot be swept; one of {SWEEPABLE_NAMES}")
        if self.scale not in ("log", "linear"):
            raise ParameterError(f"{key}.scale = {self.scale!r}: should be 'log' or 'linear'")
        if not 1 <= self.count <= MAX_CELLS:
            raise ParameterError(f"{key}.count = {self.count}: should be 1 ... {MAX_CELLS}")
        for name in ("first", "last"):
            value = getattr(self, name)
            if not np.isfinite(value):
                raise ParameterError(f"{key}.{name} = {value}: should be a finite number")
            if self.scale == "log" and value <= 0:
                raise ParameterError(f"{key}.{name} = {value}: should be above 0 on a logarithmic axis")
        if self.count > 1 and self.first == self.last:
            raise ParameterError(f"{key}.last = {self.last}: {self.count} values need it to differ from {key}.first")
        if TYPES.get(self.name) is int and (self.values() % 1).any():
            raise ParameterError(
                f"{key}.count = {self.count}: {self.name} takes whole numbers, and {self.first:g} ... {self.last:g} "
                f"in so many {self.scale} steps are not; for instance {key}.scale=linear and one step each"
            )


def axis_values(x: Axis, y: Axis, cells: NDArray[np.integer]) -> dict[str, NDArray[np.float64]]:
    """Return the values of the parameters of two axes at some cells, repeats included: {x.name: (cells,), y.name: ...}.

    A repeat stands at the place of its cell: the index of a cell is iy * nx + ix, and repeats count on from there.
    """
    iy, ix = np.divmod(np.asarray(cells, np.int64) % (x.count * y.count), x.count)
    return {x.name: x.values()[ix], y.name: y.values()[iy]}


def check_plane(parameters: Parameters, x: Axis, y: Axis) -> None:
    """Check two axes together with the parameters that all cells share.

    Only the four corners are tried. This is enough, because every limit of a parameter is an interval or another
    parameter.

    Raises
    ------
    ParameterError
        Where both axes are one parameter, or the parameters cannot be at a corner.
    """
    if x.name == y.name:
        raise ParameterError(f"y.name = {y.name!r}: both axes are this parameter; they should differ")
    for x_end, y_end in itertools.product(("first", "last"), repeat=2):
        try:
            parameters.replace(**{x.name: getattr(x, x_end), y.name: getattr(y, y_end)})
        except ParameterError as error:
            raise ParameterError(f"at x.{x_end} and y.{y_end}: {error}") from None


@dataclass(frozen=True)
class Spec:
    """The settings of a sweep by group. Values are text or, from a preset file, what YAML made of them."""

    plain: Mapping[str, object]
    x: Mapping[str, object]
    y: Mapping[str, object]
    classifier: Mapping[str, object]
    block_cells: object = None
    adaptive: object = None
    repeats: object = None
    jitter: object = None
    seed: object = None
    record: object = None

    def parameters(self) -> Parameters:
        """Return what is common to all cells; the two swept parameters keep their defaults."""
        return Parameters.from_mapping(self.plain)

    def number(self, group: str, key: str) -> int:
        """Return a whole number such as ``x.count``; `group` is "" for ``block_cells``.

        Raises
        ------
        ParameterError
            Where it is missing or not a whole number.
        """
        if not group:
            return whole_number(key, getattr(self, key))
        return whole_number(f"{group}.{key}", getattr(self, group).get(key))

    def share(self, key: str, default: float) -> float:
        """Return a setting between 0 (excluded) and 1, such as ``adaptive``.

        Raises
        ------
        ParameterError
            For any other value.
        """
        value = getattr(self, key)
        share = default if value is None else real_number(key, value)
        if not 0 < share <= 1:
            raise ParameterError(f"{key} = {share:g}: should be above 0 and at most 1")
        return share


def split(settings: Mapping[str, object] | Iterable[str]) -> Spec:
    """Sort settings by their prefixes. Unknown names stay in `Spec.plain`; `Spec.parameters` refuses them.

    Raises
    ------
    ParameterError
        Where a text is not of the form name=value.
    """
    mapping = settings if isinstance(settings, Mapping) else parse_settings(settings)
    groups: dict[str, dict[str, object]] = {group: {} for group in GROUPS}
    plain: dict[str, object] = {}
    for key, value in mapping.items():
        head, dot, tail = key.partition(".")
        if dot and head in groups:
            groups[head][tail] = value
        else:
            plain[key] = value
    own = {key: plain.pop(key, None) for key in ("block_cells", "adaptive", "repeats", "jitter", "seed", "record")}
    return Spec(plain=plain, **groups, **own)  # type: ignore[arg-type]  # each by its own name


def whole_number(key: str, value: object) -> int:
    """Return a setting that is a whole number.

    Raises
    ------
    ParameterError
        Where it is not one.
    """
    try:
        return int(str(value))
    except ValueError:
        raise ParameterError(f"{key} = {value!r}: should be a whole number") from None


def real_number(key: str, value: object) -> float:
    """Return a setting that is a number.

    Raises
    ------
    ParameterError
        Where it is not one.
    """
    try:
        return float(str(value))
    except ValueError:
        raise ParameterError(f"{key} = {value!r}: should be a number") from None
