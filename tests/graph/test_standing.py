"""A graph that stays: sweeps use it, and what they leave is what a graph of their own leaves."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest
from graph import (
    PATIENCE_S,
    SMALL,
    TINY,
    assert_same_map,
    bow,
    gated,
    has_ended,
    kill_at_once,
    nodes_of,
    run_sweep,
    sweeping,
    until,
    verified,
)

from bow_sim.graph.shm_files import files_of, is_port
from bow_sweep.standing.client import CANCEL_S
from bow_sweep.standing.state import FILE, default_folder, read_state

pytestmark = [pytest.mark.usefixtures("ros_domain"), pytest.mark.full]

LONG = ["fig11d", "--nx", "32", "--ny", "16", "--set", "block_cells=8", "--periods", "60", "--no-dashboard"]
"""512 cells in 64 blocks of 12 chunks."""


@pytest.fixture
def gate(tmp_path: Path) -> Path:
    """The file that says how many chunks of a run the simulator of `up` publishes; without it, all."""
    return tmp_path / "gate"


@pytest.fixture
def up(ros_domain: int, gate: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A standing graph with one simulator; yields its folder."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with gated(gate):
        began = bow("up", "--simulators", "1", "--root", str(tmp_path / "root"), module="gated_simulator")
    assert began.returncode == 0, began.stderr
    folder = default_folder()
    yield folder
    state = read_state(folder)
    if state is not None:
        kill_at_once([psutil.Process(state.pid), *nodes_of(state.pid)])


def shared_memory(pid: int) -> set[str]:
    """Return the files that a graph has in shared memory, but for ports: other processes may use them afterwards."""
    files = set[str]().union(*(files_of(process) for process in (pid, *(node.pid for node in nodes_of(pid)))))
    return {file for file in files if not is_port(file)}


def send_a_goal_as_others_do() -> Any:
    """Send a goal without a note of where its run goes; return the result."""
    from bow_msgs.action import RunSweep
    from bow_msgs.msg import SweepSpec

    from bow_sweep.standing.client import connect

    spec = SweepSpec(preset="fig11d", settings=["x.count=2", "y.count=2", "periods=20"])
    with connect() as graph:
        action = graph._action
        until(lambda: graph.spin() or action.server_is_ready(), "no coordinator")
        sent = action.send_goal_async(RunSweep.Goal(spec=spec))
        until(lambda: graph.spin() or sent.done(), "no answer")
        answer = sent.result().get_result_async()
        until(lambda: graph.spin() or answer.done(), "no result")
        return answer.result().result


def status() -> dict:
    found: dict = json.loads(bow("status", "--json").stdout)
    return found


def test_sweeps_leave_what_a_graph_of_their_own_leaves_and_nothing_is_left_of_the_graph(
    up: Path, undisturbed: Path, tmp_path: Path
) -> None:
    state = read_state(up)
    assert state is not None
    assert bow("up").returncode == 1, "there is one already"

    with sweeping(tmp_path / "one", *SMALL, "--out", str(tmp_path / "one")) as one:
        other = ["--out", str(tmp_path / "other"), "--no-dashboard"]
        with sweeping(tmp_path / "other", *SMALL, *other) as at_once:
            assert one.wait() == at_once.wait() == 0, one.text + at_once.text
    for sweep in (one, at_once):
        assert "uses the graph" in sweep.text
        assert verified(sweep.directory)["cells"] == 128
        assert_same_map(undisturbed, sweep.directory)
    names = {path.name for path in undisturbed.iterdir()} - {"log"}
    assert {path.name for path in one.directory.iterdir()} == names
    assert {path.name for path in at_once.directory.iterdir()} == names - {"dashboard.rrd"}

    found = status()
    assert found["missing"] == []
    assert found["run"] is None
    assert found["clients"] == []
    assert {node["role"] for node in found["nodes"]} == {
        "coordinator",
        "recorder",
        "classifier",
        "simulator",
        "dashboard",
    }
    assert all(node["memory_bytes"] > 1e7 for node in found["nodes"])

    result = send_a_goal_as_others_do()
    assert Path(result.directory) == tmp_path / "root" / result.run_id
    verified(Path(result.directory))

    family = [psutil.Process(state.pid), *nodes_of(state.pid)]
    files = shared_memory(state.pid)
    assert files
    ended = bow("down")
    assert ended.returncode == 0, ended.stderr
    assert all(map(has_ended, family))
    assert not (up / FILE).exists()
    assert not list((up / "places").iterdir())
    assert not [file for file in files if Path(file).exists()]
    assert status()["graph"] is None
    assert "there is no graph" in bow("down").stdout


def test_a_run_that_is_cancelled_before_its_goal_is_answered_does_not_go_on(
    up: Path, gate: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from bow_sweep.plan.sweep import Sweep
    from bow_sweep.standing.client import connect

    gate.write_text("30")
    sent: list[Any] = []
    with connect() as graph:
        send = graph._action.send_goal_async

        def keep(*arguments: Any, **named: Any) -> Any:
            sent.append(send(*arguments, **named))
            return sent[0]

        monkeypatch.setattr(graph._action, "send_goal_async", keep)
        sweep = Sweep.from_spec("fig11d", ["x.count=32", "y.count=16", "block_cells=8", "periods=60"])
        with pytest.raises(KeyboardInterrupt):
            graph.run(sweep, tmp_path / "run", dashboard=False, cancelled=lambda: bool(sent))
    assert status()["run"] is None
    gate.unlink()
    with sweeping(tmp_path / "run", "--resume", str(tmp_path / "run"), "--no-dashboard") as again:
        assert again.wait() == 0, again.text
    verified(tmp_path / "run")


def test_clients_and_nodes_may_be_killed_and_the_graph_goes_on(
    up: Path, gate: Path, undisturbed_tiny: Path, tmp_path: Path
) -> None:
    gate.write_text("30")  # two and a half blocks of each run
    run = tmp_path / "interrupted"
    with sweeping(run, *LONG, "--out", str(run)) as sweep:
        sweep.wait_until(lambda: sweep.done_blocks() >= 2)
        os.kill(sweep.process.pid, signal.SIGINT)
        assert sweep.wait() == 130, sweep.text
        assert "--resume" in sweep.text
    assert sweep.done_blocks() < 64

    killed = tmp_path / "killed"
    with sweeping(killed, *LONG, "--out", str(killed)) as sweep:
        sweep.wait_until(lambda: sweep.done_blocks() >= 1)
        os.kill(sweep.process.pid, signal.SIGKILL)
    gate.unlink()
    tiny = run_sweep(tmp_path / "tiny", *TINY, "--no-dashboard")  # its turn comes when the run without a client is over
    assert_same_map(undisturbed_tiny, tiny)
    assert verified(killed)["cells"] == 512

    with sweeping(run, "--resume", str(run), "--no-dashboard") as sweep:
        assert sweep.wait() == 0, sweep.text
        assert "uses the graph" in sweep.text
    assert_same_map(killed, run)
    verified(run)

    # a node is started again, and a killed coordinator costs the run in progress only
    state = read_state(up)
    assert state is not None
    gate.write_text("30")
    other = tmp_path / "other"
    with sweeping(other, *LONG, "--out", str(other)) as sweep:
        sweep.wait_until(lambda: sweep.done_blocks() >= 1)
        nodes_of(state.pid, "coordinator")[0].kill()
        killed_at = time.monotonic()
        assert sweep.wait() == 1, sweep.text
        assert time.monotonic() - killed_at < CANCEL_S, "the next coordinator has nothing to cancel"
        assert "the coordinator of the standing graph was started again" in sweep.text
        assert f"--resume {other}" in sweep.text
    gate.unlink()
    nodes_of(state.pid, "recorder")[0].kill()  # between two runs
    with sweeping(other, "--resume", str(other), "--no-dashboard") as sweep:
        assert sweep.wait() == 0, sweep.text
    assert_same_map(killed, other)
    verified(other)
    assert read_state(up) == state


def test_of_a_graph_that_is_killed_nothing_is_left_and_another_can_be_started(
    up: Path, gate: Path, tmp_path: Path
) -> None:
    state = read_state(up)
    assert state is not None
    family, files = nodes_of(state.pid), shared_memory(state.pid)
    gate.write_text("30")
    run = tmp_path / "run"
    with sweeping(run, *LONG, "--out", str(run)) as sweep:
        sweep.wait_until(lambda: sweep.done_blocks() >= 1)
        os.kill(state.pid, signal.SIGKILL)
        assert sweep.wait() == 1, sweep.text
        assert "the standing graph has ended" in sweep.text
    assert "ended without" in bow("status").stderr
    psutil.wait_procs(family, timeout=PATIENCE_S)
    until(lambda: not [file for file in files if Path(file).exists()], "the cleaner removes shared memory")
    began = bow("up", "--simulators", "1", "--no-dashboard")
    assert began.returncode == 0, began.stderr
    assert "ended without `bow down`" in began.stderr
    with sweeping(run, "--resume", str(run), "--no-dashboard") as sweep:
        assert sweep.wait() == 0, sweep.text
        assert "uses the graph" in sweep.text
    verified(run)
    assert bow("down").returncode == 0
