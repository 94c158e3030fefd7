"""The written form of a sweep: "name=value" settings.

Names are those of :class:`bow_sim.physics.parameters.Parameters`, ``x.*`` and ``y.*`` for the two axes of the map
(``x=NAME`` is ``x.name=NAME``), ``classifier.*`` for the thresholds of the verdicts, ``block_cells``, ``adaptive``,
``repeats``, ``jitter`` and ``seed`` (:mod:`bow_sim.protocol.repeats`), and ``record``
(:mod:`bow_sim.protocol.recording`). Here the settings are only sorted into these groups and the axes are read:
:mod:`bow_sweep.plan.sweep` fills in the defaults before a sweep starts, and :mod:`bow_sim.protocol.sweep_outline` reads
the complete settings that a plan announces.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics import exact
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.fields import as_number
from bow_sim.physics.kinds import MODEL, MODEL_NAMES, in_order, is_kind, kinds_of, model_name, value_text, with_values
from bow_sim.physics.parameters import TYPES, Parameters, parse_settings
from bow_sim.protocol.axis_names import check_name
from bow_sim.protocol.limits import MAX_CELLS

GROUPS = ("x", "y", "classifier")
"""Prefixes of settings that are not parameters of the string."""


VALUES = "values"
"""Scale of an axis whose values are all given."""

MOST_VALUES = 4096
"""Largest number of values in ``x.values``: they stand in every message that has the settings."""


@dataclass(frozen=True)
class Axis:
    """One axis of the map: a parameter and the values it takes.

    Attributes
    ----------
    name
        One for which :func:`bow_sim.physics.parameters.is_sweepable` or :func:`bow_sim.physics.kinds.is_kind` holds.
    scale
        "log", "linear", or "values" where all values are given.
    first, last
        Both included, in the parameter's unit.
    count
        Number of values.
    given
        All values, rising or falling, of scale "values"; else (). As a setting it is ``x.values``.
    """

    name: str
    scale: str
    first: float
    last: float
    count: int
    given: tuple[float, ...] = ()

    @classmethod
    def of(cls, key: str, given: Mapping[str, object]) -> Axis:
        """Read the settings of an axis.

        Parameters
        ----------
        key
            "x" or "y".
        given
            Values by :data:`AXIS_SETTINGS`, as text or numbers. "values" may be left out, where the scale is another.

        Raises
        ------
        ParameterError
            For an unknown or missing name, or an axis that cannot be.
        """
        check_names(key, given)
        names = AXIS_SETTINGS[:-1]
        if missing := set(names) - set(given):
            raise ParameterError(f"there is no setting {key}.{min(missing)}: an axis needs all of {', '.join(names)}")
        axis = cls(
            name=str(given["name"]),
            scale=str(given["scale"]),
            first=real_number(f"{key}.first", given["first"]),
            last=real_number(f"{key}.last", given["last"]),
            count=whole_number(f"{key}.count", given["count"]),
            given=read_values(f"{key}.values", given["values"], str(given["name"])) if "values" in given else (),
        )
        axis._check(key)
        return axis

    def values(self) -> NDArray[np.float64]:
        """Return the values along the axis, (count,), both ends exact."""
        if self.given:
            return np.array(self.given)
        space = exact.geometric if self.scale == "log" else np.linspace
        values: NDArray[np.float64] = space(self.first, self.last, self.count)
        values[0] = self.first
        if self.count > 1:
            values[-1] = self.last
        return values

    def settings(self) -> dict[str, object]:
        """Return the settings of the axis by name, without ``x.``; :meth:`of` reads them back bit for bit."""
        own: dict[str, object] = {name: getattr(self, name) for name in AXIS_SETTINGS[:-1]}
        texts = [value_text(self.name, value, "r") for value in self.given]
        return own | {"values": f"[{', '.join(texts)}]"} if self.given else own

    def tried(self) -> list[tuple[str, float]]:
        """Return the values that are checked before a sweep starts, and where each stands: the ends, or all models.

        The ends are enough, because every limit of a number is an interval or another parameter.
        """
        if self.name == MODEL:
            return [(f"model={model_name(value)}", value) for value in self.given]
        return [("first", self.first), ("last", self.last)]

    def _check(self, key: str) -> None:
        """Raise ParameterError, which names the setting, for an axis that cannot be."""
        check_name(key, self.name)
        if self.name == MODEL and not self.given:
            raise ParameterError(f"{key}.name = 'model': needs {key}.values=[{', '.join(MODEL_NAMES[-2:])}] or so")
        if self.scale not in ("log", "linear", VALUES):
            raise ParameterError(f"{key}.scale = {self.scale!r}: should be 'log' or 'linear'")
        if (self.scale == VALUES) != bool(self.given):
            given = f"{key}.values=[{', '.join(f'{value:g}' for value in self.given[:3])}, ...]"
            raise ParameterError(
                f"{key}.scale = {self.scale!r}: {f'{given} is given too' if self.given else f'needs {key}.values'}"
            )
        if not 1 <= self.count <= MAX_CELLS:
            raise ParameterError(f"{key}.count = {self.count}: should be 1 ... {MAX_CELLS}")
        self._check_given(key)
        for name in ("first", "last"):
            value = getattr(self, name)
            if not np.isfinite(value):
                raise ParameterError(f"{key}.{name} = {value}: should be a finite number")
            if self.scale == "log" and value <= 0:
                raise ParameterError(f"{key}.{name} = {value}: should be above 0 on a logarithmic axis")
        if self.count > 1 and self.first == self.last:
            raise ParameterError(f"{key}.last = {self.last}: {self.count} values need it to differ from {key}.first")
        if TYPES.get(self.name) is int and (self.values() % 1).any():
            if self.given:
                wrong = next(value for value in self.given if value % 1)
                raise ParameterError(f"{key}.values: {wrong!r}: {self.name} takes whole numbers")
            raise ParameterError(
                f"{key}.count = {self.count}: {self.name} takes whole numbers, and {self.first:g} ... {self.last:g} "
                f"in so many {self.scale} steps are not; for instance {key}.scale=linear and one step each"
            )

    def _check_given(self, key: str) -> None:
        """Raise ParameterError where the values do not rise or fall, or contradict the other settings."""
        if not self.given:
            return
        steps = np.diff(self.given)
        if not ((steps > 0).all() or (steps < 0).all()):
            raise ParameterError(f"{key}.values = {list(self.given)}: should rise or fall throughout, each value once")
        for name, right in (("first", self.given[0]), ("last", self.given[-1]), ("count", len(self.given))):
            if getattr(self, name) != right:
                raise ParameterError(
                    f"{key}.{name} = {getattr(self, name):g}: {key}.values has {right:g}; leave {key}.{name} out, or "
                    f"{key}.values"
                )


AXIS_SETTINGS = ("name", "scale", "first", "last", "count", "values")
"""The settings of an axis, ``x.name`` and so on."""


def check_names(key: str, given: Iterable[str]) -> None:
    """Raise ParameterError for a setting that an axis does not have."""
    if unknown := set(given) - set(AXIS_SETTINGS):
        known = ", ".join(f"{key}.{name}" for name in sorted(AXIS_SETTINGS))
        raise ParameterError(f"{key}.{min(unknown)}: no such setting; the axis has {known}")


def read_values(key: str, value: object, name: str = "") -> tuple[float, ...]:
    """Return the numbers of a list, or of its text such as "[0.1, 0.2, 0.5]"; brackets may be left out.

    Models, where `name` says that it is of these, are names; they come in the order of the hierarchy.

    Raises
    ------
    ParameterError
        Where it has no numbers, something else, or more than `MOST_VALUES`.
    """
    if isinstance(value, (list, tuple)):
        words = list(value)
    else:
        words = str(value).strip().removeprefix("[").removesuffix("]").split(",")
    if len(words) > MOST_VALUES:
        raise ParameterError(f"{key}: {len(words)} values: should be at most {MOST_VALUES}; or give first, last, count")
    if name == MODEL:
        return in_order(words)
    numbers = [as_number(word.strip().strip("'\"") if isinstance(word, str) else word) for word in words]
    if None in numbers:
        wrong = words[numbers.index(None)]
        raise ParameterError(f"{key}: {wrong!r}: should be finite numbers, as {key}=[0.1,0.2,0.5]")
    return tuple(number for number in numbers if number is not None)


@lru_cache(maxsize=16)
def values_of(axis: Axis) -> NDArray[np.float64]:
    """Return the values along an axis, (count,), not to be changed: exact rounding takes time, so they are kept."""
    values = axis.values()
    values.flags.writeable = False
    return values


def axis_values(x: Axis, y: Axis, cells: NDArray[np.integer]) -> dict[str, NDArray[np.float64]]:
    """Return the values of the parameters of two axes at some cells, repeats included: {x.name: (cells,), y.name: ...}.

    A repeat stands at the place of its cell: the index of a cell is iy * nx + ix, and repeats count on from there.
    """
    iy, ix = np.divmod(np.asarray(cells, np.int64) % (x.count * y.count), x.count)
    return {x.name: values_of(x)[ix], y.name: values_of(y)[iy]}


def kinds_of_cells(x: Axis, y: Axis, cells: int) -> NDArray[np.int64] | None:
    """Return the kind of every cell, (cells,), repeats included; None where all are of one kind."""
    if not (is_kind(x.name) or is_kind(y.name)):
        return None
    return kinds_of(axis_values(x, y, np.arange(cells)))


def check_plane(parameters: Parameters, x: Axis, y: Axis) -> None:
    """Check two axes together with the parameters that all cells share.

    Only the four corners are tried, and all models, see :meth:`Axis.tried`.

    Raises
    ------
    ParameterError
        Where both axes are one parameter, or the parameters cannot be at a corner.
    """
    if x.name == y.name:
        other = next(name for name in ("f_asym", "f_init_ratio") if name != y.name)
        raise ParameterError(
            f"y.name = {y.name!r}: both axes are this parameter; they should differ: set y.name, for instance "
            f"y.name={other}"
        )
    for (x_end, x_value), (y_end, y_value) in itertools.product(x.tried(), y.tried()):
        try:
            with_values(parameters, {x.name: x_value, y.name: y_value})
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
        head, _, tail = in_full(key).partition(".")
        if tail and head in groups:
            groups[head][tail] = value
        else:
            plain[key] = value
    own = {key: plain.pop(key, None) for key in ("block_cells", "adaptive", "repeats", "jitter", "seed", "record")}
    return Spec(plain=plain, **groups, **own)  # type: ignore[arg-type]  # each by its own name


def in_full(key: str) -> str:
    """Return the name of a setting: ``x`` is short for ``x.name``."""
    return f"{key}.name" if key in ("x", "y") else key


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
