"""What a node says of a run in its log: once that it opens, each tenth of it once, once that it closes."""

from __future__ import annotations

from typing import Any

import numpy as np
from example_maps import RUN, plan

from bow_sim.graph.run_log import RunLog
from bow_sim.protocol.states import PlanState


def said(log: RunLog, *plans: dict[str, Any]) -> list[str]:
    return [line for one in plans for line in log.take(one)]


def test_a_run_from_its_first_to_its_last_block_is_twelve_lines_at_most() -> None:
    plans = [plan(nx=16, ny=20, done=done) for done in range(41) for _ in range(3)]
    lines = said(RunLog(), *plans, plan(PlanState.CLOSED, nx=16, ny=20, done=40), plan(PlanState.CLOSED, nx=16, ny=20))
    assert lines[0] == f"run {RUN} opens: fig11d, 16 x 20 cells of f_asym x f_init_ratio, 100 periods each"
    assert lines[1:-1] == [f"run {RUN}: {10 * n} %, {4 * n} blocks done" for n in range(1, 11)]
    assert lines[-1] == f"run {RUN} closes: 40 of 40 blocks done"


def test_of_several_tenths_at_once_only_the_last_is_said() -> None:
    log = RunLog()
    said(log, plan())
    assert said(log, plan(done=3)) == [f"run {RUN}: 70 %, 3 blocks done"]
    assert said(log, plan(done=3), plan(done=2)) == [], "a new epoch may have fewer"


def test_a_node_that_starts_late_says_how_far_the_run_is() -> None:
    assert said(RunLog(), plan(done=2))[1:] == [f"run {RUN}: 50 %, 2 blocks done"]


def test_a_node_that_hears_of_a_run_when_it_is_over_says_both_ends_once() -> None:
    closed = plan(PlanState.CLOSED, done=4)
    opens, closes = said(RunLog(), closed, closed)
    assert " opens: " in opens
    assert closes == f"run {RUN} closes: 4 of 4 blocks done"


def test_a_node_adds_what_it_has_done_itself() -> None:
    log = RunLog()
    said(log, plan())
    assert log.take(plan(done=2), lambda: "7 chunks here") == [f"run {RUN}: 50 %, 2 blocks done; 7 chunks here"]


def test_a_node_with_better_lines_for_both_ends_says_the_tenths_alone() -> None:
    log = RunLog(says_ends=False)
    assert said(log, plan(), plan(done=4), plan(PlanState.CLOSED, done=4)) == [f"run {RUN}: 100 %, 4 blocks done"]


def test_a_node_that_ends_before_the_run_says_so_once() -> None:
    log = RunLog()
    assert log.leave() == []
    said(log, plan())
    assert log.leave(lambda: "7 chunks here") == [f"run {RUN} closes: the node was told to stop; 7 chunks here"]
    assert log.leave() == []
    with_better_lines = RunLog(says_ends=False)
    said(with_better_lines, plan())
    assert with_better_lines.leave() == []


def test_the_next_run_begins_anew() -> None:
    log = RunLog()
    said(log, plan(done=4), plan(PlanState.CLOSED, done=4))
    assert [line.split()[2] for line in said(log, plan(run="f" * 16), plan(run="f" * 16, done=1))] == ["opens:", "20"]


def test_the_rounds_of_an_adaptive_sweep_are_parts_of_what_it_may_simulate() -> None:
    def adaptive(cells: int, done: int) -> dict[str, Any]:
        rounds = np.zeros(32, np.uint8)
        rounds[:cells] = 1
        values = plan(done=done)
        values["spec.settings"].append("adaptive=0.5")
        return values | {"rounds": rounds, "block_states": values["block_states"][: cells // 8]}

    log = RunLog()
    opens, half = said(log, adaptive(8, 0), adaptive(8, 1))
    assert "at most 50% of them" in opens
    assert half == f"run {RUN}: 50 %, 1 blocks done", "8 of the 16 cells that may be simulated"
    assert said(log, adaptive(16, 1), adaptive(16, 2)) == [f"run {RUN}: 100 %, 2 blocks done"]


def test_a_plan_that_is_no_sweep_is_left_to_the_node() -> None:
    assert said(RunLog(), plan() | {"spec.settings": ["x.count=0"]}) == []


def test_a_plan_without_the_name_of_a_run_says_nothing() -> None:
    log = RunLog()
    unnamed = {**plan(done=2), "run_id": ""}
    assert said(log, unnamed, unnamed, {**unnamed, "state": PlanState.CLOSED}) == []
    assert log.run == ""
    assert said(log, plan(done=2))[1:] == [f"run {RUN}: 50 %, 2 blocks done"]
