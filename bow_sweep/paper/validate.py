"""`bow validate`: compares the paper's claims with the results of this program.

The claims are those of PHYSICS.md section 8, of the sections of the paper that it cites, and of section IV.B. The
verdict on a claim is *pass* or *fail* by a tolerance, which the row gives with its reason; *report* where the paper
gives no number to compare with; *needs runs* where the claim is about maps that were not given.
"""

from __future__ import annotations

import functools
import json
import textwrap
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from bow_sweep.paper import claims_maps, claims_modes, claims_motion, claims_terrain
from bow_sweep.paper.claim import FAIL, NEEDS_RUNS, PASS, REPORT, VERDICTS, Row
from bow_sweep.paper.maps import recognise


@dataclass(frozen=True)
class Report:
    """All rows, and the runs whose maps were used: (directory, title of the map)."""

    rows: tuple[Row, ...]
    runs: tuple[tuple[str, str], ...] = ()

    @property
    def ok(self) -> bool:
        """Whether no claim fails."""
        return all(row.verdict != FAIL for row in self.rows)

    @property
    def counts(self) -> dict[str, int]:
        """Number of rows with each verdict."""
        counted = Counter(row.verdict for row in self.rows)
        return {verdict: counted[verdict] for verdict in VERDICTS}

    def summary(self) -> str:
        """Return the counts as text."""
        return ", ".join(f"{count} {verdict}" for verdict, count in self.counts.items() if count)

    def to_json(self) -> str:
        """Return the report as JSON."""
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
        """Return the table as Markdown, with the tolerances and their reasons below it."""
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
    """Compare the results of this program with the paper.

    Parameters
    ----------
    runs
        Run directories, or map.npz files, of the paper's maps, in any order.
    progress
        Called with (claims done, claims) before each claim.

    Raises
    ------
    MapFileError
        Where a run has no map, or it is not one of the paper's six.
    """
    found = recognise(runs)
    claims = [claim for part in (claims_modes, claims_motion, claims_maps, claims_terrain) for claim in part.CLAIMS.all]
    rows = []
    for done, claim in enumerate(claims):
        if progress:
            progress(done, len(claims))
        rows.append(claim.judge(found.maps))
    return Report(tuple(rows), found.listed)
