"""Puts the page of `bow validate --beyond --out DIR` into docs/validation.md: `python -m studies.beyond DIR`."""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

from bow_sweep.beyond.report import FIGURES
from tools.doc_page import put

ROOT = Path(__file__).resolve().parent.parent

SHOWN = {
    "wolf-beat": "The beat of the wolf of 1983 over bow force",
    "least-force": "Least sustained force with a mode of the body near the note",
    "guettler-area": "Guettler's plane of cello string C: perfect, below 20 periods, longer, none",
    "schelleng-upper": "Schelleng's plane of a cello G string, thermal friction, 0.1 m/s",
}
"""Claims whose figures the documentation shows, and what they show."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", metavar="DIR", type=Path)
    parser.add_argument("--out", type=Path, default=ROOT / "docs", help="directory of validation.md and figures/")
    args = parser.parse_args()
    for key in SHOWN:
        shutil.copy(args.directory / FIGURES / f"{key}.png", args.out / "figures" / f"beyond-{key}.png")
    figures = "\n\n".join(f"![{title}](figures/beyond-{key}.png)" for key, title in SHOWN.items())
    table = (args.directory / "claims.md").read_text(encoding="utf-8")
    put(f"{table}\n{figures}", args.out / "validation.md", "studies/beyond.py")


if __name__ == "__main__":
    main()
