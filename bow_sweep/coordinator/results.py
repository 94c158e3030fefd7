"""The results of a finished run beside its bag, and the map of a resumed run."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bow_sweep.coordinator.painter import Painter, draw
from bow_sweep.maps.basin_map import Basin
from bow_sweep.maps.map_file import MAP, MapFile, write_map_npz
from bow_sweep.maps.playability import playability
from bow_sweep.plan.sweep import Sweep
from bow_sweep.run.directory import PICTURE, Run, RunError

__all__ = [
    "MAP",
    "PICTURE",
    "basin_of",
    "map_of",
    "playability_of",
    "write_results",
    "writing",
]


def map_of(run: Run, basin: Basin) -> MapFile:
    """Return the map of a run; cells that are not done are grey, even if some of their verdicts are known."""
    done = run.done()
    result = MapFile.of(run.sweep, basin, run.run_id, ~done)
    if not run.blocks.adaptive:
        return result
    return replace(result, transient_periods=run.transient_periods(basin), simulated=done.reshape(basin.ny, basin.nx))


def playability_of(run: Run, basin: Basin) -> dict[str, Any]:
    """Return the playability of the plane (section IV.B), for the report; cells that are not done are left out.

    For an adaptive sweep, predicted cells count, but the regimes of black cells are left out: they are not predicted.
    """
    regime = None if run.blocks.adaptive else basin.of_plane(basin.latest("regime"))
    return playability(run.transient_periods(basin), regime)


def write_results(run: Run, basin: Basin, painter: Painter | None = None) -> Callable[[], str]:
    """Write map.npz into the directory of a run, and have map.png drawn beside it.

    Parameters
    ----------
    painter
        Draws it meanwhile; without one, and where it dies or hangs, it is drawn here.

    Returns
    -------
    callable
        Waits for the picture, and returns why there is none, or "".

    Raises
    ------
    RunError
        If map.npz cannot be written.
    """
    result, written, picture = map_of(run, basin), run.directory / MAP, run.directory / PICTURE
    with writing(run.directory):
        write_map_npz(written, result)
    asked = painter is not None and painter.ask(written, picture)

    def problem() -> str:
        found = painter.problem() if painter is not None and asked else None
        why = draw(result, picture) if found is None else found
        if not why:
            return ""
        with contextlib.suppress(OSError):
            picture.unlink(missing_ok=True)  # it may show an earlier state of the run
        return f"{picture}: {why}"

    return problem


@contextlib.contextmanager
def writing(directory: Path) -> Iterator[None]:
    """Raise a RunError that names file and remedy if results cannot be written, for example to a full disk."""
    try:
        yield
    except OSError as error:
        what = f"{error.filename or directory}: {error.strerror or error}"
        raise RunError(f"{what}; every block is done and in the bag: make room, then resume {directory}") from None


def basin_of(layers: Mapping[str, np.ndarray], sweep: Sweep) -> Basin:
    """Return the map that recorded verdicts give.

    Parameters
    ----------
    layers
        As :func:`bow_sweep.record.replay.load_verdicts` returns them; {} if there are none.
    """
    basin = Basin(sweep.x.count, sweep.y.count, sweep.chunks, sweep.repeats.count)
    for test in range(sweep.chunks if layers else 0):
        cells = np.flatnonzero(layers["tested"][test])
        basin.take(test, cells, {name: layers[name][test, cells] for name in basin.layers})
    return basin
