"""What `bow study`, and `bow sweep` of a campaign, write and print of runs that are finished."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bow_sweep.cli.sweep_report import left_out_line, print_text
from bow_sweep.cli.terminal import warn

if TYPE_CHECKING:
    from bow_sweep.study.plan import Study

MAPS = "maps.png"
NETCDF = "study.nc"

FILES = {
    "study.png": "measures against the parameters, and all maps",
    MAPS: "all maps, to look at",
    "study.json": "all numbers, with uncertainties and significance",
    NETCDF: "all maps, as they were at the last test: xarray.open_dataset(...), or bow.open({directory!r}).ds",
    "study.yaml": "what was asked",
}


def print_study(study: Study, directory: Path, left_out: Sequence[Path], measures: Sequence[str] = ()) -> bool:
    """Write the files of a finished study, and print its table.

    Parameters
    ----------
    study
        What was to be run.
    directory
        Of the study, with a run directory for each map.
    left_out
        Logs of the processes that a run went on without.
    measures
        Names of those in the table; () for the usual ones.

    Returns
    -------
    bool
        Whether blocks were quarantined.

    Raises
    ------
    RunError, OSError
        Where a run has no report, or study.json cannot be written.
    """
    from bow_sweep.study.report import SHOWN, report, text

    found = report(directory, study)
    _write_pictures(study, directory, found)
    _write_dataset(directory)
    cells = found["cells"]
    lines = [study.title, ""] if study.title else []
    lines += [*map(left_out_line, left_out), *text(found, measures or SHOWN), ""]
    lines.append(
        f"{len(found['maps'])} maps, {cells['done']} of {cells['planned']} cells, {cells['quarantined']} quarantined, "
        f"in {found['wall_seconds']:.1f} s"
    )
    lines += ["", f"{directory}/"]
    for name, what in FILES.items():
        if (directory / name).exists():
            lines.append(f"  {name:12} {what.format(directory=str(directory))}")
    first = directory / study.members[0].name
    lines += [
        f"  {first.name}, ...: a run directory for each map",
        "",
        f"check one: bow verify {shlex.quote(str(first))}",
    ]
    print_text("\n".join(lines))
    return bool(cells["quarantined"])


def _write_pictures(study: Study, directory: Path, found: dict[str, Any]) -> None:
    """Draw the study, and the figure of the paper that it makes up; the runs are good without them."""
    from bow_sweep.maps.map_file import read_map
    from bow_sweep.study.picture import PICTURE, draw_study

    runs = [directory / member.name for member in study.members]
    try:
        draw_study(study, found, [read_map(run) for run in runs], directory / PICTURE)
    except Exception as error:
        warn(f"no picture of the study: {error}")
    if not study.figure:
        return
    from bow_sweep.cli.figure import draw_maps

    try:
        draw_maps(study.figure, runs, directory / MAPS)
    except Exception as error:  # MapFileError: settings that make it another figure
        warn(f"no picture of figure {study.figure}: {error}")


def _write_dataset(directory: Path) -> None:
    """Write all maps as one netCDF file, where the libraries are there."""
    from bow.optional import MissingLibrary
    from bow.studies import open_study

    try:
        open_study(directory).to_netcdf(directory / NETCDF)
    except (MissingLibrary, ValueError, OSError) as error:
        warn(f"no {NETCDF}: {error}")
