"""Diagnostics: an item for each node that is there, and for what the coordinator knows, as common tools read them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from bow_msgs.msg import Health
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus

from bow_sim.protocol.neighbours import LEFT
from bow_sim.protocol.states import NodeState
from bow_sweep.coordinator.diagnostics import (
    MOST_AT_ONCE,
    TURNS,
    Level,
    health_of,
    in_turn,
    last_word,
    nodes_health,
    sweep_of,
)
from bow_sweep.coordinator.standard_messages import diagnostics_message


def health(state: int = NodeState.BUSY, detail: str = "", **changes: Any) -> SimpleNamespace:
    values = {"node": "/bow/recorder", "role": "recorder", "host": "here", "run_id": "r", "incarnation": "a" * 16}
    values |= dict.fromkeys(("pid", "rss", "messages", "bytes", "duplicates", "ignored"), 7)
    return SimpleNamespace(state=state, detail=detail, **values | changes)


@pytest.mark.parametrize(
    ("state", "alive", "level"),
    [
        (NodeState.READY, True, Level.OK),
        (NodeState.BUSY, True, Level.OK),
        (NodeState.CLOSED, True, Level.OK),
        (NodeState.STARTING, True, Level.WARN),
        (NodeState.FAILED, True, Level.ERROR),
        (NodeState.DEAD, False, Level.STALE),
        (NodeState.BUSY, False, Level.STALE),
        (99, True, Level.WARN),
    ],
)
def test_the_level_is_that_of_the_node(state: int, alive: bool, level: Level) -> None:
    item = health_of(health(state), alive)
    assert (item.name, item.level, item.hardware_id) == ("/bow/recorder: health", level, "here")


def test_a_node_that_is_not_heard_any_more_shows_its_last_word() -> None:
    (item,) = nodes_health([health(detail="records to x")], lambda incarnation: False)
    assert item.message == "not heard any more; the last word was: records to x"


def test_a_node_that_has_ended_by_itself_is_not_shown() -> None:
    assert nodes_health([health(NodeState.CLOSED, LEFT)], lambda _: False) == []
    assert len(nodes_health([health(NodeState.CLOSED, "bag is closed")], lambda _: True)) == 1


@pytest.mark.parametrize(("count", "turns"), [(0, 1), (3, 1), (MOST_AT_ONCE, 1), (MOST_AT_ONCE + 1, 2), (1024, TURNS)])
def test_of_many_nodes_some_are_published_at_a_time_and_each_within_some_turns(count: int, turns: int) -> None:
    nodes = list(range(count))
    for first in range(5):
        shown = [in_turn(nodes, turn) for turn in range(first, first + turns)]
        assert sorted(node for some in shown for node in some) == nodes
        assert max(map(len, shown)) <= max(MOST_AT_ONCE, -(-count // TURNS))


def test_cells_that_were_given_up_are_a_warning() -> None:
    accounts = {"planned": 10, "done": 4, "quarantined": 0, "outstanding": 6}
    good, bad, none = (sweep_of("/bow/c", "h", "r", a) for a in (accounts, accounts | {"quarantined": 2}, None))
    assert (good.level, good.message) == (Level.OK, "4 of 10 cells done")
    assert (bad.level, bad.message) == (Level.WARN, "4 of 10 cells done, 2 given up")
    assert good.values == {"run_id": "r", **accounts}
    assert (none.level, none.message) == (Level.OK, "no sweep is open")


def test_a_refused_goal_stays_visible() -> None:
    assert last_word("/bow/c", "h", "goal", "preset 'nope'", "none").level == Level.WARN
    assert last_word("/bow/c", "h", "goal", "", "none").message == "none"


def test_the_message_is_the_one_of_diagnostic_updater() -> None:
    """Levels and constants by the message's own definition; names "node: item"; texts as key and value; a stamp."""
    assert {level.name: bytes([level]) for level in Level} == {
        name: getattr(DiagnosticStatus, name) for name in ("OK", "WARN", "ERROR", "STALE")
    }
    (status,) = diagnostics_message([health_of(health(Health.FAILED, "disk full"), True)], Time(sec=3)).status
    assert status.level == DiagnosticStatus.ERROR
    assert status.name.split(": ") == ["/bow/recorder", "health"]
    assert status.message == "disk full"
    values = {pair.key: pair.value for pair in status.values}
    assert values["role"] == "recorder"
    assert values["state"] == "failed"
    assert values["rss"] == "7"
    assert diagnostics_message([], Time(sec=3)).header.stamp.sec == 3
