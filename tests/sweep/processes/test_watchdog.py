"""How long a supervisor waits for its processes, and which it restarts."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

from bow_sim.protocol.states import NodeState
from bow_sweep.processes.watchdog import (
    AFTER_STOP_S,
    JOINS,
    LOST_S,
    STALL_S,
    STUCK_S,
    UNHEARD_S,
    Usage,
    Watchdog,
    usage,
)

RUN = "a" * 16


class Machine:
    """Processes that compute or are stopped, as a test sets them."""

    def __init__(self) -> None:
        self.stopped: set[int] = set()
        self.cpu: dict[int, float] = {}
        self.read: dict[int, int] = {}
        self.starved: set[int] = set()

    def usage(self, pid: int) -> Usage:
        return Usage(pid in self.stopped, pid in self.starved, self.cpu.get(pid, 0.0), self.read.get(pid, 0))


@pytest.fixture
def machine() -> Machine:
    return Machine()


def test_a_stuck_process_is_named_once_consumers_first(machine: Machine) -> None:
    watchdog = Watchdog(RUN, machine.usage)

    def heartbeat(pid: int, role: str, state: int, now: float, run: str = RUN) -> None:
        watchdog.heartbeat(pid, role, state, run, now)

    heartbeat(9, "coordinator", NodeState.BUSY, 0)
    heartbeat(1, "recorder", NodeState.STARTING, 0)
    heartbeat(2, "simulator", NodeState.STARTING, 0)
    heartbeat(3, "classifier", NodeState.STARTING, 0)
    heartbeat(4, "simulator", NodeState.STARTING, 0, run="")  # waits for a plan
    heartbeat(1, "recorder", NodeState.STARTING, STUCK_S)
    heartbeat(3, "classifier", NodeState.BUSY, 1)
    assert watchdog.stuck(STUCK_S) == set()
    assert watchdog.stuck(STUCK_S + 1) == {1}
    assert watchdog.stuck(STUCK_S + 1) == set()
    heartbeat(5, "recorder", NodeState.STARTING, STUCK_S + 2)
    heartbeat(5, "recorder", NodeState.BUSY, STUCK_S + 3)
    assert watchdog.stuck(2 * STUCK_S + 1) == set()
    assert watchdog.stuck(2 * STUCK_S + 2) == {2}
    assert watchdog.stuck(3 * STUCK_S + 3) == set()
    assert watchdog.worked == {3, 5, 9}


def test_a_consumer_that_has_not_opened_the_run_is_named_before_those_that_wait_for_it(machine: Machine) -> None:
    watchdog = Watchdog(RUN, machine.usage)
    for pid, role in ((1, "classifier"), (2, "simulator")):
        watchdog.heartbeat(pid, role, NodeState.STARTING, RUN, 0)
    watchdog.heartbeat(3, "recorder", NodeState.READY, "", 0)
    assert watchdog.stuck(100) == set()  # the coordinator reads a bag, say, before it opens the run
    watchdog.heartbeat(9, "coordinator", NodeState.STARTING, RUN, 100)
    assert watchdog.stuck(100 + STUCK_S) == set()
    assert watchdog.stuck(101 + STUCK_S) == {3}
    watchdog.heartbeat(4, "recorder", NodeState.BUSY, RUN, 110)
    assert watchdog.stuck(102 + 2 * STUCK_S) == {1}


def unheard_after(watchdog: Watchdog, pids: set[int], start: int, end: int) -> set[int]:
    """Check once a second; return the processes that are unheard at the end."""
    found: set[int] = set()
    for now in range(start, end):
        found = watchdog.unheard(pids, float(now))
    return found


def test_a_process_that_is_not_heard_and_does_not_compute_is_named(machine: Machine) -> None:
    watchdog = Watchdog(RUN, machine.usage)
    watchdog.heartbeat(1, "recorder", NodeState.BUSY, RUN, 0.0)
    assert unheard_after(watchdog, {1, 2}, 0, int(UNHEARD_S)) == set()
    watchdog.heartbeat(1, "recorder", NodeState.BUSY, RUN, UNHEARD_S)
    assert unheard_after(watchdog, {1, 2}, int(UNHEARD_S), int(UNHEARD_S) + 3) == {2}


def test_a_process_that_computes_or_reads_is_still_starting(machine: Machine) -> None:
    watchdog = Watchdog(RUN, machine.usage)
    for now in range(60):
        machine.cpu[1] = 0.5 * now
        machine.read[2] = 10_000_000 * now
        machine.starved = {3} if now % 3 == 0 else set()  # others have the cores
        assert watchdog.unheard({1, 2, 3}, float(now)) == set()
    machine.starved = set()
    assert unheard_after(watchdog, {1, 2, 3}, 60, 60 + int(UNHEARD_S) + 3) == {1, 2, 3}


def test_a_busy_process_has_longer_to_get_ready(machine: Machine) -> None:
    watchdog = Watchdog(RUN, machine.usage)
    watchdog.heartbeat(9, "coordinator", NodeState.BUSY, RUN, 0)
    watchdog.heartbeat(1, "recorder", NodeState.STARTING, RUN, 0)
    machine.starved = {1}
    for now in range(60):
        watchdog.unheard({1}, float(now))
        assert watchdog.stuck(float(now)) == set()
    machine.starved = set()
    assert watchdog.stuck(60 + STUCK_S) == {1}


def test_time_in_which_a_process_is_stopped_does_not_count(machine: Machine) -> None:
    watchdog = Watchdog(RUN, machine.usage)
    watchdog.heartbeat(1, "recorder", NodeState.STARTING, RUN, 0.0)
    watchdog.progress("half", 0.0)
    machine.stopped = {2}
    for now in range(1000):
        assert watchdog.suspend_timeouts({1, 2}, float(now)) == {2}
    machine.stopped = set()
    assert watchdog.suspend_timeouts({1, 2}, 1000.0) == set()
    assert watchdog.stuck(1000.0) == set()
    watchdog.heartbeat(9, "coordinator", NodeState.STARTING, RUN, 1000.0)
    assert watchdog.stuck(1000.0 + AFTER_STOP_S) == set()
    assert watchdog.stuck(1001.0 + AFTER_STOP_S) == {1}  # all have long started
    assert watchdog.unheard({1, 2}, 1000.0) == set()


def test_a_sweep_without_progress_is_given_up_in_the_end(machine: Machine) -> None:
    watchdog = Watchdog(RUN, machine.usage)
    watchdog.progress(0, 0.0)
    assert not watchdog.is_stalled(10 * STALL_S)  # the coordinator reads a bag, say
    watchdog.heartbeat(9, "coordinator", NodeState.BUSY, RUN, 10.0)
    watchdog.progress(5, 10.0)
    watchdog.progress(5, 10.0 + STALL_S)
    assert not watchdog.is_stalled(10.0 + STALL_S)
    assert watchdog.is_stalled(11.0 + STALL_S)
    watchdog.progress(6, 11.0 + STALL_S)
    assert not watchdog.is_stalled(12.0 + STALL_S)


def test_usage_tells_whether_a_process_is_stopped_and_its_cpu_time() -> None:
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as process:
        try:
            deadline = time.monotonic() + 20
            while usage(process.pid).cpu_s < 0.1:
                assert time.monotonic() < deadline
            assert not usage(process.pid).stopped
            os.kill(process.pid, signal.SIGSTOP)
            while not usage(process.pid).stopped:
                assert time.monotonic() < deadline
        finally:
            process.kill()
    assert usage(process.pid) == Usage()


def test_a_coordinator_that_was_heard_and_no_longer_is_makes_the_supervisor_join_again(machine: Machine) -> None:
    watchdog = Watchdog(RUN, machine.usage)
    assert not watchdog.must_join_again(100)  # not heard yet: it may still be starting
    watchdog.heartbeat(9, "coordinator", NodeState.BUSY, RUN, 100)
    watchdog.heartbeat(1, "recorder", NodeState.BUSY, RUN, 90)
    for join in range(1, JOINS + 1):
        assert not watchdog.must_join_again(100 + join * LOST_S)
        watchdog.heartbeat(1, "recorder", NodeState.BUSY, RUN, 90)
        assert watchdog.must_join_again(100 + join * (LOST_S + 1))
        assert watchdog.unheard({1, 9}, 101 + join * (LOST_S + 1)) == set()  # all timeouts have started again
    assert not watchdog.must_join_again(200)  # it does not help
    assert 9 in unheard_after(watchdog, {1, 9}, 200, 201 + int(UNHEARD_S))
    watchdog.heartbeat(9, "coordinator", NodeState.BUSY, RUN, 300)
    assert watchdog.must_join_again(301 + LOST_S)  # heard in between


def test_a_coordinator_that_is_stopped_or_computes_is_no_reason_to_join_again(machine: Machine) -> None:
    watchdog = Watchdog(RUN, machine.usage)
    watchdog.heartbeat(9, "coordinator", NodeState.BUSY, RUN, 0)
    machine.stopped = {9}
    watchdog.suspend_timeouts({9}, 50)
    assert not watchdog.must_join_again(50)
    machine.stopped = set()
    for now in range(50, 100):
        machine.cpu[9] = float(now)
        watchdog.unheard({9}, float(now))
        assert not watchdog.must_join_again(now)


def test_while_the_coordinator_is_away_no_process_is_late_but_the_connections_are_looked_after(
    machine: Machine,
) -> None:
    watchdog = Watchdog(RUN, machine.usage)
    watchdog.heartbeat(9, "coordinator", NodeState.BUSY, RUN, 0)
    watchdog.heartbeat(1, "recorder", NodeState.STARTING, RUN, 0)
    for now in range(1, 100):
        watchdog.pause(now)
        assert watchdog.stuck(now) == watchdog.unheard([1], now) == set()
    assert watchdog.must_join_again(99)
    assert watchdog.stuck(99 + STUCK_S) == set()
    assert watchdog.stuck(100 + STUCK_S) == {1}


def test_where_successors_of_recorder_and_classifier_are_not_heard_the_coordinator_is_restarted_once(
    machine: Machine,
) -> None:
    watchdog = Watchdog(RUN, machine.usage)
    now, pid = 0.0, 1
    watchdog.heartbeat(9, "coordinator", NodeState.STARTING, RUN, now)
    watchdog.heartbeat(1, "recorder", NodeState.STARTING, "", now)  # the one before was killed; it may not open the run
    watchdog.heartbeat(2, "classifier", NodeState.BUSY, RUN, now)
    consumers, named = {"recorder": 1, "classifier": 2}, []
    for _ in range(5):
        now += STUCK_S + 1
        stuck = watchdog.stuck(now, {*consumers.values(), 9})
        named.append({role for role, process in consumers.items() if process in stuck} or stuck)
        for role in [role for role, process in consumers.items() if process in stuck]:
            pid = consumers[role] = 10 + pid
            run = "" if role == "recorder" else RUN  # which opens a run only where it is heard itself
            watchdog.heartbeat(pid, role, NodeState.STARTING, run, now)
        if watchdog.deaf:
            watchdog.heartbeat(100, "coordinator", NodeState.STARTING, RUN, now)  # its successor, and deaf too
    both = {"recorder", "classifier"}
    assert named == [{"recorder"}, both, {9}, {"recorder"}, both], "once; what comes then ends the sweep"
    assert watchdog.deaf == 9
    assert not watchdog.must_join_again(now + LOST_S - STUCK_S)


def test_where_all_others_are_ready_the_coordinator_is_restarted_once(machine: Machine) -> None:
    watchdog = Watchdog(RUN, machine.usage)
    for now, process in ((0.0, 9), (20.0, 100)):
        watchdog.heartbeat(process, "coordinator", NodeState.STARTING, RUN, now, "own", ["a", "b", "c"])
        for pid, role, incarnation in ((1, "recorder", "a"), (2, "classifier", "b"), (3, "simulator", "c")):
            watchdog.heartbeat(pid, role, NodeState.BUSY, RUN, now, incarnation)
        assert watchdog.stuck(now + STUCK_S - 1, {1, 2, 3, process}) == set()
        assert watchdog.stuck(now + STUCK_S + 1, {1, 2, 3, process}) == {process}
        assert watchdog.deaf == 9, "once; what comes then ends the sweep"


def test_a_coordinator_of_another_machine_is_not_restarted(machine: Machine) -> None:
    watchdog = Watchdog(RUN, machine.usage)
    watchdog.heartbeat(0, "coordinator", NodeState.BUSY, RUN, 0)
    for turn in range(4):
        now = turn * 20.0
        for pid, role in ((1, "recorder"), (2, "classifier")):
            watchdog.heartbeat(10 * turn + pid, role, NodeState.STARTING, RUN, now)
        ours = {10 * turn + 1, 10 * turn + 2}
        assert watchdog.stuck(now + STUCK_S + 1, ours) == ours
    assert not watchdog.deaf


def test_a_coordinator_never_heard_is_looked_for_after_a_stop(machine: Machine) -> None:
    watchdog = Watchdog(RUN, machine.usage)
    watchdog.note_stop(50)
    watchdog.note_stop(51)  # each look says so
    assert not watchdog.must_join_again(50 + LOST_S)
    assert watchdog.must_join_again(51 + LOST_S)


def test_of_a_coordinator_that_waits_alone_those_are_restarted_that_it_does_not_hear(machine: Machine) -> None:
    watchdog = Watchdog(RUN, machine.usage)
    needed = {1, 2, 3, 4, 9}

    def coordinator(state: int, hears: list[str], now: float) -> None:
        watchdog.heartbeat(9, "coordinator", state, RUN, now, "c", hears)

    for pid, role in ((1, "recorder"), (2, "classifier"), (3, "simulator")):
        watchdog.heartbeat(pid, role, NodeState.READY, RUN, 0, f"incarnation{pid}")
    watchdog.note_stop(0)
    hears = ["incarnation1 health receipts", "incarnation2 health verdicts"]
    coordinator(NodeState.STARTING, hears, 1)
    assert watchdog.stuck(1 + 2 * STUCK_S, needed) == set()  # process 4 was never heard: it may be starting
    watchdog.heartbeat(4, "simulator", NodeState.READY, RUN, 30, "incarnation4")
    assert watchdog.stuck(30 + AFTER_STOP_S, needed) == {3}
    needed = {1, 2, 4, 5, 9}  # 5 in place of 3, which was killed
    assert watchdog.stuck(60, needed) == set()
    watchdog.heartbeat(5, "simulator", NodeState.READY, RUN, 60, "incarnation5")
    coordinator(NodeState.STARTING, [*hears, "incarnation5 health"], 61)
    assert watchdog.stuck(62, needed) == {4}
    needed = {1, 2, 5, 6, 9}
    watchdog.heartbeat(6, "simulator", NodeState.READY, RUN, 63, "incarnation6")
    coordinator(NodeState.STARTING, [*hears, "incarnation5 health", "incarnation6 health"], 64)
    assert watchdog.stuck(62 + AFTER_STOP_S, needed) == set()
    assert watchdog.stuck(63 + AFTER_STOP_S, needed) == {9}  # it hears all, and is not ready all the same
    coordinator(NodeState.BUSY, [], 80)
    assert watchdog.stuck(200, needed) == set()


def test_where_a_successor_is_not_heard_either_the_other_consumer_is_restarted_too(machine: Machine) -> None:
    watchdog = Watchdog(RUN, machine.usage)
    watchdog.heartbeat(9, "coordinator", NodeState.STARTING, RUN, 0)
    watchdog.heartbeat(1, "recorder", NodeState.BUSY, RUN, 0)
    watchdog.heartbeat(2, "classifier", NodeState.STARTING, RUN, 0)
    assert watchdog.stuck(1 + STUCK_S, {1, 2, 9}) == {2}
    watchdog.heartbeat(3, "classifier", NodeState.STARTING, RUN, 20)
    assert watchdog.stuck(21 + STUCK_S, {1, 3, 9}) == {1, 3}
    watchdog.heartbeat(4, "recorder", NodeState.BUSY, RUN, 40)
    watchdog.heartbeat(5, "classifier", NodeState.BUSY, RUN, 40)
    watchdog.heartbeat(5, "classifier", NodeState.STARTING, RUN, 50)  # not for the same reason
    assert watchdog.stuck(51 + STUCK_S, {4, 5, 9}) == {5}


BOTH_STREAMS = "bridge_force stick_slip"


def consumers_and_simulators(watchdog: Watchdog, now: float, heard_by_recorder: dict[int, str]) -> None:
    """Heartbeats of a recorder, 1, of what it hears from which process, a classifier, 2, and simulators that wait."""
    heard = [f"incarnation{pid} health {topics}" for pid, topics in heard_by_recorder.items()]
    watchdog.heartbeat(9, "coordinator", NodeState.BUSY, RUN, now)
    watchdog.heartbeat(1, "recorder", NodeState.BUSY, RUN, now, "r", heard)
    everything = [f"incarnation{pid} health {BOTH_STREAMS}" for pid in heard_by_recorder]
    watchdog.heartbeat(2, "classifier", NodeState.BUSY, RUN, now, "c", everything)
    for pid in heard_by_recorder:
        watchdog.heartbeat(pid, "simulator", NodeState.STARTING, RUN, now, f"incarnation{pid}")


def test_a_recorder_that_hears_a_stream_of_no_simulator_is_restarted_instead_of_these(machine: Machine) -> None:
    watchdog = Watchdog(RUN, machine.usage)
    consumers_and_simulators(watchdog, 0, {3: "stick_slip", 4: "stick_slip"})
    assert watchdog.stuck(STUCK_S + 1, {1, 2, 3, 4, 9}) == {1}
    assert watchdog.stuck(2 * STUCK_S, {2, 3, 4, 9}) == set(), "the simulators have as long again"


def test_a_recorder_that_does_not_hear_a_simulator_and_then_its_successor_is_restarted(machine: Machine) -> None:
    watchdog = Watchdog(RUN, machine.usage)
    consumers_and_simulators(watchdog, 0, {3: "stick_slip"})
    assert watchdog.stuck(STUCK_S + 1, {1, 2, 3, 9}) == {3}, "it may be the simulator that does not publish"
    consumers_and_simulators(watchdog, STUCK_S + 2, {4: ""})
    assert watchdog.stuck(2 * STUCK_S + 3, {1, 2, 4, 9}) == {1}


def test_a_recorder_need_not_hear_the_simulators_of_other_stations(machine: Machine) -> None:
    watchdog = Watchdog(RUN, machine.usage)
    consumers_and_simulators(watchdog, 0, {3: BOTH_STREAMS})
    for pid in (4, 5):
        watchdog.heartbeat(pid, "simulator", NodeState.STARTING, RUN, 0, f"incarnation{pid}", station="lab")
    assert watchdog.stuck(STUCK_S + 1, {1, 2, 3, 4, 5, 9}) == {3, 4, 5}
