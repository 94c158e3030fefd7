"""Values that a study gives a parameter: ``NAME=FIRST:LAST:COUNT``, or ``NAME=VALUE,VALUE``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics.errors import ParameterError
from bow_sim.physics.fields import as_number
from bow_sim.physics.instruments import SI
from bow_sim.physics.parameters import TYPES
from bow_sim.physics.usual_axes import usual
from bow_sim.protocol.sweep_spec import Axis

PRESET = "preset"
"""Name under which a study goes through presets."""

SCALES = ("linear", "log")
LISTED = "listed"
"""Scale of values that are listed one by one."""

MOST_VALUES = 1000
"""Values of one parameter."""

OVER_FORM = "NAME=FIRST:LAST:COUNT, perhaps with :log or :linear after it, or NAME=VALUE,VALUE,..."
RANGE_FORM = "NAME=FIRST:LAST, perhaps with :log or :linear after it"


@dataclass(frozen=True)
class Over:
    """The values that a study gives a parameter.

    Attributes
    ----------
    name
        Any setting, or `PRESET`.
    values
        As settings are written; floats have all their bits.
    scale
        "linear", "log" or `LISTED`.
    """

    name: str
    values: tuple[str, ...]
    scale: str = LISTED

    @property
    def numbers(self) -> NDArray[np.float64] | None:
        """(values,) the values as numbers; None where one of them is not a number."""
        found = [as_number(text) for text in self.values]
        return None if None in found else np.array(found, float)

    @property
    def is_log(self) -> bool:
        """Whether a picture should have a logarithmic axis for it."""
        if self.scale != LISTED:
            return self.scale == "log"
        numbers = self.numbers
        return numbers is not None and bool(numbers.min() > 0) and usual_scale(self.name) == "log"

    def check(self, given: Sequence[str] = ()) -> None:
        """Raise ParameterError where the values cannot be.

        Parameters
        ----------
        given
            Names of settings that hold for all maps.
        """
        what = f"--over {self.name}"
        if self.name in given:
            raise ParameterError(f"{what}: is also given for all maps; should be one of the two")
        if not self.name or not all(self.values):
            raise ParameterError(f"{what}={','.join(self.values)}: should be {OVER_FORM}")
        if len(self.values) > MOST_VALUES:
            raise ParameterError(f"{what}: {len(self.values)} values; should be at most {MOST_VALUES}")
        numbers = self.numbers
        distinct = set(self.values) if numbers is None else set(numbers.tolist())
        if len(distinct) != len(self.values):
            raise ParameterError(f"{what}={','.join(self.values)}: a value stands there twice; should be once")


@dataclass(frozen=True)
class Range:
    """The range in which a search looks for the best value of a parameter.

    Attributes
    ----------
    low, high
        Both included, in the parameter's unit.
    scale
        "linear" or "log".
    """

    name: str
    low: float
    high: float
    scale: str

    @property
    def whole(self) -> bool:
        """Whether the parameter takes whole numbers only."""
        return TYPES.get(self.name) is int

    def text(self, value: float) -> str:
        """Return a value as a setting is written; a float has all its bits."""
        return str(round(value)) if self.whole else repr(float(value))


def usual_scale(name: str) -> str:
    """Return the scale that a parameter has where none is given, see :mod:`bow_sim.physics.usual_axes`."""
    found = usual(name) or (usual(SI[name].same) if name in SI else None)
    return found.scale if found else "linear"


def over_of(text: str) -> Over:
    """Return what a text such as ``stiffness_b=1e-6:3e-4:12:log`` says.

    Raises
    ------
    ParameterError
        Where it says nothing of that form; names what would be right.
    """
    name, equals, values = (part.strip() for part in text.partition("="))
    if not (name and equals and values):
        raise ParameterError(f"--over {text}: should be {OVER_FORM}")
    if ":" not in values:
        found = Over(name, tuple(value.strip() for value in values.split(",")))
        found.check()
        return found
    first, last, rest, scale = _range(f"--over {text}", name, values, OVER_FORM)
    if len(rest) != 1 or not rest[0].isdecimal() or not 1 <= int(rest[0]) <= MOST_VALUES:
        raise ParameterError(f"--over {text}: should be {OVER_FORM}; COUNT is 1 ... {MOST_VALUES}")
    count = int(rest[0])
    if count == 1 and first != last:
        raise ParameterError(f"--over {text}: one value cannot be both ends; COUNT should be 2 at least")
    numbers = Axis(name, scale, first, last, count).values()
    if TYPES.get(name) is int and (numbers % 1).any():
        raise ParameterError(f"--over {text}: {name} takes whole numbers, and these steps are not; list them: 1,2,...")
    texts = [str(int(value)) if TYPES.get(name) is int else repr(float(value)) for value in numbers]
    found = Over(name, tuple(texts), scale)
    found.check()
    return found


def range_of(text: str) -> Range:
    """Return what a text such as ``mu_s=0.6:1.2`` says.

    Raises
    ------
    ParameterError
        Where it says nothing of that form; names what would be right.
    """
    name, equals, values = (part.strip() for part in text.partition("="))
    if not (name and equals and ":" in values):
        raise ParameterError(f"--over {text}: should be {RANGE_FORM}")
    low, high, rest, scale = _range(f"--over {text}", name, values, RANGE_FORM)
    if rest:
        raise ParameterError(f"--over {text}: should be {RANGE_FORM}; how many maps is said by --trials")
    if not low < high:
        raise ParameterError(f"--over {text}: the first value should be below the last")
    found = Range(name, low, high, scale)
    if found.whole and (low % 1 or high % 1):
        raise ParameterError(f"--over {text}: {name} takes whole numbers; so should both ends be")
    return found


def _range(what: str, name: str, values: str, form: str) -> tuple[float, float, list[str], str]:
    """Return first, last, what stands after them, and the scale."""
    parts = [part.strip() for part in values.split(":")]
    named = parts.pop() if parts[-1] in SCALES else ""
    ends = [as_number(part) for part in parts[:2]]
    if len(ends) < 2 or ends[0] is None or ends[1] is None or not np.isfinite(np.array(ends, float)).all():
        raise ParameterError(f"{what}: should be {form}; FIRST and LAST are numbers")
    positive = min(ends[0], ends[1]) > 0
    scale = named or (usual_scale(name) if positive else "linear")
    if scale == "log" and not positive:
        raise ParameterError(f"{what}: both ends should be above 0 on a logarithmic scale; :linear makes it linear")
    return ends[0], ends[1], parts[2:], scale
