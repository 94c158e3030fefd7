"""Draws the pictures of docs/architecture.md with Graphviz: `make diagrams`, after a change of what they are made from.

docs/diagrams/rooms.dot is written from the table of allowed imports in tests/support/rooms.py; processes.dot is written
by hand. Each .svg names the SHA-256 of its source, so that a test can tell without Graphviz whether it is up to date.
"""

from __future__ import annotations

import hashlib
import runpy
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "docs" / "diagrams"
TABLE = ROOT / "tests" / "support" / "rooms.py"
COLOURS = {"bow_sim": "#eaf4ea", "bow_classifier": "#eef3fb", "bow_sweep": "#fff6e0", "bow": "#f6eefb"}

HEAD = """\
// Which room may import which, from the table in tests/support/rooms.py. Written by tools/diagrams.py: make diagrams
digraph rooms {
  graph [rankdir=BT, fontname="Helvetica", nodesep=0.3, ranksep=0.6, bgcolor="white", style=rounded]
  node [shape=box, style="rounded,filled", fillcolor=white, color="#666666", fontname="Helvetica", fontsize=13]
  edge [color="#555555"]
"""


def reachable(arrows: Mapping[str, frozenset[str]], room: str) -> set[str]:
    """Return all rooms that a room imports, directly or through others."""
    found: set[str] = set()
    waiting = [room]
    while waiting:
        for other in arrows[waiting.pop()] - found:
            found.add(other)
            waiting.append(other)
    return found


def rooms_dot(arrows: Mapping[str, frozenset[str]]) -> str:
    """Return the picture of the rooms; an arrow that follows from others is left out."""
    text = HEAD
    for package, colour in COLOURS.items():
        text += f'\n  subgraph "cluster_{package}" {{\n    label="{package}"; bgcolor="{colour}"; color="#cccccc"\n'
        for room in sorted(arrows):
            if room.partition(".")[0] == package:
                label = room.partition(".")[2] or "(root)"
                text += f'    "{room}" [label="{label}"]\n'
        text += "  }\n"
    text += "\n"
    for room in sorted(arrows):
        direct = arrows[room]
        implied = {far for other in direct for far in reachable(arrows, other)}
        text += "".join(f'  "{room}" -> "{other}"\n' for other in sorted(direct - implied))
    return text + "}\n"


def table() -> Mapping[str, frozenset[str]]:
    """Return the table of allowed imports: room -> rooms that it may import."""
    arrows: Mapping[str, frozenset[str]] = runpy.run_path(str(TABLE))["ARROWS"]
    return arrows


def mark(source: Path) -> str:
    """Return the comment by which a picture names its source."""
    return f"<!-- {source.name} {hashlib.sha256(source.read_bytes()).hexdigest()} -->"


def problems() -> list[str]:
    """Return which pictures are not those of their sources; empty if all are."""
    found = []
    if (FOLDER / "rooms.dot").read_text() != rooms_dot(table()):
        found.append("docs/diagrams/rooms.dot is not what tests/support/rooms.py says: make diagrams")
    for source in sorted(FOLDER.glob("*.dot")):
        picture = source.with_suffix(".svg")
        if not picture.exists() or mark(source) not in picture.read_text():
            found.append(f"docs/diagrams/{picture.name} is not drawn from {source.name}: make diagrams")
    return found


def main() -> None:
    """Write rooms.dot and draw every picture."""
    if shutil.which("dot") is None:
        sys.exit("diagrams: no dot here; on Debian: sudo apt-get install graphviz")
    (FOLDER / "rooms.dot").write_text(rooms_dot(table()))
    for source in sorted(FOLDER.glob("*.dot")):
        svg = subprocess.run(["dot", "-Tsvg", source], capture_output=True, text=True, check=True).stdout
        source.with_suffix(".svg").write_text(svg + mark(source) + "\n")


if __name__ == "__main__":
    main()
