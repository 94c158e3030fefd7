"""The command `bow edges`: the boundaries of a map, bisected."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bow_sweep.cli.inspect import values_in
from bow_sweep.cli.terminal import fail, warn
from bow_sweep.processes.exit_status import DONE, FAILED, USAGE

if TYPE_CHECKING:
    import numpy as np
    from rich.table import Table

    from bow_sweep.edges.bisection import Edges
    from bow_sweep.edges.boundary import Boundary
    from bow_sweep.maps.map_file import MapFile

LISTED = 20
"""Edges in the table, at most; all are in edges.json."""


def add_command(commands: Any) -> None:
    """Add the parser of `edges`; its default `run` takes the parsed arguments."""
    parser = commands.add_parser(
        "edges",
        help="the boundaries of a map: bisect them, and say what decides",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Bisect the gesture between neighbouring cells of different outcome, until the two motions that\n"
        "remain differ by rounding only, and find where they part.\n\n"
        "The deciding step is the first sample at which one string slips and the other does not: one was released,\n"
        "or captured. The parting is the first period whose bridge forces differ by more than 0.3 r.m.s. (periods\n"
        "count from 0). There are four kinds of edges:\n\n"
        "  decision   the motions part within two periods of the deciding step: a critical event\n"
        "  grain      later: an earlier slip moved by one sample; the grid is too coarse to come nearer\n"
        "  unstable   the narrower the bracket, the later they part: a small difference grows\n"
        "  threshold  they have not parted at the end: only a threshold of the verdict lies between them\n\n"
        "The cells are computed here, without a graph; a hundred edges take about as long as 4400 cells of a sweep.\n"
        "Results are written into the run: edges.npz, edges.json and edges.png.",
        epilog="examples:\n"
        "  bow edges runs/fig11d --limit 200                        200 edges, spread over the map\n"
        "  bow edges runs/fig11d --at f_asym=3.1 --along y          all edges along y in the column nearest to 3.1\n"
        "  bow edges runs/fig11d --at f_asym=3.1,f_init_ratio=0.7   the edge nearest to this place\n"
        "  bow edges runs/fig11d --outcome regime --out /tmp/edges  between regimes, with the files elsewhere\n\n"
        "exit status: 0 done; 1 there is no edge, or a file cannot be written; 2 wrong usage",
    )
    parser.add_argument("run_directory", metavar="RUN", type=Path, help="run directory of `bow sweep`")
    parser.add_argument("--along", choices=("x", "y", "both"), default="both",
                        help="which neighbours: along x, along y, or both (default)")  # fmt: skip
    parser.add_argument("--at", metavar="NAME=VALUE[,...]", dest="place",
                        help="with both axes, the edge nearest to this place; with one, those of that row")  # fmt: skip
    parser.add_argument("--limit", metavar="N", type=int, help="N edges at most, spread evenly; with --at the nearest")
    parser.add_argument("--outcome", choices=("helmholtz", "reached", "regime"), default="helmholtz",
                        help="what must differ: whether the last test finds Helmholtz motion (default), whether any "
                        "test does, or the name of the motion at the last test")  # fmt: skip
    parser.add_argument("--halvings", metavar="N", type=int, default=44, help="of each cell (default 44)")
    parser.add_argument("--out", metavar="DIR", type=Path, help="write the files into this directory instead")
    parser.set_defaults(run=_edges)


def _edges(args: argparse.Namespace) -> int:
    from bow_sim.physics.errors import ParameterError
    from bow_sweep.cell.run_cells import RunCells
    from bow_sweep.cell.waveform import CellError
    from bow_sweep.edges.bisection import bisect
    from bow_sweep.edges.boundary import EdgesError, NoEdges, edges_of
    from bow_sweep.processes.progress import percentages

    target = args.out or args.run_directory
    try:
        _check(args)
        with RunCells(args.run_directory, percentages("reading the bag")) as cells:
            found, sweep = cells.map, cells.sweep
        _check_directory(target)
        everything = edges_of(found, args.outcome, args.along)
        chosen = _chosen(args, everything, found)
        edges = bisect(sweep, everything.only(chosen), args.outcome, args.halvings, percentages("bisecting"))
    except EdgesError as error:
        return fail(f"{args.run_directory}: {error}", FAILED if isinstance(error, NoEdges) else USAGE)
    except (CellError, ParameterError, _Wrong) as error:
        return fail(str(error))
    if edges.unlike:
        warn(f"{edges.unlike} of {len(chosen)} edges have one outcome on both sides here: another kernel made the map")
    if not len(edges):
        return fail(f"{args.run_directory}: no edge is left", FAILED)
    return _write(args, target, edges, found, everything, chosen)


class _Wrong(ValueError):
    """An option has a wrong value."""


def _check(args: argparse.Namespace) -> None:
    if args.limit is not None and args.limit < 1:
        raise _Wrong(f"--limit {args.limit}: must be at least 1")
    if not 1 <= args.halvings <= 60:
        raise _Wrong(f"--halvings {args.halvings}: must be 1 ... 60; after about 50 a bracket has no middle any more")


def _check_directory(directory: Path) -> None:
    """Refuse what cannot be written before anything is computed."""
    if not directory.is_dir():
        raise _Wrong(f"--out {directory}: is no directory")
    if not os.access(directory, os.W_OK | os.X_OK):
        raise _Wrong(f"{directory}: cannot be written; give --out DIR")


def _chosen(args: argparse.Namespace, everything: Boundary, found: MapFile) -> np.ndarray:
    """Return the numbers of the edges to bisect."""
    from bow_sweep.edges.boundary import in_row, nearest, spread

    if args.place is None:
        return spread(len(everything), args.limit or len(everything))
    place = values_in(args.place)
    if len(place) == 2:
        return nearest(everything, found.axes, place, args.limit or 1)
    row = in_row(everything, found.axes, place)
    return row[spread(len(row), args.limit or len(row))]


def _write(
    args: argparse.Namespace, target: Path, edges: Edges, found: MapFile, everything: Boundary, chosen: np.ndarray
) -> int:
    """Print the table and write the files; return the exit status."""
    import numpy as np
    from rich.console import Console

    from bow_sweep.edges.edges_file import ARRAYS, PICTURE, REPORT, write
    from bow_sweep.edges.picture import draw_edges

    left_out = everything.only(np.setdiff1d(np.arange(len(everything)), chosen))
    console = Console(width=200, highlight=False, markup=False, soft_wrap=True)
    console.print(_table(edges, found))
    if len(edges) > LISTED:
        print(f"{len(edges) - LISTED} more edges are in {REPORT}")
    print(
        f"{len(edges)} edge{'s' * (len(edges) > 1)}: "
        + ", ".join(f"{name} {count}" for name, count in edges.counts().items())
    )
    try:
        write(target, edges, found)
        draw_edges(edges, found, target / PICTURE, left_out)
    except OSError as error:
        return fail(f"{error.filename or target}: cannot be written: {error.strerror}", FAILED)
    print(f"wrote {', '.join(str(target / name) for name in (ARRAYS, REPORT, PICTURE))}")
    return DONE


def _table(edges: Edges, found: MapFile) -> Table:
    """Return the first edges as a table for a terminal."""
    from rich.table import Table

    from bow_sweep.edges.edges_file import entries
    from bow_sweep.maps.plane import regime_label

    shown = Table(title=f"edges; outcome: {edges.outcome}; times in nominal periods", title_justify="left")
    for name in ("along", "at", "between", "width", "decided", "by", "parting", "kind"):
        shown.add_column(name, justify="right" if name in ("width", "decided", "parting") else "left")
    for each in entries(edges, found)[:LISTED]:
        (name, value), *_ = each["fixed"].items()
        step, parting, growth = each["step_periods"], each["parting"], each["growth"]
        shown.add_row(
            f"{each['along']} = {each['low']:.6g}",
            f"{name} = {value:.4g}",
            " / ".join(regime_label(regime) for regime in each["regimes"]),
            f"{each['width']:.1e}",
            "-" if step is None else f"{step:.2f}",
            each["event"] or "-",
            "-" if parting is None else str(parting),
            each["kind"] + (f", {growth:.2f} a period" if growth is not None else ""),
        )
    return shown
