"""The command `bow explore`: maps of runs in the browser, and their cells seen and heard."""

from __future__ import annotations

import argparse
import importlib.util
from pathlib import Path
from typing import Any

from bow_sweep.cli.terminal import fail, warn
from bow_sweep.processes.exit_status import DONE

NO_BOKEH = "explore: needs Bokeh, which is not installed here; pip install 'bokeh>=3.4,<4', or make setup"


def add_command(commands: Any) -> None:
    """Add the parser of `explore`; its default `run` takes the parsed arguments."""
    parser = commands.add_parser(
        "explore",
        help="open runs in the browser: click a cell, see and hear it",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Show the map of a run in the browser. Choose what it shows (transient length, regime, the three\n"
        "tests, confidence, terrain); hover over a cell for its parameters and what was found; click it for its\n"
        "bridge force, the intervals in which the string slips, spectrum with harmonics, and sound. Arrow keys go to\n"
        "the neighbouring cells. Two runs are shown side by side with the nearest cell chosen in both; where both\n"
        "have the same plane, their difference is a map too.\n\n"
        "A cell's samples are read from the run's bag; without a bag they are computed again, and the page says so.\n"
        "The page is served to this machine only (127.0.0.1), until Ctrl-C.",
        epilog="examples:\n"
        "  bow explore runs/fig11d                            opens a browser; Ctrl-C ends it\n"
        "  bow explore runs/fig11c runs/fig11d --no-browser   prints the address only\n"
        "  bow explore runs/fig11d --save fig11d.html         one file to pass on: opens without bow and without a\n"
        "                                                     network, with the last periods of every cell\n\n"
        "exit status: 0 done (also after Ctrl-C), 1 cannot be written, 2 wrong usage",
    )
    parser.add_argument("runs", metavar="RUN", nargs="+", type=Path, help="run directory; one or two")
    parser.add_argument("--port", metavar="P", type=int, default=0, help="port on 127.0.0.1 (default: a free one)")
    parser.add_argument("--no-browser", action="store_true", help="open no browser, print the address only")
    parser.add_argument("--save", metavar="F", type=Path, help="write the page as one .html file, and serve nothing")
    parser.add_argument(
        "--periods", metavar="N", type=int, help="with --save: last periods of every cell in the file (default 5)"
    )
    parser.set_defaults(run=_explore)


def _explore(args: argparse.Namespace) -> int:
    if len(args.runs) > 2:
        return fail(f"explore: {len(args.runs)} runs given; should be one or two")
    if not 0 <= args.port <= 65535:
        return fail(f"--port {args.port}: should be 1 ... 65535, or left out for a free one")
    if args.periods is not None and args.save is None:
        return fail("--periods: is for --save; a served page has whole waveforms")
    if args.save is not None and (args.port or args.no_browser):
        return fail("--save: writes a file and serves nothing; --port and --no-browser do not go with it")
    if importlib.util.find_spec("bokeh") is None:
        return fail(NO_BOKEH)
    from bow_sweep.cell.waveform import CellError
    from bow_sweep.maps.compare import names

    try:
        if args.save is not None:
            return _save(args, names(args.runs))
        return _serve(args, names(args.runs))
    except CellError as error:
        return fail(str(error))


def _serve(args: argparse.Namespace, names: list[str]) -> int:
    from bow_sweep.explore.browser import open_in_browser
    from bow_sweep.explore.served import PortError, serve
    from bow_sweep.processes.progress import percentages

    def started(address: str) -> None:
        print(f"{address}  shows {' and '.join(names)}; Ctrl-C ends it", flush=True)
        if not args.no_browser:
            open_in_browser(address, lambda why: warn(f"{why}; open {address} yourself"))

    try:
        serve(args.runs, names, args.port, started, percentages("explore: reading the bag"))
    except PortError as error:
        return fail(str(error))
    return DONE


def _save(args: argparse.Namespace, names: list[str]) -> int:
    from bow_sweep.explore.saved import PageError, save_page
    from bow_sweep.processes.exit_status import FAILED
    from bow_sweep.processes.progress import percentages

    try:
        said = save_page(args.runs, names, args.save, args.periods, percentages("explore"))
    except PageError as error:
        return fail(str(error))
    except OSError as error:
        return fail(f"--save {args.save}: cannot be written: {error.strerror}", FAILED)
    print(f"wrote {args.save}: {said}")
    return DONE
