"""The command `bow plot`: maps as a figure for a paper."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import Any

from bow_sweep.cli.terminal import fail
from bow_sweep.processes.exit_status import DONE, FAILED

STYLES = ("paper", "serif", "slides")

UNITS_MM = {"mm": 1.0, "cm": 10.0, "in": 25.4, "pt": 25.4 / 72.27, "": 1.0}
"""Units of length in mm; pt is that of TeX."""


def add_command(commands: Any) -> None:
    """Add the parser of `plot`; its default `run` takes the parsed arguments."""
    parser = commands.add_parser(
        "plot",
        help="maps as a figure for a paper",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Draw the maps of one or several runs as a figure for a paper: as wide as a column, with the\n"
        "symbols and units of theory on its axes, as vectors with their fonts embedded, in colours that colour-blind\n"
        "people can distinguish, with the limits of theory as lines where the plane has them. Settings that are the\n"
        "same in all cells are for the caption: --caption prints it.\n\n"
        "Each run has a panel for each layer; panels that show the same share one scale:\n\n"
        "  transient    periods until Helmholtz motion (the default)\n"
        "  regime       what the string does at a test; a letter in each large area\n"
        "  correlation, slips, corners   results of the three tests (section III.B)\n"
        "  confidence   probability that the regime is right\n"
        "  terrain      the five kinds of terrain (section IV.B)\n"
        "  reliability  share of the repeats of a cell that end alike; of runs with --set repeats=N",
        epilog="examples:\n"
        "  bow plot runs/fig11d --out fig.pdf                          one column, 86 mm wide\n"
        "  bow plot runs/fig11c runs/fig11d --out fig.pdf              two panels, (a) and (b), and their scale\n"
        "  bow plot runs/fig11? --out fig.pdf --width 180mm            in two columns\n"
        "  bow plot runs/fig11d --layer transient,regime --width 180mm --out fig.svg\n"
        "  bow plot runs/fig10 --layer correlation --after 40 --out fig.png --dpi 600\n"
        "  bow plot runs/fig11d --out fig.pdf --caption latex > caption.tex\n\n"
        "exit status: 0 done, 1 cannot be written, 2 wrong usage",
    )
    parser.add_argument("runs", metavar="RUN", nargs="+", type=Path, help="run directory of `bow sweep`, or a map.npz")
    parser.add_argument("--layer", metavar="L", action="append", default=[],
                        help="what to show, see above; several with commas, or by several --layer")  # fmt: skip
    parser.add_argument("--out", metavar="F", type=Path, help="file: .pdf, .svg or .png by its suffix")
    parser.add_argument("--caption", nargs="?", const="plain", choices=("plain", "latex"),
                        help="print the caption, as plain text or for LaTeX; needs no --out")  # fmt: skip
    parser.add_argument("--width", metavar="W", default="86mm",
                        help="of the whole figure, in mm, cm, in or pt (default: 86mm, a column)")  # fmt: skip
    parser.add_argument("--columns", metavar="N", type=int, help="panels beside each other (default: 2 from 120 mm on)")
    parser.add_argument("--style", choices=STYLES, default="paper",
                        help="paper: letters of 7 and 8 points; serif: with serifs; slides: larger")  # fmt: skip
    parser.add_argument("--after", metavar="PERIODS", type=float, help="time of the test (default: the last)")
    parser.add_argument("--title", metavar="T", action="append", default=[],
                        help="of a panel, once for each, with $TeX$ (default: what differs)")  # fmt: skip
    parser.add_argument("--shape", metavar="S", type=float, help="height of a panel over its width")
    parser.add_argument("--dpi", metavar="N", type=float, default=300.0, help="dots an inch of a .png (default: 300)")
    parser.set_defaults(run=_plot)


def _plot(args: argparse.Namespace) -> int:
    from bow.maps import open_run
    from bow.pictures import picture
    from bow_sim.figures.page import check_path

    layers = [word.strip() for text in args.layer for word in text.split(",")] or ["transient"]
    try:
        if args.out is None and args.caption is None:
            return fail("nothing to do: give --out FILE for the figure, --caption for its caption, or both")
        if args.out is not None:
            check_path(args.out)
        made = picture(
            [open_run(run) for run in args.runs],
            layers,
            width_mm=length_mm(args.width),
            periods=args.after,
            titles=args.title,
            columns=args.columns,
            style=args.style,
            dpi=args.dpi,
            shape=args.shape,
        )
        if args.out is not None:
            made.save(args.out)
    except ValueError as error:
        return fail(str(error))
    except OSError as error:
        return fail(f"--out {args.out}: cannot be written: {error.strerror or error}", FAILED)
    if args.caption:
        print(made.latex if args.caption == "latex" else made.caption)
    else:
        print(f"wrote {args.out}")
    return DONE


def length_mm(text: str) -> float:
    """Return a length in mm.

    Raises
    ------
    ValueError
        For a text that is no length.
    """
    found = re.fullmatch(r"([0-9]+\.?[0-9]*|\.[0-9]+) *(mm|cm|in|pt|)", text.strip())
    if not found:
        raise ValueError(f"--width {text}: should be a length such as 86mm, 8.6cm, 3.4in or 246pt")
    return float(found[1]) * UNITS_MM[found[2]]
