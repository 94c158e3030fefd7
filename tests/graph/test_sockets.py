"""Nothing listens beyond this machine: no process of a graph has a socket on another address than the loopback's."""

from __future__ import annotations

import contextlib
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import psutil
import pytest
from graph import PATIENCE_S, SMALL, halted, until
from live_viewer import HeadlessViewer, eventually, headless_stand_in, needs_vulkan, ports_of, run_of
from sockets import Socket, family, sockets_of, sockets_seen

from bow_sim.graph import discovery
from bow_sweep.view.viewer import uri_of

pytestmark = pytest.mark.usefixtures("ros_domain")

ROLES = ("coordinator", "recorder", "classifier", "simulator", "dashboard")

STUB = """#!{python}
import socket, sys, time
from pathlib import Path
words = dict(zip(sys.argv, sys.argv[1:]))
server = socket.create_server((words.get("--bind", "0.0.0.0"), int(words["--port"])))  # as rerun's own
end = time.monotonic() + 60
while time.monotonic() < end and not Path({over!r}).exists():
    time.sleep(0.05)
"""
"""Stands for rerun's window."""


@pytest.fixture(autouse=True)
def as_users_have_it(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in (discovery.RANGE, "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


def free_port() -> int:
    with socket.socket() as trial:
        trial.bind(("127.0.0.1", 0))
        return int(trial.getsockname()[1])


def has_node(pid: int) -> bool:
    """Return whether a node is among the processes below one."""
    return any(has_word(one, "--ros-args") for one in family(pid))


def has_word(process: psutil.Process, word: str) -> bool:
    """Return whether a word is on the command line of a process; it may have ended."""
    with contextlib.suppress(psutil.NoSuchProcess):
        return word in process.cmdline()
    return False


def assert_only_loopback(seen: set[Socket]) -> None:
    assert {one for one in seen if not one.is_loopback} == set()


def are_seen(seen: set[Socket], kind: str, words: str) -> bool:
    """Return whether sockets of such a process were seen."""
    return any(one.kind == kind and words in one.process for one in set(seen))  # a thread adds to it


def nodes_are_seen(seen: set[Socket], roles: Sequence[str]) -> bool:
    """Return whether sockets of a node of each role were seen."""
    return all(are_seen(seen, "UDP", f"__node:={role}") for role in roles)


def seen_in_a_sweep(run: Path, server: str, *more: str) -> set[Socket]:
    """Return the sockets of a sweep that goes on when its nodes and a server, named by words, were looked at."""
    nodes = [role for role in ROLES if role != "dashboard"]
    with halted(run, *SMALL, *more) as sweep, sockets_seen(lambda: sweep.process.pid) as seen:
        sweep.wait_until(lambda: are_seen(seen, "TCP", server) and nodes_are_seen(seen, nodes))
        sweep.go_on()
        assert sweep.wait() == 0, sweep.text
    return seen


def test_a_sweep_that_serves_its_dashboard_listens_on_the_loopback_alone(tmp_path: Path) -> None:
    assert_only_loopback(seen_in_a_sweep(tmp_path / "run", "--serve-grpc", "--port", str(free_port())))


def test_the_viewer_is_told_to_listen_there_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stub, over = tmp_path / "viewer", tmp_path / "over"
    stub.write_text(STUB.format(python=sys.executable, over=str(over)))
    stub.chmod(0o755)
    monkeypatch.setenv("RERUN_CLI_PATH", str(stub))
    monkeypatch.setenv("DISPLAY", ":77")
    try:
        assert_only_loopback(seen_in_a_sweep(tmp_path / "run", str(stub), "--view"))
    finally:
        over.touch()


@pytest.mark.full
def test_reruns_own_viewer_does_so_and_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    needs_vulkan()
    monkeypatch.setenv("RERUN_CLI_PATH", str(headless_stand_in(tmp_path / "viewer")))
    monkeypatch.setenv("DISPLAY", ":77")  # no window is opened
    run = tmp_path / "run"
    viewers: list[psutil.Process] = []
    try:
        with halted(run, *SMALL, "--view") as sweep, sockets_seen(lambda: sweep.process.pid) as seen:
            sweep.wait_until(lambda: are_seen(seen, "TCP", "--headless") and nodes_are_seen(seen, ROLES))
            viewers += [one for one in family(sweep.process.pid) if has_word(one, "--headless")]
            sweep.go_on()
            assert sweep.wait() == 0, sweep.text
        assert len(viewers) == 1
        assert viewers[0].is_running(), "it stays, with what it has received"
        assert_only_loopback(seen | sockets_of(viewers[0]))
        (port,) = ports_of([viewers[0].pid])
        viewer = HeadlessViewer(uri_of(port))
        ids = lambda: [recording.store_id for recording in viewer.client.get_state().recordings]
        eventually(lambda: len(ids()) == 1, "the viewer has one recording")
        assert run_of(run) in ids()[0]
    finally:
        for one in viewers:
            one.kill()


def test_nodes_by_hand_are_reached_by_this_machine_alone(tmp_path: Path) -> None:
    places = ["-p", f"runs_dir:={tmp_path}"]
    port = ["-p", f"port:={free_port()}"]
    more = {"coordinator": places, "recorder": places, "dashboard": places + port}
    nodes = [
        subprocess.Popen([sys.executable, "-m", "bow_sweep", role, "--ros-args", *more.get(role, [])]) for role in ROLES
    ]
    try:
        until(
            lambda: all(any(one.kind == "UDP" for one in sockets_of(psutil.Process(n.pid))) for n in nodes), "sockets"
        )
        time.sleep(1)  # they find each other
        for node in nodes:
            assert_only_loopback(sockets_of(psutil.Process(node.pid)))
    finally:
        for node in nodes:
            node.terminate()
        for node in nodes:
            node.wait(30)


def test_a_replay_through_the_graph_is_heard_by_this_machine_alone(undisturbed: Path) -> None:
    words = [sys.executable, "-m", "bow_sweep", "replay", "--graph", str(undisturbed)]
    replay = subprocess.Popen(words, stdout=subprocess.DEVNULL)
    with sockets_seen(lambda: replay.pid) as seen:
        until(lambda: has_node(replay.pid), "a node")
        replay.send_signal(signal.SIGSTOP)  # so that its classifier stays until it was looked at
        until(lambda: are_seen(seen, "UDP", "classifier"), "its sockets")
        replay.send_signal(signal.SIGCONT)
        assert replay.wait(PATIENCE_S) == 0
    assert_only_loopback(seen)
