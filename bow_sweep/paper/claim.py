"""A claim of the paper and its verdict; the claims themselves are in `claims_*.py`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from bow_sweep.maps.map_file import MapFile
from bow_sweep.paper.maps import at_paper_size

PASS, FAIL, REPORT, NEEDS_RUNS = "pass", "fail", "report", "needs runs"
VERDICTS = (PASS, FAIL, REPORT, NEEDS_RUNS)


@dataclass(frozen=True)
class Row:
    """A claim and its verdict.

    Attributes
    ----------
    key
        Short name, unique in the table.
    claim
        The claim as text.
    where
        Its source: section or figure of the paper, or of PHYSICS.md.
    expected
        The value claimed.
    measured
        The result of this program, as text.
    verdict
        One of `VERDICTS`.
    reason
        The tolerance with its reason, or why there is none.
    values
        The numbers behind `measured`, for programs.
    """

    key: str
    claim: str
    where: str
    expected: str
    measured: str
    verdict: str
    reason: str
    values: dict[str, Any] = field(default_factory=dict)


class Finding(NamedTuple):
    """The result of this program for a claim.

    Attributes
    ----------
    measured
        As text.
    holds
        Whether the claim holds; None where there is nothing to compare with.
    values
        The numbers, by name.
    """

    measured: str
    holds: bool | None
    values: dict[str, Any]


Maps = Mapping[str, MapFile]
"""Maps by their letter in Fig 11."""


@dataclass(frozen=True)
class Claim:
    """A claim and the function that checks it; the texts are those of :class:`Row`.

    Attributes
    ----------
    needs
        Letters of the maps of Fig 11 that the claim is about; "" for none.
    check
        Takes the maps and returns the result.
    """

    key: str
    claim: str
    where: str
    expected: str
    reason: str
    needs: str
    check: Callable[[Maps], Finding]

    def judge(self, maps: Maps) -> Row:
        """Return the row. With maps coarser or shorter than the paper's there is a result, but no verdict."""
        text = (self.key, self.claim, self.where, self.expected)
        missing = [f"fig11{letter}" for letter in self.needs if letter not in maps]
        if missing:
            return Row(*text, f"give a run of {', '.join(missing)}", NEEDS_RUNS, self.reason)
        measured, holds, values = self.check(maps)
        coarse = [letter for letter in self.needs if not at_paper_size(maps[letter])]
        if coarse and holds is not None:
            measured += f"; not judged: ({', '.join(coarse)}) coarser or shorter than the paper's"
            holds = None
        verdict = REPORT if holds is None else PASS if holds else FAIL
        return Row(*text, measured, verdict, self.reason, _plain(values))


def _plain(value: Any) -> Any:
    """Return a value with the types of JSON; NaN and infinity become None."""
    if isinstance(value, dict):
        return {str(name): _plain(part) for name, part in value.items()}
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [_plain(part) for part in value]
    if isinstance(value, float):
        return float(f"{value:.8g}") if abs(value) < float("inf") else None
    return value


class Claims:
    """The claims of a module, in the order of the table; :meth:`claim` adds one."""

    def __init__(self) -> None:
        self.all: list[Claim] = []

    def claim(
        self, key: str, claim: str, where: str, expected: str, reason: str, needs: str = ""
    ) -> Callable[[Callable[[Maps], Finding]], Callable[[Maps], Finding]]:
        """Return a decorator that makes a claim of the function that checks it; arguments as for :class:`Claim`."""

        def add(check: Callable[[Maps], Finding]) -> Callable[[Maps], Finding]:
            self.all.append(Claim(key, claim, where, expected, reason, needs, check))
            return check

        return add
