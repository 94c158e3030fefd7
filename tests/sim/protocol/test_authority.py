"""Only the coordinator that a run belongs to is obeyed."""

from __future__ import annotations

from typing import Any

import pytest

from bow_sim.protocol.authority import MOST_CLOSED, Authority
from bow_sim.protocol.states import PlanState

RUN, OTHER_RUN = "a" * 16, "b" * 16
MINE, THEIRS = "c" * 16, "d" * 16


def plan(run_id: str = RUN, incarnation: str = MINE, epoch: int = 1, state: int = PlanState.OPEN) -> dict[str, Any]:
    return {"run_id": run_id, "incarnation": incarnation, "epoch": epoch, "state": state}


@pytest.fixture
def living() -> set[tuple[str, str]]:
    """Coordinators that are there, each with its run."""
    return {(MINE, RUN)}


@pytest.fixture
def authority(living: set[tuple[str, str]]) -> Authority:
    made = Authority(lambda incarnation, run_id: (incarnation, run_id) in living)
    assert made.objection(plan()) == ""
    return made


def test_plans_of_the_same_coordinator_are_obeyed_as_they_come(authority: Authority) -> None:
    assert authority.objection(plan(epoch=1)) == ""
    assert authority.objection(plan(epoch=2)) == ""
    assert "epoch 2" in authority.objection(plan(epoch=1))
    assert authority.objection(plan(epoch=2, state=PlanState.CLOSED)) == ""
    assert authority.run_id == ""


def test_a_run_in_progress_is_not_left_for_the_plan_of_another(
    authority: Authority, living: set[tuple[str, str]]
) -> None:
    for state in (PlanState.OPEN, PlanState.CLOSED):
        assert OTHER_RUN in authority.objection(plan(OTHER_RUN, THEIRS, epoch=9, state=state))
    assert (authority.run_id, authority.owner) == (RUN, MINE)
    living.clear()
    assert "closes" in authority.objection(plan(OTHER_RUN, THEIRS, state=PlanState.CLOSED))
    assert authority.objection(plan(OTHER_RUN, THEIRS)) == ""
    assert (authority.run_id, authority.owner) == (OTHER_RUN, THEIRS)


def test_a_bag_of_this_very_run_that_is_played_changes_nothing(authority: Authority) -> None:
    assert authority.objection(plan(epoch=5)) == ""
    for epoch in (1, 5):
        for state in (PlanState.OPEN, PlanState.CLOSED):
            assert authority.objection(plan(incarnation=THEIRS, epoch=epoch, state=state))
    assert authority.run_id == RUN


def test_a_coordinator_that_resumes_the_run_is_obeyed_in_its_newer_epoch(authority: Authority) -> None:
    assert authority.objection(plan(incarnation=THEIRS, epoch=2)) == ""
    assert authority.objection(plan(incarnation=MINE, epoch=1))
    assert authority.owner == THEIRS


def test_the_same_coordinator_may_go_on_to_its_next_run_when_it_no_longer_works_for_this_one(
    authority: Authority, living: set[tuple[str, str]]
) -> None:
    assert "in progress" in authority.objection(plan(OTHER_RUN))
    living.clear()
    living.add((MINE, OTHER_RUN))
    assert authority.objection(plan(OTHER_RUN)) == ""
    assert authority.run_id == OTHER_RUN


def test_a_bag_of_a_run_that_was_closed_is_not_obeyed_when_no_run_is_in_progress(authority: Authority) -> None:
    assert authority.objection(plan(epoch=3, state=PlanState.CLOSED)) == ""
    for epoch in (1, 3):
        for state in (PlanState.OPEN, PlanState.CLOSED):
            assert "over" in authority.objection(plan(epoch=epoch, state=state))
    assert authority.objection(plan(epoch=4)) == ""  # it is resumed


def test_of_the_runs_that_were_closed_the_latest_are_remembered(authority: Authority) -> None:
    runs = [f"{number:016x}" for number in range(MOST_CLOSED + 1)]
    assert authority.objection(plan(state=PlanState.CLOSED)) == ""
    for run in runs:
        assert authority.objection(plan(run)) == ""
        assert authority.objection(plan(run, state=PlanState.CLOSED)) == ""
    assert all("over" in authority.objection(plan(run)) for run in runs[1:])
    assert len(authority._closed) == MOST_CLOSED
    assert authority.objection(plan(runs[1], epoch=2, state=PlanState.CLOSED)) == ""  # resumed: the latest again
    assert authority.objection(plan(state=PlanState.CLOSED, epoch=2)) == ""
    assert "over" in authority.objection(plan(runs[1], epoch=2))


def test_where_no_run_is_in_progress_any_plan_is_obeyed(authority: Authority) -> None:
    authority.release()
    assert authority.objection(plan(OTHER_RUN, "", epoch=0)) == ""
