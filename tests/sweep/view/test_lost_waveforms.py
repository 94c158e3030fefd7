"""Waveforms of inspected cells are whole in a finished recording: what did not come is in the bag or computed again."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import recording
from read_rrd import rows, verify

from bow_sim.protocol import cdr
from bow_sim.protocol.states import BlockState, PlanState
from bow_sweep.view.live_run import BAG_S, NO_RECORDER_S, LiveRun

CELLS = [1, 7, 11]
"""One of each block; a dashboard knows them from the beginning."""

SWEEP = recording.small_sweep()


def plan(state: int = PlanState.OPEN, block_state: int = BlockState.DONE, **changes: Any) -> dict[str, Any]:
    states = np.full(SWEEP.blocks, block_state if state == PlanState.CLOSED else 0, np.uint8)
    return cdr.decode("Plan", recording.plan(SWEEP, state, states=states)) | changes


def forces(cell: int) -> list[np.ndarray]:
    """The bridge force of a cell in each chunk, as the simulator computed it."""
    block = next(number for number in range(SWEEP.blocks) if cell in SWEEP.block(number))
    row = SWEEP.block(block).tolist().index(cell)
    sent = [cdr.unseal("BridgeForce", chunk.bridge_force) for chunk in recording.chunks(SWEEP, block)]
    return [values["data"].reshape(-1, values["samples"])[row].copy() for values in sent]


def send(live: LiveRun, cell: int, *chunks: int) -> None:
    for chunk in chunks:
        force = forces(cell)[chunk]
        identity = {"run_id": recording.RUN, "sweep_id": SWEEP.sweep_id, "attempt": 1}
        live.inspect({**identity, "cell": cell, "first_sample": chunk * len(force), "bridge_force": force})


def recorded(run: Path, cell: int) -> list[tuple[int, float]]:
    """The samples of a waveform in the recording, in order, each with its number."""
    found = rows(run / "dashboard.rrd", f"waveform/cell_{cell}", "Scalars:scalars")
    return sorted((when["sample"], value[0]) for when, value in found if when)


def assert_whole(run: Path, *cells: int) -> None:
    for cell in cells:
        force = np.concatenate(forces(cell))
        found = recorded(run, cell)
        assert [sample for sample, _ in found] == list(range(len(force))), "every sample once"
        np.testing.assert_array_equal(np.array([value for _, value in found], np.float32), force)


def closed(live: LiveRun, recorder: bool | None = True, **changes: Any) -> None:
    """End the run, whose recorder has closed its bag."""
    live.plan(plan(PlanState.CLOSED, **changes))
    if recorder is not None:
        live.recorder(recorder)
    live.finish([])


def test_a_dashboard_that_hears_nothing_has_whole_waveforms(run: Path) -> None:
    closed(LiveRun(run, plan(), CELLS, warn=pytest.fail))
    assert verify(run / "dashboard.rrd") == ""
    assert_whole(run, *CELLS)


def test_a_dashboard_that_starts_late_or_misses_messages_has_whole_waveforms(run: Path) -> None:
    live = LiveRun(run, plan(), CELLS, warn=pytest.fail)
    send(live, 1, 2, 3)  # it came late
    live.tick([])
    send(live, 7, 0, 2)  # one was lost
    live.tick([])
    send(live, 7, 3, 3)
    send(live, 11, 3, 1)  # in the wrong order
    closed(live)
    assert_whole(run, *CELLS)


def test_a_dashboard_that_is_started_again_fills_in_what_its_predecessor_missed(run: Path) -> None:
    live = LiveRun(run, plan(), CELLS)
    send(live, 1, 1)
    send(live, 7, 0, 2)
    live.recording.flush()  # and then it is killed: the file has no end
    again = LiveRun(run, plan(), CELLS, warn=pytest.fail)
    send(again, 1, 3)
    closed(again)
    assert_whole(run, *CELLS)


def test_a_cell_that_came_unasked_is_whole_as_well(run: Path) -> None:
    live = LiveRun(run, plan(), warn=pytest.fail)
    send(live, 7, 3)
    closed(live)
    assert_whole(run, 7)


def test_without_a_bag_waveforms_are_computed_again_where_the_kernel_is_the_runs(run: Path) -> None:
    shutil.rmtree(run / "bag")
    closed(LiveRun(run, plan(), CELLS, warn=pytest.fail), recorder=None)
    assert_whole(run, *CELLS)


@pytest.mark.parametrize("cause", ["another kernel", "quarantined"])
def test_what_can_be_had_nowhere_is_named_and_is_a_gap(run: Path, cause: str) -> None:
    shutil.rmtree(run / "bag")
    said: list[str] = []
    other = {"fingerprint": "another"} if cause == "another kernel" else {}
    live = LiveRun(run, plan(**other), [7], warn=said.append)
    send(live, 7, 0, 2)
    closed(live, block_state=BlockState.DONE if other else BlockState.QUARANTINED, **other)
    assert len(said) == 1
    samples = SWEEP.parameters.chunk_samples
    lost = f"{samples} to {2 * samples - 1}, {3 * samples} to {4 * samples - 1}"
    assert said[0].startswith(f"the waveform of cell 7 lacks samples {lost}: {run}: has no bag/")
    found = dict(recorded(run, 7))
    assert np.isnan(found[2 * samples - 1]), "no line is drawn across the gap"
    assert len(found) == 2 * samples + 1


def test_a_damaged_chunk_is_computed_again(run: Path) -> None:
    (path,) = (run / "bag").glob("*.mcap")
    content = bytearray(path.read_bytes())
    at = content.index(forces(7)[2].tobytes())
    content[at] ^= 1
    path.write_bytes(content)
    closed(LiveRun(run, plan(), CELLS, warn=pytest.fail))
    assert_whole(run, *CELLS)


def test_the_bag_of_a_run_that_goes_on_is_left_alone(run: Path) -> None:
    live = LiveRun(run, plan(), CELLS, warn=pytest.fail)
    send(live, 7, 1)
    live.finish([])
    assert len(recorded(run, 7)) == SWEEP.parameters.chunk_samples


@pytest.mark.parametrize(("recorder", "patience"), [(None, NO_RECORDER_S), (False, BAG_S)])
def test_the_recorder_is_waited_for_but_not_for_ever(run: Path, recorder: bool | None, patience: float) -> None:
    now = [100.0]
    live = LiveRun(run, plan(), CELLS, clock=lambda: now[0])
    if recorder is not None:
        live.recorder(recorder)
    live.plan(plan(PlanState.CLOSED))
    now[0] += patience - 0.01
    assert not live.tick([])
    now[0] += 0.02
    assert live.tick([])
    live.close()


def test_where_nothing_is_missing_nobody_is_waited_for(run: Path) -> None:
    live = LiveRun(run, plan(), [7], clock=lambda: 100.0)
    send(live, 7, 0, 1, 2, 3)
    live.plan(plan(PlanState.CLOSED, cells_done=0))
    live._closing = 95.0  # the last map was waited for
    assert live.tick([])
    live.close()
