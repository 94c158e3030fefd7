"""The command `bow repeats`: how sure the map of a run is, from the repeats of its cells."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bow_sweep.cli.terminal import fail, warn
from bow_sweep.processes.exit_status import DONE, FAILED

if TYPE_CHECKING:
    import numpy as np

    from bow_sweep.cell.run_cells import RunCells


def add_command(commands: Any) -> None:
    """Add the parser of `repeats`; its default `run` takes the parsed arguments."""
    parser = commands.add_parser(
        "repeats",
        help="how sure the map of a run is: what its repeats end as, and when their motions part",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Say what the repeats of a run of `bow sweep --set repeats=8` tell: in how many cells they end as\n"
        "the cell itself, regime by regime, and after how many periods their motions part from that of the cell. A\n"
        "motion parts at the first slip that begins more than 3 samples earlier or later. The slips are read from the\n"
        "run's bag, or computed again where it does not hold them, and their checksums are checked.",
        epilog="examples:\n"
        "  bow sweep fig11d --nx 32 --ny 16 --set repeats=8 --out runs/sure\n"
        "  bow repeats runs/sure --plot sure.png\n"
        "  bow repeats runs/sure --npz partings.npz               for programs: parting (repeats, ny, nx), periods\n\n"
        "exit status: 0 done; 1 a file cannot be written; 2 wrong usage, or a run without repeats",
    )
    parser.add_argument("run_directory", metavar="RUN", type=Path, help="run directory of `bow sweep`")
    parser.add_argument("--plot", metavar="F", type=Path, help="also draw maps: .png, .svg or .pdf by the suffix of F")
    parser.add_argument("--npz", metavar="F.npz", type=Path, help="also write the partings as arrays")
    parser.set_defaults(run=_repeats)


def _repeats(args: argparse.Namespace) -> int:
    from bow_sim.figures.page import FigureError, check_path
    from bow_sweep.cell.parting import median_parting, partings
    from bow_sweep.cell.run_cells import RunCells
    from bow_sweep.cell.waveform import CellError
    from bow_sweep.processes.progress import percentages

    try:
        if args.plot:
            check_path(args.plot)
        if args.npz and args.npz.suffix != ".npz":
            raise CellError(f"--npz {args.npz}: should end in .npz")
        with RunCells(args.run_directory, percentages("reading the index of the bag")) as cells:
            if cells.map.reliability is None:
                again = "sweep again with --set repeats=8"
                raise CellError(f"{args.run_directory}: its cells were not repeated; {again}")
            found = partings(cells.bag, percentages("reading the slips")) if cells.bag is not None else None
            _print(cells, found)
    except (CellError, FigureError) as error:
        return fail(str(error))
    try:
        if args.npz and found is not None:
            _write(args.npz, cells, found)
        if args.plot:
            from bow_sweep.figures.reliability import draw_repeats

            draw_repeats(cells.map, None if found is None else median_parting(found), args.plot)
            print(f"wrote {args.plot}")
    except OSError as error:
        return fail(f"{error.filename or 'a file'}: cannot be written: {error.strerror}", FAILED)
    return DONE


def _print(cells: RunCells, found: np.ndarray | None) -> None:
    import numpy as np

    from bow_sweep.maps.plane import regime_label
    from bow_sweep.maps.reliability import in_words

    plane, sure = cells.map, cells.map.reliability
    assert sure is not None
    print("\n".join(in_words(sure.findings(cells.sweep.repeats, np.nan_to_num(plane.transient_periods) > 0))))
    print(f"\n  {'cells that end in':24} {'cells':>6} {'reliable':>9} {'end alike':>10} {'parting, periods':>17}")
    for code, name in enumerate(plane.regime_names):
        there = (plane.regime == code) & sure.known
        if there.any():
            shares = f"{sure.reliable[there].mean():9.3f} {np.nanmean(sure.reliability[there]):10.3f}"
            parts = "" if found is None else f" {_median(found[:, there]):>17}"
            print(f"  {regime_label(name):24} {there.sum():6d} {shares}{parts}")
    if found is None:
        warn(f"{cells.directory}: has no bag, so it is not known when the motions part")
        return
    known = ~np.isnan(found)
    if not known.any() and cells.bag is not None and cells.bag.outline.record != "all":
        record = cells.bag.outline.record
        warn(f"the slips are not recorded (record={record}), and this kernel gives others: nothing is known of them")
    if known.any():
        print(f"\nmotions part after {_median(found)} periods (median); {np.isinf(found[known]).mean():.3f} never do")


def _median(partings: np.ndarray) -> str:
    """Return the median of some partings as text; "never" where fewer than half of the motions part."""
    import numpy as np

    known = np.sort(partings[~np.isnan(partings)])
    middle = known[(len(known) - 1) // 2] if len(known) else np.nan
    return "never" if np.isinf(middle) else "not known" if np.isnan(middle) else f"{middle:.1f}"


def _write(path: Path, cells: RunCells, found: np.ndarray) -> None:
    import numpy as np

    from bow_sim.atomic_files import replacing
    from bow_sweep.cell.parting import median_parting

    names = {"run_id": np.array(cells.map.run_id), "sweep_id": np.array(cells.map.sweep_id)}
    with replacing(path) as file:
        np.savez(file, allow_pickle=False, parting=found, median_parting=median_parting(found), **names)
    print(f"wrote {path}: parting {found.shape}")
