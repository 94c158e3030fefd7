"""A cell that somebody chooses while the sweep runs has a place on the dashboard, also where the others fill it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from example_maps import inspection, plan
from read_rrd import rows

from bow_sim.protocol import cdr
from bow_sweep.view.live_run import LiveRun
from bow_sweep.view.scope import MOST, MOST_CHOSEN, Scope


def test_a_chosen_cell_is_drawn_beside_those_of_the_simulators(tmp_path: Path) -> None:
    live = LiveRun(tmp_path / "run", plan())
    for cell in range(MOST + 1):
        live.inspect(cdr.unseal("InspectedCell", inspection(cell, 0)))
    for cell in (20, 3):
        for chunk in range(2):
            live.inspect(cdr.unseal("InspectedCell", inspection(cell, chunk)) | {"attempt": 0})
    live.tick([])
    live.recording.close()
    assert live.recording.scope.cells == [*range(MOST), 20]
    assert live.recording.scope.left_out == {MOST}
    values = [value for _, found in rows(live.recording.path, "waveform/cell_20", "Scalars:scalars") for value in found]
    expected = [cdr.unseal("InspectedCell", inspection(20, chunk))["bridge_force"] for chunk in range(2)]
    np.testing.assert_array_equal(np.array(values, np.float32), np.concatenate(expected))
    assert rows(live.recording.path, "scope/cell_20/curve", "LineStrips2D:strips")


def test_chosen_cells_take_no_place_from_those_of_the_simulators() -> None:
    scope = Scope()
    for cell in range(100, 100 + MOST_CHOSEN + 1):
        scope.choose(cell)
    assert scope.cells == list(range(100, 100 + MOST_CHOSEN))
    assert [scope.admit(cell) for cell in range(MOST + 1)] == [True] * MOST + [False]
    scope.choose(100)
    assert len(scope.cells) == MOST + MOST_CHOSEN, "twice chosen is once shown"
