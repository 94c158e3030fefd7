"""Writes docs/validation.md from a real `bow validate`, with the figures: `python -m studies.validation RUN...`.

The runs are those of fig11a ... fig11f, at full size. Exit status 1 if a claim fails.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

from bow_sim.figures.catalogue import FIGURES, figure
from bow_sim.figures.page import save
from bow_sim.kernel.sources import program
from bow_sweep.paper.validate import validate
from tools.doc_page import put

ROOT = Path(__file__).resolve().parent.parent
PIXELS_AN_INCH = 140  # small files


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", metavar="RUN", nargs="*", type=Path)
    parser.add_argument("--out", type=Path, default=ROOT / "docs", help="directory of validation.md and figures/")
    args = parser.parse_args()
    pictures = args.out / "figures"
    pictures.mkdir(parents=True, exist_ok=True)
    for number in FIGURES:
        drawn = figure(number)
        drawn.set_dpi(PIXELS_AN_INCH)
        save(drawn, pictures / f"fig{number:02}.png")
    report = validate(args.runs)
    named = replace(report, runs=tuple((Path(directory).name, title) for directory, title in report.runs))
    figures = "\n\n".join(f"![Fig {number}](figures/fig{number:02}.png)" for number in FIGURES)
    text = f"{named.to_markdown()}\nKernel: `{program()}`.\n\n## The line figures\n\n{figures}"
    put(text, args.out / "validation.md", "studies/validation.py")
    print(report.summary())
    return 0 if report.ok else 1


if __name__ == "__main__":
    sys.exit(main())
