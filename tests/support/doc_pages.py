"""The pages of the documentation as the tests see them: which files there are, and the code blocks in them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
RUN = ("bash", "python")
"""Languages of blocks that are run."""

SHOWN = ("text",)
"""Languages of blocks that are only shown: output, formulas, diagrams."""

FENCE = re.compile(r"^ *```(.*)$")
GENERATED = re.compile(r"<!-- begin: written by .*?<!-- end: written by .*?-->", re.DOTALL)
"""Parts that a script writes: tables and measurements."""


class Block(NamedTuple):
    """A fenced block: its page, the line of its fence counted from 1, its language and its text."""

    page: Path
    line: int
    language: str
    text: str


def name(page: Path) -> str:
    """Return the path of a page in the repository."""
    return page.relative_to(ROOT).as_posix()


def blocks(page: Path) -> Iterator[Block]:
    """Yield the fenced blocks of a page."""
    start, language, inside = 0, "", []
    for number, line in enumerate(page.read_text().splitlines(), 1):
        fence = FENCE.match(line)
        if fence and not start:
            start, language, inside = number, fence[1], []
        elif fence:
            yield Block(page, start, language, "\n".join(inside))
            start = 0
        else:
            inside.append(line)
    assert not start, f"{name(page)}, line {start}: the block does not end"


def prose(page: Path) -> str:
    """Return the text of a page without what scripts write and without blocks."""
    lines, inside = [], False
    for line in GENERATED.sub("", page.read_text()).splitlines():
        if FENCE.match(line):
            inside = not inside
        elif not inside:
            lines.append(line)
    return "\n".join(lines)
