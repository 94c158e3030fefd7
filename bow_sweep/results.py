"""What a finished run leaves beside its bag, and the map of a run that goes on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from bow_classifier.playability import playability

from .basin import Basin
from .ledger import Ledger, State
from .plan import Sweep
from .view.maps import MapFile, draw_map, write_map_npz

MAP, PICTURE = "map.npz", "map.png"


def not_computed(sweep: Sweep, ledger: Ledger) -> np.ndarray:
    """Return which cells are not done, shape (ny * nx,): a map shows them grey, whatever is known of them."""
    mask = np.ones(sweep.cells, bool)
    for number, block in enumerate(ledger.blocks):
        if block.state is State.DONE:
            mask[sweep.block(number)] = False
    return mask


def playability_of(sweep: Sweep, basin: Basin, ledger: Ledger) -> dict[str, Any]:
    """Return the playability of the plane (section IV.B), for the report; cells that are not done are left out."""
    shape = sweep.y.count, sweep.x.count
    lengths = np.where(not_computed(sweep, ledger), np.nan, basin.transient_periods)
    return playability(lengths.reshape(shape), basin.latest("regime").reshape(shape))


def write_results(directory: Path, run_id: str, sweep: Sweep, basin: Basin, ledger: Ledger) -> None:
    """Write map.npz and map.png into a run directory."""
    result = MapFile.of(sweep, basin, run_id, not_computed(sweep, ledger))
    write_map_npz(directory / MAP, result)
    draw_map(result, directory / PICTURE)


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
