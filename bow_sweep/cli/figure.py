"""The command `bow figure`: the paper's pictures."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from bow_sweep.cli.terminal import fail
from bow_sweep.processes.exit_status import DONE

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


def add_command(commands: Any) -> None:
    """Add the parser of `figure`; its default `run` takes the parsed arguments."""
    listed = "\n".join(f"  {number:2}  {words}" for number, words in _FIGURES.items())
    parser = commands.add_parser(
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
    parser.add_argument("number", metavar="N", help="2 ... 12")
    parser.add_argument("runs", metavar="RUN", nargs="*", type=Path, help="run directories, for Figs 10 and 11 only")
    parser.add_argument("--out", metavar="F", type=Path, required=True, help="file: .png, .svg or .pdf by its suffix")
    parser.set_defaults(run=_figure)


def _figure(args: argparse.Namespace) -> int:
    number = int(args.number) if args.number.isdecimal() else 0
    if number not in _FIGURES:
        return fail(f"figure {args.number}: the paper's figures are 2 ... 12")
    if args.runs and number not in MAP_FIGURES:
        return fail(f"figure {number}: is drawn without a run; only Figs 10 and 11 take one")
    from bow_sweep.maps.map_file import MapFileError

    try:
        if number in MAP_FIGURES:
            draw_maps(number, args.runs, args.out)
        else:
            from bow_sim.figures.catalogue import write

            write(number, args.out)
    except (MapFileError, ValueError) as error:
        return fail(str(error))
    except OSError as error:
        return fail(f"--out {args.out}: cannot be written: {error.strerror}")
    print(f"wrote {args.out}")
    return DONE


def draw_maps(number: int, runs: list[Path], out: Path) -> None:
    """Draw Fig 10 or 11 from runs.

    Raises
    ------
    MapFileError
        Where they are not the runs that the figure needs.
    """
    from bow_sweep.figures.maps import draw_maps, draw_tests
    from bow_sweep.maps.map_file import MapFileError, read_map
    from bow_sweep.paper.maps import FIG10_PERIODS, LAYOUT, recognise

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
