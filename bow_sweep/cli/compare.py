"""The command `bow compare`: terrain and playability of several runs."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from bow_sweep.maps.compare import Compared
    from bow_sweep.maps.differing import Differing

from bow_sweep.cli.terminal import fail
from bow_sweep.processes.exit_status import DONE


def add_command(commands: Any) -> None:
    """Add the parser of `compare`; its default `run` takes the parsed arguments."""
    parser = commands.add_parser(
        "compare",
        help="compare runs: settings, terrain and playability",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Print which settings differ between several runs, and what else made them: presets, kernel,\n"
        "classifier, versions. Then measure how easy the string is to play in each, as a table: the share of\n"
        "gestures that reach Helmholtz motion, their largest contiguous area, median and interquartile range of\n"
        "their transient lengths, the length of the boundary, and the areas of the five kinds of terrain in\n"
        "section IV.B of the paper:\n\n"
        "  black                  cannot be played\n"
        "  smooth                 a small change of gesture changes the transient a little: docile\n"
        "  speckle without black  Helmholtz motion is safe, but transients are uneven\n"
        "  speckle with black     success and failure without order: dangerous\n"
        "  streaky                success and failure in streaks: the same to a player\n\n"
        "Each number has its uncertainty, from the four interleaved grids of half the density. For two runs the\n"
        "difference is shown too. It is marked as sure, *, where it is above three uncertainties and is also seen on\n"
        "the coarser grids.",
        epilog="examples:\n"
        "  bow compare runs/fig11c runs/fig11d                    delta against stiff, with the difference\n"
        "  bow compare runs/fig11? --out compared.png             the same as a picture, with maps and terrain\n"
        "  bow compare runs/a runs/b --json > compared.json       for programs\n\n"
        "exit status: 0 done, 2 wrong usage",
    )
    parser.add_argument("runs", metavar="RUN", nargs="+", type=Path, help="run directory, or a map.npz; two or more")
    parser.add_argument("--out", metavar="F", type=Path, help="also draw them: .png, .svg or .pdf by its suffix")
    parser.add_argument("--json", action="store_true", help="print JSON rather than a table")
    parser.set_defaults(run=_compare)


def _compare(args: argparse.Namespace) -> int:
    from bow_sim.figures.page import FigureError, check_path
    from bow_sweep.figures.terrain import draw_comparison
    from bow_sweep.maps.compare import as_json, compare, notes, programs_that_differ, settings_that_differ
    from bow_sweep.maps.map_file import MapFileError

    try:
        if args.out:
            check_path(args.out)
        found = compare(args.runs)
    except (MapFileError, FigureError) as error:
        return fail(str(error))
    if args.json:
        print(json.dumps(as_json(found), indent=2))
    else:
        from rich.console import Console

        width = None if sys.stdout.isatty() else 200
        console = Console(width=width, highlight=False, markup=False)
        names = [each.name for each in found]
        settings, programs = settings_that_differ(found), programs_that_differ(found)
        console.print(_differing(names, settings, "settings that differ") if settings else "no setting differs")
        if programs:
            console.print(_differing(names, programs, "made by"))
        console.print(_table(found))
        for note in notes(found):
            print(f"note: {note}")
    if args.out:
        try:
            draw_comparison(found, args.out)
        except OSError as error:
            return fail(f"--out {args.out}: cannot be written: {error.strerror}")
        print(f"wrote {args.out}", file=sys.stderr if args.json else sys.stdout)
    return DONE


LONGEST = 48
"""Letters of a value in the table of settings; a longer one is cut."""


def _differing(names: Sequence[str], rows: Sequence[Differing], title: str) -> Table:
    """Return what differs between runs as a table: a row for each setting, a column for each run."""
    from rich.table import Table

    shown = Table(title=title, title_justify="left")
    units = any(row.unit for row in rows)
    for heading in ("setting" if units else "", *names, *(["unit"] if units else [])):
        shown.add_column(heading)
    for row in rows:
        values = ["-" if value is None else value or "none" for value in row.values]
        cut = [value if len(value) <= LONGEST else value[: LONGEST - 1] + "\u2026" for value in values]
        shown.add_row(row.name, *cut, *([row.unit] if units else []))
    return shown


def _table(found: Sequence[Compared]) -> Table:
    """Return the numbers as a table for a terminal: a row for each measure, a column for each run.

    For two runs a last column gives their difference.
    """
    from rich.table import Table

    from bow_sweep.maps.compare import difference, sure, value_and_error
    from bow_sweep.maps.playability import MEASURES

    shown = Table(title="playability; ± from the four interleaved grids of half the density", title_justify="left")
    shown.add_column("measure")
    for each in found:
        shown.add_column(f"{each.name}\n{each.title}", justify="right")
    if len(found) == 2:
        shown.add_column("difference\n* is sure", justify="right")
    for measure in MEASURES:
        unit = f", {measure.unit}" if measure.unit else ""
        row = [measure.title + unit]
        row += [measure.text(*value_and_error(each.numbers, measure.name)) for each in found]
        if len(found) == 2:
            step, error = difference(found[0], found[1], measure.name)
            mark = " *" if sure(found[0], found[1], measure.name) else "  "
            row.append(measure.text(step, error, signed=True) + mark)
        shown.add_row(*row)
    return shown
