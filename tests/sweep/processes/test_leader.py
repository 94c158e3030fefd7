"""What a station knows of the coordinator of its run."""

from __future__ import annotations

import pytest

from bow_sim.protocol.neighbours import SILENT_S
from bow_sweep.processes.leader import FOUND_S, LOST_S, OVER_S, Leader

FIRST, SECOND = ("1" * 16, "near", 7), ("2" * 16, "near", 8)


@pytest.fixture
def leader() -> Leader:
    """A coordinator that is heard."""
    made = Leader()
    made.heard(*FIRST, 10.0)
    assert made.news(10.0) == ""
    return made


def test_a_coordinator_that_is_never_heard_is_given_up() -> None:
    leader = Leader()
    assert leader.lost(5.0) == ""
    assert leader.lost(5.0 + FOUND_S) == ""
    assert "is the run in progress" in leader.lost(5.1 + FOUND_S)
    assert not leader.is_away(100.0)
    assert leader.news(100.0) == ""


def test_a_run_that_was_closed_is_over_where_no_coordinator_goes_on_with_it() -> None:
    leader = Leader(was_closed=True)
    assert not leader.is_over(5.0)
    assert not leader.is_over(5.0 + OVER_S)
    assert leader.is_over(5.1 + OVER_S)
    leader.heard(*FIRST, 6.0 + OVER_S)  # somebody resumes it
    assert not leader.is_over(100.0)
    unknown = Leader()
    assert not any(unknown.is_over(now) for now in (5.0, 50.0))


def test_a_silence_is_told_once_and_so_is_its_end(leader: Leader) -> None:
    assert not leader.is_away(10.0 + SILENT_S)
    lines = [leader.news(10.1 + SILENT_S + second) for second in range(20)]
    assert "is not heard for 6 s: this station waits for `bow sweep --resume RUN`" in lines[0]
    assert not any(lines[1:])
    leader.heard(*SECOND, 40.0)
    assert [leader.news(40.0), leader.news(41.0)] == ["the coordinator is heard again: this station goes on", ""]
    assert leader.lost(40.0 + LOST_S) == ""
    assert leader.lost(40.1 + LOST_S)


def test_a_coordinator_may_die_before_it_is_heard() -> None:
    leader = Leader()
    leader.died(*FIRST[1:], "killed by SIGKILL", 10.0)
    assert leader.is_away(10.0)
    assert "has ended (killed by SIGKILL): this station waits" in leader.news(10.0)
    assert leader.lost(10.0 + LOST_S) == ""
    assert leader.lost(10.1 + LOST_S)
    leader.heard(*SECOND, 30.0)
    assert "goes on" in leader.news(30.0)


@pytest.mark.parametrize("how", ["left", "died"])
def test_its_end_is_known_at_once_by_its_own_last_word_or_its_supervisors(leader: Leader, how: str) -> None:
    if how == "left":
        leader.left(SECOND[0])  # another that was there, and had to end
        assert not leader.is_away(10.0)
        leader.left(FIRST[0])
    else:
        leader.died(*SECOND[1:], "killed by SIGKILL", 10.0)
        assert not leader.is_away(10.0)
        leader.died(*FIRST[1:], "killed by SIGKILL", 10.0)
    assert leader.is_away(10.0)
    assert leader.has_left == (how == "left")
    assert "has ended" in leader.news(10.0)
    assert leader.lost(10.0 + LOST_S) == ""
    assert "has ended" in leader.lost(10.1 + LOST_S)
    leader.heard(*SECOND, 30.0)
    assert not leader.is_away(30.0)
    assert not leader.has_left
    assert "goes on" in leader.news(30.0)


def test_it_says_what_brings_the_coordinator_back() -> None:
    leader = Leader("its graph to start it again")
    leader.heard(*FIRST, 1.0)
    assert "this station waits for its graph to start it again, 120 s at most" in leader.news(2.0 + SILENT_S)
