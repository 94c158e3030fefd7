"""What the dashboard shows of a sweep with repeats: the cells while it runs, the reliability when it has ended."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from example_maps import basin_map, inspection, map_file, plan, settings
from read_rrd import entities, named, verify

from bow_sim.protocol import cdr
from bow_sweep.maps.map_file import MAP, write_map_npz
from bow_sweep.maps.reliability import Reliability
from bow_sweep.view.live_run import LiveRun
from bow_sweep.view.tests_over_time import LEDGER

CLOSED = 2
REPEATED = [*settings(), "repeats=2", "jitter=0.01", "seed=0"]


def planned(state: int = 1, done: int = 0) -> dict[str, Any]:
    """The plan of 32 cells and 64 repeats in blocks of eight."""
    states = np.zeros(12, np.uint8)
    states[:done] = 1
    return {**plan(state), "spec.settings": REPEATED, "block_states": states}


@pytest.fixture
def live(tmp_path: Path) -> Any:
    shown = LiveRun(tmp_path / "run", planned())
    yield shown
    shown.close()


def test_the_shares_are_shown_cell_for_cell_when_the_sweep_has_ended(live: LiveRun) -> None:
    regimes = np.ones((3, 4, 8), np.uint8)
    regimes[1, 0, 3], regimes[1:, 2, 5] = 2, 2
    done = np.ones((3, 4, 8), bool)
    done[1:, 3, 7] = False
    sure = Reliability.of((4, 8), regimes, np.full((3, 4, 8), 20.0), done)
    result = map_file()
    known = {"regimes": np.where(result.helmholtz, 1, 2), "confidence": np.full(result.helmholtz.shape, 0.5)}
    (live.recording.path.parent / LEDGER).touch()
    write_map_npz(live.recording.path.parent / MAP, replace(result, settings=REPEATED, reliability=sure, **known))
    live.map(basin_map())
    live.plan(planned(CLOSED, 12))
    live.finish([])
    path = live.recording.path
    assert verify(path) == ""
    said = named(path, "reliability")
    assert said[0][3] == "50 % of the repeats end as the cell"
    assert said[2][5] == "0 % of the repeats end as the cell"
    assert said[3][7] == "not known"
    assert said[1] == ["100 % of the repeats end as the cell"] * 8


def test_a_repeat_under_inspection_has_no_place_on_the_map_and_is_left_out(live: LiveRun) -> None:
    live.inspect(cdr.unseal("InspectedCell", inspection(32 + 3, 0)))
    assert (live.ignored, live.recording.scope.cells) == (1, [])
    live.inspect(cdr.unseal("InspectedCell", inspection(3, 0)))
    assert (live.ignored, live.recording.scope.cells) == (1, [3])


def test_a_sweep_without_repeats_has_no_such_picture(tmp_path: Path) -> None:
    shown = LiveRun(tmp_path / "run", plan())
    shown.map(basin_map())
    shown.finish([])
    assert not [entity for entity in entities(shown.recording.path) if entity.startswith("reliability")]
