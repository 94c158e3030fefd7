"""What the coordinator's node does beside its session."""

from __future__ import annotations

import gc
import threading
from types import SimpleNamespace
from typing import Any

import pytest

from bow_sim.protocol.states import NodeState
from bow_sweep.coordinator import node as coordinator
from bow_sweep.coordinator.node import CoordinatorNode
from bow_sweep.coordinator.session_events import SetState


def node_of(**more: Any) -> Any:
    """Return what the tested methods see of a node."""
    closed = SimpleNamespace(close=lambda: None)
    node: Any = SimpleNamespace(_preparing=None, _painter=None, _frozen=False, _chooser=closed, _session=closed, **more)
    node._prepare = lambda: CoordinatorNode._prepare(node)
    return node


def test_libraries_for_the_results_are_imported_once_blocks_are_computed_and_nothing_waits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begun, go_on, done = [], threading.Event(), []

    def prepare() -> None:
        begun.append(threading.current_thread().name)
        done.append(go_on.wait(20))

    monkeypatch.setattr(coordinator, "prepare", prepare)
    node = node_of(set_state=lambda *_: None)
    for state in (NodeState.STARTING, NodeState.BUSY, NodeState.BUSY, NodeState.READY):
        CoordinatorNode._carry_out(node, SetState(state, "", None))
        assert len(begun) <= (state != NodeState.STARTING)
    assert not done  # all that time
    go_on.set()
    CoordinatorNode.close(node)
    assert begun == ["prepare"]
    assert done == [True]


def test_a_node_that_froze_its_objects_can_be_collected_after_its_end() -> None:
    node = node_of()
    node._frozen = True
    gc.freeze()
    CoordinatorNode.close(node)
    assert gc.get_freeze_count() == 0
