"""What the coordinator's node does beside its session."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import Any

import pytest

from bow_sim.protocol.states import NodeState
from bow_sweep.coordinator import node as coordinator
from bow_sweep.coordinator.node import CoordinatorNode
from bow_sweep.coordinator.session_events import SetState


def test_libraries_for_the_results_are_imported_once_blocks_are_computed_and_nothing_waits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begun, go_on, done = [], threading.Event(), []

    def prepare() -> None:
        begun.append(threading.current_thread().name)
        done.append(go_on.wait(20))

    monkeypatch.setattr(coordinator, "prepare", prepare)
    node: Any = SimpleNamespace(_preparing=None, set_state=lambda *_: None)
    node._prepare = lambda: CoordinatorNode._prepare(node)
    node._chooser = node._session = SimpleNamespace(close=lambda: None)
    for state in (NodeState.STARTING, NodeState.BUSY, NodeState.BUSY, NodeState.READY):
        CoordinatorNode._carry_out(node, SetState(int(state)))
        assert (node._preparing is not None) == (state != NodeState.STARTING)
    assert done == []
    go_on.set()
    CoordinatorNode.close(node)
    assert (begun, done) == (["prepare"], [True])
