"""A claim beyond the paper, what is found, and the verdict on it; the claims themselves are in `claims_*.py`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from bow_sweep.maps.map_file import MapFile

MET, NEAR, MISSED, REPORTED, NEEDS_RUNS = "met", "near", "missed", "reported", "needs runs"
VERDICTS = (MET, NEAR, MISSED, REPORTED, NEEDS_RUNS)

GRADES: dict[str, str] = {
    "identity": "two computations that must agree",
    "theory": "follows from the equations",
    "published": "printed in a paper",
    "secondary": "published, and known to us through another publication or from a graph",
    "trial": "found by an implementation of the same equations, written before this one",
}
"""What a claim rests on."""

Maps = Mapping[str, MapFile]
"""Maps by the name of their sweep in `bow_sweep.beyond.sweeps`."""


class Point(NamedTuple):
    """One number of a claim.

    Parameters
    ----------
    name : str
        What it is.
    found : float
        The result of this program; NaN where there is none.
    low, high : float
        Where the claim holds, both included.
    more : float
        How far outside of that it is still "near": as a rule the tolerance once more.
    """

    name: str
    found: float
    low: float = -math.inf
    high: float = math.inf
    more: float = 0.0

    @classmethod
    def about(cls, name: str, found: float, expected: float, tolerance: float) -> Point:
        """Return a number that should be within a tolerance, and is near within twice that."""
        return cls(name, found, expected - tolerance, expected + tolerance, tolerance)

    @classmethod
    def within_factor(cls, name: str, found: float, expected: float, factor: float) -> Point:
        """Return a number that should be within a factor of another one."""
        return cls(name, found, expected / factor, expected * factor, expected * (1 - 1 / factor) / 2)

    @classmethod
    def true(cls, name: str, found: bool) -> Point:
        """Return a statement that should be true."""
        return cls(name, float(found), 1.0, 1.0)

    @property
    def verdict(self) -> str:
        """MET, NEAR or MISSED."""
        if self.low <= self.found <= self.high:
            return MET
        return NEAR if self.low - self.more <= self.found <= self.high + self.more else MISSED


class Finding(NamedTuple):
    """What this program finds for a claim.

    Parameters
    ----------
    found : str
        In words.
    points : tuple of Point
        The numbers that the verdict is taken from; none where nothing is asked.
    draw : callable
        Draws the figure into Matplotlib axes.
    """

    found: str
    points: tuple[Point, ...]
    draw: Callable[[Any], None]


@dataclass(frozen=True)
class Row:
    """A claim with what was found.

    Attributes
    ----------
    key
        Short name, unique in the table.
    claim, source, grade, expected, tolerance
        Of the claim; `grade` is one of `GRADES`, `tolerance` says how the verdict is taken.
    found
        The result of this program, as text.
    verdict
        One of `VERDICTS`.
    values
        The numbers behind the verdict, by name; of each what was found, the limits, and the verdict on it.
    runs
        Names of the sweeps that it is about.
    """

    key: str
    claim: str
    source: str
    grade: str
    expected: str
    tolerance: str
    found: str
    verdict: str
    values: dict[str, Any] = field(default_factory=dict)
    runs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Claim:
    """A claim and the function that checks it; the texts are those of :class:`Row`.

    Attributes
    ----------
    needs
        Names of the sweeps whose maps `check` takes.
    check
        Takes the maps and returns what is found.
    """

    key: str
    claim: str
    source: str
    grade: str
    expected: str
    tolerance: str
    needs: tuple[str, ...]
    check: Callable[[Maps], Finding]

    def judge(self, maps: Maps) -> tuple[Row, Finding | None]:
        """Return the row, and the finding with its figure; None where maps are missing."""
        texts = (self.key, self.claim, self.source, self.grade, self.expected, self.tolerance)
        missing = [name for name in self.needs if name not in maps]
        if missing:
            return Row(*texts, f"no run of {', '.join(missing)}", NEEDS_RUNS, {}, self.needs), None
        finding = self.check(maps)
        values = {
            point.name: {
                "found": _json(point.found),
                "low": _json(point.low),
                "high": _json(point.high),
                "verdict": point.verdict,
            }
            for point in finding.points
        }
        return Row(*texts, finding.found, verdict_of(finding.points), values, self.needs), finding


def verdict_of(points: tuple[Point, ...]) -> str:
    """Return the verdict on a claim: that on its worst number; REPORTED where there is none."""
    verdicts = {point.verdict for point in points}
    return next((verdict for verdict in (MISSED, NEAR, MET) if verdict in verdicts), REPORTED)


def _json(value: float) -> float | None:
    return float(f"{value:.8g}") if math.isfinite(value) else None


class Claims:
    """The claims of a module, in the order of the table; :meth:`claim` adds one."""

    def __init__(self) -> None:
        self.all: list[Claim] = []

    def claim(
        self, key: str, claim: str, source: str, grade: str, expected: str, tolerance: str, *needs: str
    ) -> Callable[[Callable[[Maps], Finding]], Callable[[Maps], Finding]]:
        """Return a decorator that makes a claim of the function that checks it; arguments as for :class:`Claim`."""
        if grade not in GRADES:
            raise ValueError(f"grade {grade!r} of {key}: should be one of {', '.join(GRADES)}")

        def add(check: Callable[[Maps], Finding]) -> Callable[[Maps], Finding]:
            self.all.append(Claim(key, claim, source, grade, expected, tolerance, needs, check))
            return check

        return add
