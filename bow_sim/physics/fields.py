"""Fields of a dataclass of parameters: what each means, its unit, source and range."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import field
from typing import Any, NamedTuple


class Range(NamedTuple):
    """The values that a number may have; an open end is not allowed itself."""

    low: float
    high: float
    low_open: bool = False
    high_open: bool = False

    def holds(self, value: float) -> bool:
        """Return whether the value lies in the range; NaN does not."""
        above = value > self.low if self.low_open else value >= self.low
        below = value < self.high if self.high_open else value <= self.high
        return above and below

    def __str__(self) -> str:
        low = f"> {self.low:g}" if self.low_open else f">= {self.low:g}"
        high = f"< {self.high:g}" if self.high_open else f"<= {self.high:g}"
        return f"{low} and {high}"


def number(
    default: float, low: float, high: float, unit: str, source: str, doc: str, ends: str = "[]", scale: str = "linear"
) -> Any:
    """Return a field with a range; ``ends`` is one of ``[] () (] [)`` as in mathematics."""
    limits = Range(low, high, ends[0] == "(", ends[1] == ")")
    return field(
        default=default, metadata={"doc": doc, "unit": unit, "source": source, "range": limits, "scale": scale}
    )


def function(side: str) -> Any:
    """Return a field for a reflection function as text; see :func:`bow_sim.physics.reflection_text.parse`."""
    return text(
        "section II.B", f"reflection function {side} in place of the model's own, as text; empty for the model's own"
    )


def text(source: str, doc: str) -> Any:
    """Return a field that holds a text."""
    return field(default="", metadata={"doc": doc, "unit": "", "source": source})


def choice(default: str, choices: Iterable[str], source: str, doc: str) -> Any:
    """Return a field that holds one of some names."""
    return field(default=default, metadata={"doc": doc, "unit": "", "source": source, "choices": tuple(choices)})


def as_number(value: object) -> float | None:
    """Return a value, or its text, as a finite number; None if it is not one."""
    if isinstance(value, (bool, bytes)):
        return None
    try:
        number = float(value)  # type: ignore[arg-type]  # whatever float() takes, NumPy scalars too
    except (TypeError, ValueError):
        return None
    return number if math.isfinite(number) else None


def article(kind: type) -> str:
    """Return what a value of this type is called, with its article."""
    return "a whole number" if kind is int else "a number"
