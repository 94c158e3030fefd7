"""What a claim of the paper is, and what is found of it; the claims themselves are in `claims_*.py`."""

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
    """One claim.

    Attributes
    ----------
    key
        Short name, unique in the table.
    claim
        What is claimed, in words.
    where
        Where it stands: section or figure of the paper, or of PHYSICS.md.
    expected
        The value claimed.
    measured
        Ours.
    verdict
        One of `VERDICTS`.
    reason
        Why the tolerance is what it is, or why there is none.
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


class Found(NamedTuple):
    """What was looked for and found.

    Attributes
    ----------
    measured
        In words.
    holds
        Whether the claim does; None where there is nothing to hold it against.
    values
        The numbers.
    """

    measured: str
    holds: bool | None
    values: dict[str, Any]


Maps = Mapping[str, MapFile]
"""The maps that were given, by their letter in Fig 11."""


@dataclass(frozen=True)
class Claim:
    """One claim and how it is looked into; the texts are those of :class:`Row`.

    Attributes
    ----------
    needs
        Letters of the maps of Fig 11 that it is about; "" for none.
    look
        Takes the maps.
    """

    key: str
    claim: str
    where: str
    expected: str
    reason: str
    needs: str
    look: Callable[[Maps], Found]

    def judge(self, maps: Maps) -> Row:
        """Return the row; a map that is coarser or shorter than the paper's is measured, not judged."""
        text = (self.key, self.claim, self.where, self.expected)
        missing = [f"fig11{letter}" for letter in self.needs if letter not in maps]
        if missing:
            return Row(*text, f"give a run of {', '.join(missing)}", NEEDS_RUNS, self.reason)
        measured, holds, values = self.look(maps)
        coarse = [letter for letter in self.needs if not at_paper_size(maps[letter])]
        if coarse and holds is not None:
            measured += f"; not judged: ({', '.join(coarse)}) coarser or shorter than the paper's"
            holds = None
        verdict = REPORT if holds is None else PASS if holds else FAIL
        return Row(*text, measured, verdict, self.reason, _plain(values))


def _plain(value: Any) -> Any:
    """Turn NumPy's numbers and arrays into what JSON has; NaN and infinity, which it has not, into None."""
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
    """The claims of a module, in the order of the table: `claim` makes one of a function that looks into it."""

    def __init__(self) -> None:
        self.all: list[Claim] = []

    def claim(
        self, key: str, words: str, where: str, expected: str, reason: str, needs: str = ""
    ) -> Callable[[Callable[[Maps], Found]], Callable[[Maps], Found]]:
        """Return a decorator; the texts are those of :class:`Claim`."""

        def add(look: Callable[[Maps], Found]) -> Callable[[Maps], Found]:
            self.all.append(Claim(key, words, where, expected, reason, needs, look))
            return look

        return add
