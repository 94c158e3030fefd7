"""The end of a run waits for the recorder, and only for a bounded time for a dashboard or a picture."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from bow_sim.protocol.states import NodeState
from bow_sweep.coordinator import results
from bow_sweep.coordinator.closing import CLOSE_S, DRAW_S, GONE_S, IDLE_S, NEXT_S, waits_for

RUN = "a" * 16


def test_a_closing_run_does_not_wait_for_a_dashboard_that_was_left_out_or_hangs() -> None:
    def node(role: str, state: int, run_id: str = RUN) -> Any:
        return SimpleNamespace(role=role, state=state, run_id=run_id, node=f"/bow/{role}")

    recorded = node("recorder", NodeState.CLOSED)
    assert waits_for([node("recorder", NodeState.BUSY)], RUN, 1, True) == "recorder"
    assert waits_for([recorded], RUN, 1, True) == "dashboard", "it may be starting"
    assert waits_for([recorded], RUN, 1, False) == ""
    for state in (NodeState.CLOSED, NodeState.FAILED):
        assert waits_for([recorded, node("dashboard", state)], RUN, 1, True) == ""
    left_out = {"/bow/dashboard": NEXT_S + 1, "/bow/recorder": 0.0}
    for run_id in (RUN, ""):
        dead = [recorded, node("dashboard", NodeState.DEAD, run_id)]
        assert waits_for(dead, RUN, 1, True) == "dashboard", "another may be starting, which draws the end of the run"
        assert waits_for(dead, RUN, 1, True, silent=left_out.__getitem__) == ""
    for state in (NodeState.STARTING, NodeState.BUSY):
        hangs = [recorded, node("dashboard", state)]
        assert waits_for(hangs, RUN, IDLE_S + 1, True) == "dashboard"
        assert waits_for(hangs, RUN, DRAW_S + 1, True) == ""
    busy = [node("recorder", NodeState.BUSY), node("dashboard", NodeState.BUSY)]
    assert waits_for(busy, RUN, DRAW_S + 1, True) == "recorder"
    assert waits_for(busy, RUN, CLOSE_S + 1, True) == ""


def test_a_closing_run_waits_for_the_recorder_of_each_station_that_is_still_heard() -> None:
    closed, busy, failed = (
        SimpleNamespace(role="recorder", state=state, run_id=RUN, node=f"/bow/{name}/recorder")
        for name, state in (("a", NodeState.CLOSED), ("b", NodeState.BUSY), ("c", NodeState.FAILED))
    )

    def awaited(nodes: list[Any], waited: float = 1.0, **silent: float) -> str:
        names = {f"/bow/{name}/recorder": seconds for name, seconds in silent.items()}
        return waits_for(nodes, RUN, waited, False, lambda node: node.split("/")[2], lambda node: names.get(node, 0.0))

    assert awaited([closed, failed]) == ""
    assert awaited([closed, busy]) == "recorder"
    assert awaited([closed, busy], CLOSE_S + 1) == ""
    assert awaited([closed, busy], b=GONE_S - 1) == "recorder", "it may have been killed, and is started again"
    assert awaited([closed, busy], b=GONE_S + 1) == "", "its station is lost"
    assert awaited([busy], b=GONE_S + 1) == "recorder", "the only one"


@pytest.mark.parametrize("error", [ImportError("matplotlib is broken"), OSError(28, "No space left on device")])
def test_all_other_results_are_written_if_the_picture_cannot_be_drawn(
    error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = []

    def draw(*_: object) -> None:
        raise error

    monkeypatch.setattr(results, "map_of", lambda *_: None)
    monkeypatch.setattr(results, "write_map_npz", lambda path, _: written.append(path))
    monkeypatch.setattr("bow_sweep.figures.maps.draw_map", draw)
    old = tmp_path / "map.png"
    old.touch()
    why = results.write_results(SimpleNamespace(directory=tmp_path), None)()  # type: ignore[arg-type]
    assert why == f"{old}: {error}"
    assert written == [tmp_path / "map.npz"]
    assert not old.exists(), "it may show an earlier state"
