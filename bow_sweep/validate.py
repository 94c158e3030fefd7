"""`bow validate`: what the paper states beside what this program finds, with a verdict for each claim.

The claims are those of PHYSICS.md section 8 and the sections of the paper they come from. A row's verdict is *pass* or
*fail* by a tolerance that the row gives with its reason; *report* where the paper's statement gives nothing to hold a
number against; *needs runs* where it is about maps that were not given.
"""

from __future__ import annotations

import functools
import json
import textwrap
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from .papermaps import at_paper_size, recognise
from .view.maps import MapFile

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


@dataclass(frozen=True)
class Report:
    """All rows, and the runs whose maps were judged: (directory, what it is a map of)."""

    rows: tuple[Row, ...]
    runs: tuple[tuple[str, str], ...] = ()

    @property
    def ok(self) -> bool:
        """Whether no row fails."""
        return all(row.verdict != FAIL for row in self.rows)

    @property
    def counts(self) -> dict[str, int]:
        """How many rows have each verdict."""
        counted = Counter(row.verdict for row in self.rows)
        return {verdict: counted[verdict] for verdict in VERDICTS}

    def summary(self) -> str:
        """Return the counts in words."""
        return ", ".join(f"{count} {verdict}" for verdict, count in self.counts.items() if count)

    def to_json(self) -> str:
        """Return the report for programs."""
        runs = [{"directory": directory, "map": name} for directory, name in self.runs]
        rows = [asdict(row) for row in self.rows]
        return json.dumps({"ok": self.ok, "counts": self.counts, "runs": runs, "rows": rows}, indent=2) + "\n"

    def to_text(self, width: int = 120) -> str:
        """Return the table for a terminal."""
        lines = []
        wrap = functools.partial(textwrap.wrap, width=width)
        for row in self.rows:
            what = f"{row.claim}  [{row.where}]"
            if row.verdict == NEEDS_RUNS:
                what += f": {row.measured}"
            lines += wrap(what, initial_indent=f"{row.verdict.upper():11}", subsequent_indent=" " * 11)
            texts = {"claimed": row.expected, "ours": row.measured, "asked": row.reason}
            shown = {PASS: 2, REPORT: 2, FAIL: 3, NEEDS_RUNS: 0}[row.verdict]
            for name, text in list(texts.items())[:shown]:
                lines += wrap(text, initial_indent=f"{'':11}{name + ':':9}", subsequent_indent=" " * 20)
        return "\n".join([*lines, "", self.summary()])

    def to_markdown(self) -> str:
        """Return the table as a section of Markdown, the tolerances and their reasons below it."""
        lines = ["| # | claim | where | claimed | ours | verdict |", "|---|---|---|---|---|---|"]
        for number, row in enumerate(self.rows, 1):
            cells = (str(number), row.claim, row.where, row.expected, row.measured, f"**{row.verdict}**")
            lines.append("| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |")
        lines += ["", f"{self.summary()}.", "", "How each is judged:", ""]
        lines += [f"{number}. `{row.key}`: {row.reason}." for number, row in enumerate(self.rows, 1)]
        if self.runs:
            lines += ["", "Maps:", "", *(f"- {name}: `{directory}`" for directory, name in self.runs)]
        return "\n".join(lines) + "\n"


def validate(runs: Sequence[Path] = (), progress: Callable[[float, float], None] | None = None) -> Report:
    """Hold the program against the paper.

    Parameters
    ----------
    runs
        Run directories, or map.npz files, of the paper's maps; in any order.
    progress
        Called with (claims judged, claims) before each.

    Raises
    ------
    MapFileError
        Where a run has no map, or it is none of the paper's six.
    """
    from . import claims_maps, claims_modes, claims_motion

    found = recognise(runs)
    claims = [claim for part in (claims_modes, claims_motion, claims_maps) for claim in part.CLAIMS.all]
    rows = []
    for done, claim in enumerate(claims):
        if progress:
            progress(done, len(claims))
        rows.append(claim.judge(found.maps))
    return Report(tuple(rows), found.listed)
