"""Processes that are stopped and go on, as a laptop's sleep or a batch system does it: the sweep ends by itself."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
from domains import own_domain
from graph import PATIENCE_S, Sweep, assert_same_map, gated, halted, run_sweep, until, verified

pytestmark = [pytest.mark.full, pytest.mark.usefixtures("ros_domain")]

LONG = ["fig11d", "--nx", "32", "--ny", "16", "--periods", "200", "--set", "block_cells=16"]
"""512 cells in 32 blocks of 40 chunks."""

BEFORE = 500
"""Chunks that each of two simulators publishes before the stop at most, so that the sweep is not over then."""

ENDS_WITHIN_S = 60.0
"""After the stop, on a machine that is busy with other things too."""

EVERYBODY = ("supervisor", "coordinator", "recorder", "classifier", "simulator_1", "simulator_2", "dashboard")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sweep without a stop."""
    with own_domain():
        return run_sweep(tmp_path_factory.mktemp("whole") / "run", *LONG)


def processes(sweep: Sweep, roles: tuple[str, ...]) -> list[psutil.Process]:
    """Return those of some roles that there are by now."""
    found = [process for role in roles if role != "supervisor" for process in sweep.children(role)]
    return [*found, psutil.Process(sweep.process.pid)] if "supervisor" in roles else found


def chance(seed: int) -> tuple[str, ...]:
    """Return a random subset of the processes, the same for the same seed."""
    roles = random.Random(seed)
    return tuple(roles.sample(EVERYBODY, roles.randint(1, len(EVERYBODY) - 1)))


CASES = [
    (1, EVERYBODY, 0.0),
    (1, ("recorder", "classifier"), 0.5),
    (1, chance(1), 1.0),
    (10, EVERYBODY, 0.8),
    (10, ("coordinator",), 0.5),
    (10, ("simulator_1", "simulator_2"), 0.5),
    (26, EVERYBODY, 0.0),
    (26, ("recorder",), 0.0),
    (26, ("coordinator", "classifier"), 0.8),
    (26, chance(2), 0.3),
    (26, chance(3), 1.5),
    (60, chance(4), 0.8),
    *((300, chance(seed), 0.8) for seed in (5, 6)),
]


@pytest.mark.parametrize(
    ("stop_s", "roles", "after_s"),
    CASES,
    ids=[f"{stop}s-after-{after}s-{'+'.join(roles) if len(roles) < 7 else 'all'}" for stop, roles, after in CASES],
)
@pytest.mark.timeout(600)
def test_a_sweep_that_is_suspended_goes_on_by_itself_and_ends_whole(
    stop_s: int, roles: tuple[str, ...], after_s: float, whole: Path, tmp_path: Path
) -> None:
    if stop_s > 60 and not os.environ.get("BOW_LONG_TESTS"):
        pytest.skip("takes minutes: only with BOW_LONG_TESTS=1")
    run = tmp_path / "run"
    with halted(run, *LONG, "--simulators", "2", chunks=BEFORE) as sweep:
        sweep.wait_until((run / "ledger.jsonl").exists)
        time.sleep(after_s)
        stopped = processes(sweep, roles)
        for process in stopped:
            process.send_signal(signal.SIGSTOP)
        sweep.go_on()
        time.sleep(stop_s)
        for process in stopped:
            with contextlib.suppress(psutil.NoSuchProcess):  # the others may have ended the sweep, and then it
                process.send_signal(signal.SIGCONT)
        began = time.monotonic()
        assert sweep.wait() == 0, sweep.text
        assert time.monotonic() - began < ENDS_WITHIN_S, sweep.text
        assert "Traceback" not in sweep.text
    verified(run)
    assert_same_map(whole, run)


LOST = """
import sys
import gated_simulator
from bow_sweep.cli import main
from bow_sweep.processes import supervisor_node, watchdog

watchdog.LOST_S = 2.0
nodes, take = [], supervisor_node.SupervisorNode.on_health

def on_health(self, message, neighbour):
    if self not in nodes:
        nodes.append(self)
    if self is not nodes[0] or "coordinator" not in self._seen.details:
        take(self, message, neighbour)

supervisor_node.SupervisorNode.on_health = on_health
gated_simulator.put_in_place()
sys.exit(main(["sweep", *sys.argv[1:]]))
"""
"""The first node of the supervisor takes in no heartbeat after the first one of the coordinator."""


def test_a_supervisor_that_hears_nothing_any_more_joins_the_graph_again(tmp_path: Path) -> None:
    run, gate, output = tmp_path / "run", tmp_path / "gate", tmp_path / "output"
    gate.write_text(str(BEFORE))
    with gated(gate), open(output, "wb") as file:
        command = [sys.executable, "-c", LOST, *LONG, "--simulators", "2", "--out", str(run)]
        sweep = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT)
    try:
        joins = lambda: "joining the graph again" in output.read_text()
        until(lambda: joins() or sweep.poll() is not None, "it does not join again")
        gate.unlink()
        assert sweep.wait(PATIENCE_S) == 0, output.read_text()
    finally:
        sweep.kill()
        sweep.wait()
    assert joins()
    assert "Traceback" not in output.read_text()
    verified(run)
