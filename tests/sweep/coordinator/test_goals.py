"""Goals that come before recorder and classifier wait for them, for a while; each is run or refused once."""

from __future__ import annotations

from bow_sweep.coordinator.goals import GoalGate, Hold, is_wrong
from bow_sweep.coordinator.session_events import GoalAccepted, GoalRefused

FIRST, SECOND = (GoalAccepted(key, "fig11d", ()) for key in (b"1", b"2"))
MISSING = ["no recorder is heard", "no classifier is heard"]


def test_a_sweep_that_cannot_be_computed_does_not_wait() -> None:
    assert not is_wrong(FIRST)
    assert is_wrong(GoalAccepted(b"3", "nope", ()))
    assert is_wrong(GoalAccepted(b"3", "fig11d", ("x.count=0",)))


def test_a_goal_passes_where_nobody_is_missing() -> None:
    gate = GoalGate()
    assert gate.take(FIRST, 0.0, []) is FIRST
    assert gate.look(1.0, []) is None


def test_a_goal_waits_for_those_that_are_starting() -> None:
    gate = GoalGate(5.0)
    held = gate.take(FIRST, 10.0, MISSING)
    assert held == Hold("a goal waits, 5 s at most: no recorder is heard, no classifier is heard")
    assert gate.look(14.9, MISSING[:1]) is None
    assert gate.look(14.9, []) is FIRST
    assert gate.look(14.9, []) is None, "once"


def test_a_goal_is_refused_when_nobody_has_come_and_the_client_gets_the_reason() -> None:
    gate = GoalGate(5.0)
    gate.take(FIRST, 10.0, MISSING)
    refused = gate.look(15.0, MISSING[:1])
    assert isinstance(refused, GoalRefused)
    assert refused.goal == FIRST.goal
    assert refused.why.startswith("no recorder is heard within 5 s; start both nodes")
    assert gate.look(99.0, MISSING) is None, "once"
    assert isinstance(gate.take(FIRST, 99.0, MISSING), Hold), "the next one waits again"


def test_a_second_goal_does_not_take_the_place_of_the_one_that_waits() -> None:
    gate = GoalGate()
    gate.take(FIRST, 0.0, MISSING)
    for missing in (MISSING, []):
        refused = gate.take(SECOND, 0.0, missing)
        assert isinstance(refused, GoalRefused)
        assert refused.goal == SECOND.goal
        assert "one sweep at a time" in refused.why
    assert gate.look(1.0, []) is FIRST


def test_a_goal_that_waits_can_be_cancelled() -> None:
    gate = GoalGate()
    gate.take(FIRST, 0.0, MISSING)
    assert gate.cancel(SECOND.goal) is None
    ended = gate.cancel(FIRST.goal)
    assert isinstance(ended, GoalRefused)
    assert ended.goal == FIRST.goal
    assert gate.look(99.0, []) is None
