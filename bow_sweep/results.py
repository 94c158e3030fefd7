"""What a finished run leaves beside its bag, and the map of a run that goes on."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bow_classifier.playability import playability

from .basin import Basin
from .plan import Sweep
from .run import Run
from .view.maps import MapFile, draw_map, write_map_npz

MAP, PICTURE = "map.npz", "map.png"


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
        from .view import pictures  # noqa: F401


def write_results(run: Run, basin: Basin) -> str:
    """Write map.npz and map.png into the directory of a run; return why there is no picture, or ""."""
    result = map_of(run, basin)
    write_map_npz(run.directory / MAP, result)
    picture = run.directory / PICTURE
    try:
        draw_map(result, picture)
    except Exception as error:  # whatever a library raises: a picture is only for looking at
        with contextlib.suppress(OSError):
            picture.unlink(missing_ok=True)  # of an earlier state of the run
        return f"{picture}: {error or type(error).__name__}"
    return ""


def load_basin(directory: Path, sweep: Sweep) -> Basin:
    """Return the map that the verdicts in a run's bag give, for a run that goes on."""
    from .record.bag import BagError
    from .record.replay import load_verdicts

    basin = Basin(sweep.x.count, sweep.y.count, sweep.chunks)
    try:
        layers = load_verdicts(directory)
    except BagError:  # killed before anything was recorded
        return basin
    for test in range(sweep.chunks):
        cells = np.flatnonzero(layers["tested"][test])
        basin.take(test, cells, {name: layers[name][test, cells] for name in basin.layers})
    return basin
