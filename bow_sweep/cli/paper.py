"""The commands `bow figure` and `bow validate`: the paper's pictures and the paper's claims."""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path
from typing import Any

from bow_sim.atomic_files import replacing
from bow_sweep.processes.progress import percentages

DONE, FAILED, USAGE = 0, 1, 2

MAP_FIGURES = (10, 11)
"""Figures that are drawn from runs."""

_FIGURES = {
    2: "impulse responses g(t): delta/Cremer, stiff/Cremer, torsional",
    3: "mode frequency over n, 30 modes",
    4: "Q factors of the same modes",
    5: "surface velocity of a transient, bow force 5.5",
    6: "the periodic motion it ends in: surface, centre, bridge force",
    7: "incident velocity v_h with the limits of hysteresis",
    8: "as Fig 5 with bow force 5.3",
    9: "friction curves, v_mid = -2, 0.2, 0.9",
    10: "the three tests after 40 periods; RUN is a run of fig10 or fig11d",
    11: "transient length over the plane; RUN... are runs of fig11a ... fig11f, in any order",
    12: "contours of initial bow force on the axes of Fig 11",
}


def add_commands(commands: Any) -> None:
    """Add the parsers of `figure` and `validate`; each has a default `run` that takes the arguments."""
    listed = "\n".join(f"  {number:2}  {words}" for number, words in _FIGURES.items())
    figure = commands.add_parser(
        "figure",
        help="draw a figure of the paper",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Draw a figure of Schumacher and Woodhouse (1995), computed anew.",
        epilog=f"figures:\n{listed}\n\nexamples:\n"
        "  bow figure 5 --out fig5.png\n"
        "  bow figure 7 --out fig7.pdf\n"
        "  bow figure 10 runs/fig11d --out fig10.png\n"
        "  bow figure 11 runs/fig11? --out fig11.svg\n\n"
        "exit status: 0 done, 2 wrong usage",
    )
    figure.add_argument("number", metavar="N", help="2 ... 12")
    figure.add_argument("runs", metavar="RUN", nargs="*", type=Path, help="run directories, for Figs 10 and 11 only")
    figure.add_argument("--out", metavar="F", type=Path, required=True, help="file: .png, .svg or .pdf by its suffix")
    figure.set_defaults(run=_figure)

    validate = commands.add_parser(
        "validate",
        help="hold this program against what the paper states",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Print what the paper claims, where, what this program finds, and a verdict for each claim:\n"
        "pass or fail by a tolerance that --markdown and --json give with its reason, report where the\n"
        "paper gives nothing to hold a number against, needs runs where it speaks of a map that was not given.",
        epilog="examples:\n"
        "  bow validate                                  all claims about one string\n"
        "  bow validate runs/fig11?                      those about the maps of Figs 10 and 11 too\n"
        "  bow validate --json v.json --markdown v.md\n\n"
        "Runs are known by their settings. A map coarser than 128 x 64 cells or shorter than 100 periods is\n"
        "measured, but not judged.\n\n"
        "exit status: 0 no claim fails, 1 one does, 2 wrong usage",
    )
    validate.add_argument("runs", metavar="RUN", nargs="*", type=Path, help="run directory, or a map.npz")
    validate.add_argument("--json", metavar="F", type=Path, help="also write the table for programs")
    validate.add_argument("--markdown", metavar="F", type=Path, help="also write the table as Markdown")
    validate.set_defaults(run=_validate)


def _fail(message: str) -> int:
    print(f"bow: {message}", file=sys.stderr)
    return USAGE


def _figure(args: argparse.Namespace) -> int:
    number = int(args.number) if args.number.isdecimal() else 0
    if number not in _FIGURES:
        return _fail(f"figure {args.number}: the paper's figures are 2 ... 12")
    if args.runs and number not in MAP_FIGURES:
        return _fail(f"figure {number}: is drawn without a run; only Figs 10 and 11 take one")
    from bow_sweep.maps.map_file import MapFileError

    try:
        if number in MAP_FIGURES:
            draw_maps(number, args.runs, args.out)
        else:
            from bow_sim.figures.catalogue import write

            write(number, args.out)
    except (MapFileError, ValueError) as error:
        return _fail(str(error))
    except OSError as error:
        return _fail(f"--out {args.out}: cannot be written: {error.strerror}")
    print(f"wrote {args.out}")
    return DONE


def draw_maps(number: int, runs: list[Path], out: Path) -> None:
    """Draw Fig 10 or 11 from runs.

    Raises
    ------
    MapFileError
        Where they are not the runs that the figure needs.
    """
    from bow_sweep.maps.map_file import MapFileError, read_map
    from bow_sweep.paper.maps import FIG10_PERIODS, LAYOUT, recognise
    from bow_sweep.view.map_figures import draw_maps, draw_tests

    if number == 10:
        if len(runs) != 1:
            raise MapFileError(f"figure 10: {len(runs)} runs given; should be one, of fig10 or fig11d")
        draw_tests(read_map(runs[0]), out, FIG10_PERIODS)
        return
    if not runs:
        raise MapFileError("figure 11: no runs given; should be runs of fig11a ... fig11f")
    maps = recognise(runs).maps
    titles = {
        letter: rf"({letter})  {model.replace('_cremer', '')}/Cremer, $v_\mathrm{{mid}}$ = {v_mid:g}".replace("-", "−")
        for letter, (model, v_mid) in LAYOUT.items()
    }
    draw_maps([(titles[letter], maps[letter]) for letter in LAYOUT if letter in maps], out)


def _validate(args: argparse.Namespace) -> int:
    from bow_sweep.maps.map_file import MapFileError
    from bow_sweep.paper.validate import validate

    try:
        report = validate(args.runs, percentages("validate"))
    except MapFileError as error:
        return _fail(str(error))
    width = min(max(shutil.get_terminal_size((120, 24)).columns, 60), 140)
    print(report.to_text(width))
    for path, text in ((args.json, report.to_json()), (args.markdown, report.to_markdown())):
        if path is not None:
            try:
                with replacing(path) as file:
                    file.write(text.encode())
            except OSError as error:
                return _fail(f"{path}: cannot be written: {error.strerror}")
            print(f"wrote {path}")
    return DONE if report.ok else FAILED
