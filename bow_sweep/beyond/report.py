"""The page of claims beyond the paper: table and figures, as text, Markdown, HTML and JSON."""

from __future__ import annotations

import html
import json
import textwrap
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from bow_sim.atomic_files import replacing
from bow_sweep.beyond import (
    claims_chaos,
    claims_guettler,
    claims_linear,
    claims_schelleng,
    claims_thermal,
    claims_wolf,
)
from bow_sweep.beyond.claim import GRADES, MET, MISSED, NEAR, NEEDS_RUNS, REPORTED, VERDICTS, Claim, Finding, Maps, Row

FIGURES = "figures"
"""Folder of the figures, beside the page."""

PAGE = "index.html"

CLAIMS: tuple[Claim, ...] = tuple(
    claim
    for part in (claims_linear, claims_wolf, claims_guettler, claims_schelleng, claims_thermal, claims_chaos)
    for claim in part.CLAIMS.all
)
"""All claims, in the order of the table."""

TITLE = "Claims beyond the paper"

_COLOURS = {MET: "#00795a", NEAR: "#8a6d00", MISSED: "#b3261e", REPORTED: "#1f4e79", NEEDS_RUNS: "#666666"}


@dataclass(frozen=True)
class Report:
    """All rows, and for each the name of its figure; "" for none."""

    rows: tuple[Row, ...]
    figures: tuple[str, ...]
    small: bool = False

    @property
    def ok(self) -> bool:
        """Whether no claim is missed."""
        return all(row.verdict != MISSED for row in self.rows)

    @property
    def counts(self) -> dict[str, int]:
        """Number of rows with each verdict."""
        counted = Counter(row.verdict for row in self.rows)
        return {verdict: counted[verdict] for verdict in VERDICTS}

    def summary(self) -> str:
        """Return the counts as text."""
        counts = ", ".join(f"{count} {verdict}" for verdict, count in self.counts.items() if count)
        return counts + (" (coarse maps: not for a judgement)" if self.small else "")

    def to_json(self) -> str:
        """Return the report as JSON."""
        rows = [{**asdict(row), "figure": name} for row, name in zip(self.rows, self.figures, strict=True)]
        return json.dumps({"ok": self.ok, "small": self.small, "counts": self.counts, "rows": rows}, indent=2) + "\n"

    def to_text(self, width: int = 120) -> str:
        """Return the table for a terminal."""
        lines = []
        for row in self.rows:
            what = f"{row.claim}  [{row.source}; {row.grade}]"
            lines += textwrap.wrap(what, width, initial_indent=f"{row.verdict.upper():11}", subsequent_indent=" " * 11)
            texts = {"claimed": row.expected, "ours": row.found, "asked": row.tolerance}
            shown = {MET: 2, REPORTED: 2, NEEDS_RUNS: 0}.get(row.verdict, 3)
            for name, text in list(texts.items())[:shown]:
                lines += textwrap.wrap(text, width, initial_indent=f"{'':11}{name + ':':9}", subsequent_indent=" " * 20)
            if row.verdict == NEEDS_RUNS:
                lines.append(f"{'':11}{row.found}")
            off = [f"{name} {value['found']}" for name, value in row.values.items() if value["verdict"] != MET]
            if off:
                lines += textwrap.wrap(
                    f"off: {'; '.join(off)}", width, initial_indent=" " * 11, subsequent_indent=" " * 20
                )
        return "\n".join([*lines, "", self.summary()])

    def to_markdown(self) -> str:
        """Return the table as Markdown, with the tolerances below it."""
        lines = ["| # | claim | source, grade | claimed | ours | verdict |", "|---|---|---|---|---|---|"]
        for number, row in enumerate(self.rows, 1):
            cells = (
                str(number),
                row.claim,
                f"{row.source}, {row.grade}",
                row.expected,
                row.found,
                f"**{row.verdict}**",
            )
            lines.append("| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |")
        lines += ["", f"{self.summary()}.", "", "How each is judged:", ""]
        lines += [f"{number}. `{row.key}`: {row.tolerance}." for number, row in enumerate(self.rows, 1)]
        return "\n".join(lines) + "\n"

    def to_html(self) -> str:
        """Return the page, with the figures in the folder `FIGURES` beside it."""
        parts = [_HEAD, f"<h1>{TITLE}</h1><p>{html.escape(self.summary())}</p>", "<table><tr>"]
        parts += [f"<th>{name}</th>" for name in ("#", "claim", "source", "claimed", "ours", "verdict")]
        parts.append("</tr>")
        for number, row in enumerate(self.rows, 1):
            words = (row.claim, f"{row.source} ({row.grade})", row.expected, row.found)
            cells = "".join(f"<td>{html.escape(text)}</td>" for text in words)
            parts.append(f'<tr><td><a href="#{row.key}">{number}</a></td>{cells}<td>{_badge(row)}</td></tr>')
        parts.append("</table>")
        for number, (row, figure) in enumerate(zip(self.rows, self.figures, strict=True), 1):
            parts.append(f'<h2 id="{row.key}">{number}. {html.escape(row.claim)} {_badge(row)}</h2>')
            for name, text in (
                ("source", f"{row.source}; {row.grade}: {GRADES[row.grade]}"),
                ("claimed", row.expected),
                ("judged by", row.tolerance),
                ("ours", row.found),
                ("runs", ", ".join(row.runs)),
            ):
                if text:
                    parts.append(f"<p><b>{name}</b>: {html.escape(text)}</p>")
            if row.values:
                parts.append("<table><tr><th>number</th><th>found</th><th>from</th><th>to</th><th></th></tr>")
                for name, value in row.values.items():
                    numbers = "".join(f"<td>{_number(value[key])}</td>" for key in ("found", "low", "high"))
                    parts.append(f"<tr><td>{html.escape(name)}</td>{numbers}<td>{value['verdict']}</td></tr>")
                parts.append("</table>")
            if figure:
                parts.append(f'<img src="{FIGURES}/{figure}" alt="{html.escape(row.claim)}">')
        return "\n".join([*parts, "</body></html>\n"])


_HEAD = """<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Claims beyond the paper</title><style>
body{font:15px/1.45 sans-serif;max-width:70em;margin:2em auto;padding:0 1em}table{border-collapse:collapse}
td,th{border:1px solid #ccc;padding:.3em .6em;text-align:left;vertical-align:top}h2{font-size:1.1em;margin-top:2.2em}
img{max-width:100%}.v{color:#fff;padding:.1em .5em;border-radius:.3em;white-space:nowrap}</style></head><body>"""


def _badge(row: Row) -> str:
    return f'<span class="v" style="background:{_COLOURS[row.verdict]}">{row.verdict}</span>'


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"


def check(
    maps: Maps,
    out: Path | None = None,
    keys: Sequence[str] = (),
    small: bool = False,
    progress: Callable[[float, float], None] | None = None,
) -> Report:
    """Check the claims; write their figures.

    Parameters
    ----------
    maps
        By the name of their sweep.
    out
        Directory of the page; figures are written into its folder `FIGURES`. None: none are drawn.
    keys
        Of the claims to check; () for all.
    small
        Whether the maps are coarse.
    progress
        Called with (claims done, claims) before each claim.

    Raises
    ------
    OSError
        If a figure cannot be written.
    """
    chosen = [claim for claim in CLAIMS if not keys or claim.key in keys]
    rows, figures = [], []
    for done, claim in enumerate(chosen):
        if progress:
            progress(done, len(chosen))
        row, finding = claim.judge(maps)
        rows.append(row)
        figures.append(_draw(row, finding, out))
    return Report(tuple(rows), tuple(figures), small)


def _draw(row: Row, finding: Finding | None, out: Path | None) -> str:
    if finding is None or out is None:
        return ""
    from bow_sweep.beyond.drawing import draw

    name = f"{row.key}.png"
    (out / FIGURES).mkdir(parents=True, exist_ok=True)
    draw(row, finding, out / FIGURES / name)
    return name


def write(report: Report, out: Path) -> list[Path]:
    """Write the page into a directory: HTML, Markdown and JSON; return the files.

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    texts = {PAGE: report.to_html(), "claims.md": report.to_markdown(), "claims.json": report.to_json()}
    for name, text in texts.items():
        with replacing(out / name) as file:
            file.write(text.encode())
    return [out / name for name in texts]
