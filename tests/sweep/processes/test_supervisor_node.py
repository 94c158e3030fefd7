"""The supervisor releases processes whose work is over, when the plan of its own run is closed."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from bow_msgs.msg import Health, Plan

from bow_sim.protocol import cdr
from bow_sweep.processes.supervisor import Child, GraphError, Supervisor
from bow_sweep.processes.supervisor_node import Observed, SupervisorNode, release_finished, restart_unresponsive
from bow_sweep.processes.watchdog import Watchdog

RUN = "a" * 16


def plan(run_id: str, state: int) -> bytes:
    kinds = {"string": "", "string[]": [], "uint8[]": [], "uint8": 0, "uint32": 1}
    values = {field: kinds[kind] for field, kind in cdr.FIELDS["Plan"].items()}
    return cdr.encode("Plan", {**values, "run_id": run_id, "state": state})


@pytest.mark.parametrize(
    ("data", "closed"),
    [
        (plan(RUN, Plan.CLOSED), True),
        (plan(RUN, Plan.OPEN), False),
        (plan("b" * 16, Plan.CLOSED), False),
        (plan(RUN, Plan.CLOSED)[:40], False),
    ],
)
def test_only_the_closed_plan_of_our_run_releases_simulators(data: bytes, closed: bool) -> None:
    seen = Observed(Watchdog(RUN))
    node = SimpleNamespace(_seen=seen, run_namespace=f"/bow/{RUN}")
    SupervisorNode._on_plan(node, data)  # type: ignore[arg-type]
    assert seen.closed is closed


@pytest.mark.parametrize(("again", "stays"), [({}, False), ({"resume": "run"}, False), ({}, True)])
def test_a_coordinator_that_hears_nobody_is_ended_where_another_can_go_on(
    again: dict[str, object], stays: bool, tmp_path: Path
) -> None:
    process = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    supervisor = Supervisor("/bow/x", tmp_path, {"coordinator": {"preset": "fig11d"}})
    supervisor.again = again
    supervisor.children.append(Child("coordinator", "coordinator", process, tmp_path / "coordinator.log"))
    seen = Observed(Watchdog(RUN))
    seen.watchdog.deaf = process.pid
    seen.watchdog.stuck = lambda *_: {process.pid}  # type: ignore[method-assign]
    lines: list[str] = []
    try:
        if again or stays:
            restart_unresponsive(supervisor, seen, lines.append, Counter(), stays)
            assert process.wait(10) == -signal.SIGKILL
            assert "the coordinator does not hear all others, or not those that were started again" in lines[0]
        else:
            with pytest.raises(GraphError, match="the coordinator does not hear all others"):
                restart_unresponsive(supervisor, seen, lines.append, Counter(), stays)
            assert process.poll() is None
    finally:
        process.kill()
        process.wait()


@pytest.mark.parametrize(
    ("coordinator", "dashboard", "released"),
    [
        (Health.BUSY, Health.BUSY, {"simulator", "classifier"}),
        (Health.BUSY, Health.CLOSED, {"simulator", "classifier", "dashboard"}),
        (Health.READY, Health.BUSY, {"simulator", "classifier", "recorder", "dashboard"}),
        (Health.CLOSED, Health.CLOSED, {"simulator", "classifier", "recorder", "dashboard"}),
    ],
)
def test_each_process_is_released_when_its_work_is_over(coordinator: int, dashboard: int, released: set[str]) -> None:
    seen, roles = Observed(Watchdog(RUN)), set()
    supervisor: Any = SimpleNamespace(release=roles.update)
    seen.states.update(coordinator=coordinator, dashboard=dashboard)
    assert not release_finished(supervisor, seen)
    assert not roles
    seen.closed = True
    assert release_finished(supervisor, seen) is (coordinator == Health.READY)
    assert roles == released


PATIENT = """
import signal, time
signal.signal(signal.SIGINT, signal.SIG_DFL)  # where the tests run in the background, it is ignored
print("ready", flush=True)
time.sleep(60)
"""


def test_released_processes_end_and_their_exit_is_not_reported(tmp_path: Path) -> None:
    supervisor = Supervisor("/bow/x", tmp_path, {})
    for name in ("simulator_1", "simulator_2", "recorder"):
        process = subprocess.Popen([sys.executable, "-c", PATIENT], stdout=subprocess.PIPE)
        assert process.stdout
        with process.stdout as output:
            assert output.readline() == b"ready\n"
        supervisor.children.append(Child(name.partition("_")[0], name, process, tmp_path / f"{name}.log"))
    simulators = supervisor.children[:2]
    supervisor.release(("simulator",))
    supervisor.release(("simulator",))
    for child in simulators:
        child.process.wait(10)
    assert supervisor.exited() == []
    assert [child.name for child in supervisor.children] == ["recorder"]
    assert supervisor.stop(idle=True) == []
    assert supervisor.children == []
