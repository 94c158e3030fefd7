"""What is only for looking at never decides over the sweep."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from bow_sim.protocol.states import NodeState
from bow_sweep.coordinator import results
from bow_sweep.coordinator.closing import CLOSE_S, DRAW_S, IDLE_S, waits_for
from bow_sweep.processes.supervisor import CRASHES, Child, Exit, Supervisor

RUN = "a" * 16


@pytest.fixture
def supervisor(tmp_path: Path) -> Supervisor:
    return Supervisor("/bow/x", tmp_path / "log", {})


def death(supervisor: Supervisor, status: int, worked: bool = False, role: str = "dashboard") -> Exit:
    log = supervisor.logs / f"{role}.log"
    log.write_text("Traceback:\nImportError: no such library\n")
    return Exit(Child(role, role, SimpleNamespace(pid=1), log, worked=worked), status)  # type: ignore[arg-type]


def test_a_dashboard_that_fails_before_it_works_is_left_out_at_once(supervisor: Supervisor) -> None:
    assert supervisor.why_left_out(death(supervisor, 1)) == "exit status 1: ImportError: no such library"
    assert supervisor.left_out == [supervisor.logs / "dashboard.log"]


@pytest.mark.parametrize(("status", "worked"), [(-9, False), (-9, True), (1, True), (0, True)])
def test_one_that_is_killed_or_fails_later_is_started_again_some_times(
    supervisor: Supervisor, status: int, worked: bool
) -> None:
    for _ in range(CRASHES - 1):
        assert supervisor.why_left_out(death(supervisor, status, worked)) == ""
    assert supervisor.why_left_out(death(supervisor, status, worked)).startswith(f"ended {CRASHES} times, at last: ")


@pytest.mark.parametrize("role", ["recorder", "classifier", "simulator", "coordinator"])
def test_nobody_else_is_left_out(supervisor: Supervisor, role: str) -> None:
    for _ in range(2 * CRASHES):
        assert supervisor.why_left_out(death(supervisor, 1, role=role)) == ""
    assert supervisor.left_out == []


def test_a_dashboard_that_was_left_out_or_hangs_is_not_waited_for() -> None:
    def node(role: str, state: int, run_id: str = RUN) -> Any:
        return SimpleNamespace(role=role, state=state, run_id=run_id)

    recorded = node("recorder", NodeState.CLOSED)
    assert waits_for([node("recorder", NodeState.BUSY)], RUN, 1, True) == "recorder"
    assert waits_for([recorded], RUN, 1, True) == "dashboard", "it may be starting"
    assert waits_for([recorded], RUN, 1, False) == ""
    for state in (NodeState.CLOSED, NodeState.FAILED, NodeState.DEAD):
        assert waits_for([recorded, node("dashboard", state)], RUN, 1, True) == ""
    assert waits_for([recorded, node("dashboard", NodeState.DEAD, "")], RUN, 1, True) == "", (
        "left out before it had a run"
    )
    for state in (NodeState.STARTING, NodeState.BUSY):
        hangs = [recorded, node("dashboard", state)]
        assert waits_for(hangs, RUN, IDLE_S + 1, True) == "dashboard"
        assert waits_for(hangs, RUN, DRAW_S + 1, True) == ""
    assert (
        waits_for([node("recorder", NodeState.BUSY), node("dashboard", NodeState.BUSY)], RUN, DRAW_S + 1, True)
        == "recorder"
    )
    assert (
        waits_for([node("recorder", NodeState.BUSY), node("dashboard", NodeState.BUSY)], RUN, CLOSE_S + 1, True) == ""
    )


@pytest.mark.parametrize("error", [ImportError("matplotlib is broken"), OSError(28, "No space left on device")])
def test_a_picture_that_cannot_be_drawn_loses_nothing_else(
    error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = []

    def draw(*_: object) -> None:
        raise error

    monkeypatch.setattr(results, "map_of", lambda *_: None)
    monkeypatch.setattr(results, "write_map_npz", lambda path, _: written.append(path))
    monkeypatch.setattr(results, "draw_map", draw)
    old = tmp_path / "map.png"
    old.touch()
    why = results.write_results(SimpleNamespace(directory=tmp_path), None)  # type: ignore[arg-type]
    assert why == f"{old}: {error}"
    assert written == [tmp_path / "map.npz"]
    assert not old.exists(), "it showed an earlier state"
