"""What a finished run leaves beside its bag, and the map of a run that goes on."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bow_sweep.maps.basin_map import Basin
from bow_sweep.maps.map_file import MAP, MapFile, write_map_npz
from bow_sweep.maps.playability import playability
from bow_sweep.plan.sweep import Sweep
from bow_sweep.run.directory import PICTURE, Run, RunError
from bow_sweep.view.map_figures import draw_map

__all__ = [
    "MAP",
    "PICTURE",
    "basin_of",
    "load_basin",
    "map_of",
    "playability_of",
    "prepare",
    "write_results",
    "writing",
]


def map_of(run: Run, basin: Basin) -> MapFile:
    """Return the map of a run: grey is what was planned and is not done, whatever is known of it."""
    done = run.done()
    result = MapFile.of(run.sweep, basin, run.run_id, ~done)
    if not run.blocks.adaptive:
        return result
    return replace(result, transient_periods=run.transient_periods(basin), simulated=done.reshape(basin.ny, basin.nx))


def playability_of(run: Run, basin: Basin) -> dict[str, Any]:
    """Return the playability of the plane (section IV.B), for the report; cells that are not done are left out.

    Those that an adaptive sweep predicts are not; what black cells are is not said then.
    """
    shape = basin.ny, basin.nx
    regime = None if run.blocks.adaptive else basin.latest("regime").reshape(shape)
    return playability(run.transient_periods(basin), regime)


def prepare() -> None:
    """Load the libraries that results are drawn and measured with, which take half a second."""
    import scipy.ndimage  # noqa: F401

    with contextlib.suppress(Exception):  # write_results will say so
        from bow_sweep.view import pictures  # noqa: F401


def write_results(run: Run, basin: Basin, kind: type[Exception] = RunError) -> str:
    """Write map.npz and map.png into the directory of a run; return why there is no picture, or "".

    Where there can be no map.npz, it raises an exception of a `kind`, with a message for people.
    """
    result = map_of(run, basin)
    with writing(run.directory, kind):
        write_map_npz(run.directory / MAP, result)
    picture = run.directory / PICTURE
    try:
        draw_map(result, picture)
    except Exception as error:  # whatever a library raises: a picture is only for looking at
        with contextlib.suppress(OSError):
            picture.unlink(missing_ok=True)  # of an earlier state of the run
        return f"{picture}: {error or type(error).__name__}"
    return ""


@contextlib.contextmanager
def writing(directory: Path, kind: type[Exception]) -> Iterator[None]:
    """Raise an exception of a `kind`, with a message for people, where results cannot be written: a full disk, say."""
    try:
        yield
    except OSError as error:
        what = f"{error.filename or directory}: {error.strerror or error}"
        raise kind(f"{what}; every block is done and in the bag: make room, then resume {directory}") from None


def load_basin(directory: Path, sweep: Sweep) -> Basin:
    """Return the map that the verdicts in a run's bag give, for a run that goes on."""
    from bow_sweep.record.bag import BagError
    from bow_sweep.record.replay import load_verdicts

    try:
        return basin_of(load_verdicts(directory), sweep)
    except BagError:  # killed before anything was recorded
        return Basin(sweep.x.count, sweep.y.count, sweep.chunks)


def basin_of(layers: Mapping[str, np.ndarray], sweep: Sweep) -> Basin:
    """Return the map that recorded verdicts give; {} for none.

    They are as :func:`bow_sweep.record.replay.load_verdicts` returns them.
    """
    basin = Basin(sweep.x.count, sweep.y.count, sweep.chunks)
    for test in range(sweep.chunks if layers else 0):
        cells = np.flatnonzero(layers["tested"][test])
        basin.take(test, cells, {name: layers[name][test, cells] for name in basin.layers})
    return basin
