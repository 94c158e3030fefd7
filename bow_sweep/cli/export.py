"""The command `bow export`: the map of a run as a file for other programs."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from bow_sweep.cli.terminal import fail
from bow_sweep.processes.exit_status import DONE, FAILED


def add_command(commands: Any) -> None:
    """Add the parser of `export`; its default `run` takes the parsed arguments."""
    parser = commands.add_parser(
        "export",
        help="the map of a run as netCDF, CSV or Parquet",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Write the map of a run for other programs. The suffix sets the format:\n\n"
        "  .nc       netCDF 4: every test of every cell, axes with units, regimes as CF flags, every setting as an\n"
        "            attribute; xarray.open_dataset(...) reads it. Needs xarray and h5netcdf: pip install 'bow[data]'\n"
        "  .csv      a line for each cell: its two parameters, transient length, regime, terrain, and the last test\n"
        "  .parquet  the same as columns, for pandas, polars and DuckDB\n\n"
        "map.npz in the run's directory has the same arrays for NumPy; in Python, bow.open(RUN).ds is the dataset.",
        epilog="examples:\n"
        "  bow export runs/fig11d --to fig11d.nc\n"
        "  bow export runs/fig11d --to fig11d.csv\n\n"
        "exit status: 0 done, 1 cannot be written, 2 wrong usage",
    )
    parser.add_argument("run_directory", metavar="RUN", type=Path, help="run directory of `bow sweep`, or a map.npz")
    parser.add_argument("--to", metavar="F", type=Path, required=True, help="file: .nc, .csv or .parquet by its suffix")
    parser.set_defaults(run=_export)


def _export(args: argparse.Namespace) -> int:
    from bow.maps import open_run
    from bow.optional import MissingLibrary
    from bow.tables import check_format, export

    try:
        check_format(args.to)
        export(open_run(args.run_directory), args.to)
    except (MissingLibrary, ValueError) as error:
        return fail(str(error))
    except OSError as error:
        return fail(f"--to {args.to}: cannot be written: {error.strerror or error}", FAILED)
    print(f"wrote {args.to}")
    return DONE
