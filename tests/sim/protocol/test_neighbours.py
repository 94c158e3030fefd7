"""Which nodes are alive and which topics work: only heartbeats count."""

from __future__ import annotations

import itertools
from types import SimpleNamespace
from typing import Any

import pytest

from bow_sim.protocol.neighbours import HEARS_S, LEFT, LONGEST_STEP_S, SILENT_S, AwakeClock, Neighbours
from bow_sim.protocol.states import NodeState

OWN, OTHER = "a" * 16, "b" * 16
NUMBERS = itertools.count(1)
GONE = 2**22 + 1
"""No process has this number: it is larger than pid_max."""


def health(**changes: Any) -> SimpleNamespace:
    """A heartbeat of a recorder on another machine."""
    values: dict[str, Any] = {
        "role": "recorder",
        "node": "/bow/recorder",
        "incarnation": OTHER,
        "host": "there",
        "pid": 7,
        "run_id": "r",
        "state": NodeState.BUSY,
        "detail": "",
        "hears": [],
        "started": SimpleNamespace(sec=5, nanosec=0),
        "number": next(NUMBERS),
    }
    return SimpleNamespace(**{**values, **changes})


@pytest.fixture
def neighbours() -> Neighbours:
    return Neighbours(OWN, "here")


def test_time_in_which_a_process_was_stopped_does_not_pass() -> None:
    at = 100.0
    clock = AwakeClock(lambda: at)
    for _ in range(10):
        at += 0.2
        clock.now()
    assert clock.now() == pytest.approx(2.0)
    at += 3600
    assert clock.now() == pytest.approx(2.0 + LONGEST_STEP_S)
    assert clock.slept == pytest.approx(3600 - LONGEST_STEP_S)
    at -= 50  # a steady clock never goes back, but it would do no harm
    assert clock.now() == pytest.approx(2.0 + LONGEST_STEP_S)


def test_what_was_heard_is_reported_for_a_while(neighbours: Neighbours) -> None:
    neighbours.heard("bridge_force", OTHER, 0.0)
    neighbours.heard("stick_slip", OTHER, 1.0)
    neighbours.heard("verdicts", OWN, 1.0)
    assert neighbours.changed
    assert neighbours.hears(1.0) == [f"{OTHER} bridge_force stick_slip"]
    assert not neighbours.changed
    neighbours.heard("stick_slip", OTHER, 2.0)
    assert not neighbours.changed
    assert neighbours.hears(1.5 + HEARS_S) == [f"{OTHER} stick_slip"]
    assert neighbours.hears(2.5 + HEARS_S) == []
    neighbours.heard("stick_slip", OTHER, 3.0 + HEARS_S)
    assert neighbours.changed


def test_a_node_is_alive_as_long_as_its_heartbeats_arrive(neighbours: Neighbours) -> None:
    neighbours.take(health(), 0.0)
    assert neighbours.is_alive(OTHER, SILENT_S)
    assert not neighbours.is_alive(OTHER, SILENT_S + 0.1)
    assert [known.node for known in neighbours.of_role("recorder", 1.0)] == ["/bow/recorder"]
    assert neighbours.of_role("recorder", 1.0, "another run") == []
    assert neighbours.take(health(state=NodeState.CLOSED, detail=LEFT), 1.0) is None
    assert neighbours.of_role("recorder", 1.0) == []
    neighbours.take(health(state=NodeState.CLOSED, detail="the bag is closed"), 1.0)
    assert neighbours.is_alive(OTHER, 1.0)


def test_a_report_that_a_node_is_dead_counts_only_for_its_process(neighbours: Neighbours) -> None:
    neighbours.take(health(), 0.0)
    for wrong in ({"pid": 8}, {"host": "here"}):
        neighbours.take(health(state=NodeState.DEAD, incarnation="", **wrong), 0.0)
        assert neighbours.is_alive(OTHER, 0.0)
    neighbours.take(health(state=NodeState.DEAD, incarnation=""), 0.0)
    assert not neighbours.is_alive(OTHER, 0.0)


def test_a_process_of_this_machine_that_has_ended_is_seen_to_be_gone(neighbours: Neighbours) -> None:
    neighbours.take(health(host="here", pid=GONE), 0.0)
    neighbours.take(health(incarnation="c" * 16, pid=GONE), 0.0)
    assert neighbours.is_alive(OTHER, 1.0)
    assert not neighbours.is_alive(OTHER, 3.0)
    assert neighbours.is_alive("c" * 16, 3.0)  # processes of another machine are not seen


def test_a_topic_works_if_its_reader_reports_it(neighbours: Neighbours) -> None:
    needed = [("verdicts", "recorder")]
    assert neighbours.missing(needed, "r", 0.0, 1.0) == ["no recorder has taken up the run"]
    neighbours.take(health(hears=[f"{'c' * 16} verdicts", f"{OWN} health"]), 0.0)
    assert neighbours.missing(needed, "r", 0.0, 1.0) == ["/bow/recorder does not hear verdicts"]
    neighbours.take(health(hears=[f"{OWN} health verdicts"]), 1.0)
    assert neighbours.missing(needed, "r", 2.0, 1.0) == []
    assert neighbours.missing(needed, "r", 2.1, 1.0) == ["/bow/recorder does not hear verdicts"]
    assert neighbours.missing(needed, "r", 2.1, 5.0) == []
    assert neighbours.missing(needed, "another run", 2.0, 1.0) == ["no recorder has taken up the run"]
    neighbours.take(health(incarnation="d" * 16), 2.0)  # started again: it has not heard us yet
    neighbours.forget(OTHER)
    assert neighbours.missing(needed, "r", 2.0, 5.0) == ["/bow/recorder does not hear verdicts"]


def test_an_older_heartbeat_of_a_living_node_is_recognised(neighbours: Neighbours) -> None:
    first, second = health(), health(state=NodeState.STARTING)
    neighbours.take(second, 0.0)
    assert neighbours.is_old(first)
    assert neighbours.is_old(second)
    assert not neighbours.is_old(health())
    neighbours.take(health(state=NodeState.CLOSED, detail=LEFT), 1.0)
    assert neighbours.is_old(health())
    assert not neighbours.is_old(health(incarnation="c" * 16))


def test_a_heartbeat_from_a_bag_does_not_answer_us(neighbours: Neighbours) -> None:
    recorded = neighbours.take(health(hears=[f"{'c' * 16} health"]), 0.0)
    assert recorded is not None
    assert not recorded.is_live
    answering = neighbours.take(health(hears=[f"{OWN} health"]), 0.0)
    assert answering is not None
    assert answering.is_live


@pytest.mark.parametrize(
    ("theirs", "ours", "has_to_end"),
    [((5, 0), (6, 0), True), ((6, 0), (5, 0), False), ((5, 1), (5, 0), False), ((5, 0), (5, 0), False)],
)
def test_of_two_nodes_with_one_role_or_name_the_later_one_has_to_end(
    theirs: tuple[int, int], ours: tuple[int, int], has_to_end: bool, neighbours: Neighbours
) -> None:
    started = SimpleNamespace(sec=theirs[0], nanosec=theirs[1])
    neighbours.take(health(started=started), 0.0)
    assert neighbours.rival("recorder", "/bow/mine", ours, single=True) is None  # it may be from a bag
    neighbours.take(health(started=started, hears=[f"{OWN} health"]), 0.0)
    assert (neighbours.rival("recorder", "/bow/mine", ours, single=True) is not None) == has_to_end
    assert (neighbours.rival("simulator", "/bow/recorder", ours, single=False) is not None) == has_to_end
    assert neighbours.rival("simulator", "/bow/mine", ours, single=False) is None
    assert neighbours.rival("classifier", "/bow/recorder", ours, single=True) is None
