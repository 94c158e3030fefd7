"""The processes of a graph share what is loaded before they are copied, and none has DDS entities of another."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any, cast

import pytest

from bow_sim.block_request import fingerprint_of
from bow_sim.graph.environment import PAINTER_SOCKET
from bow_sim.kernel import fingerprint
from bow_sweep.plan.sweep import Sweep
from bow_sweep.processes import start_nodes as start
from bow_sweep.processes.interrupts import Interrupts
from bow_sweep.processes.supervisor import Supervisor

SMALL = ("model=delta_cremer", "x.count=8", "y.count=8", "periods=20")


def test_what_several_processes_need_is_loaded_before_they_are_copied(monkeypatch: pytest.MonkeyPatch) -> None:
    did: list[str] = []

    class Started:
        def start(self, role: str, station: str = "") -> None:
            did.append(f"{role} {station}".strip())

        def start_painter(self) -> None:
            did.append("painter")

    monkeypatch.setattr(start, "load_ros", lambda *roles: did.extend(f"load {role}" for role in roles))
    monkeypatch.setattr(start, "load_compiled", lambda *_: did.append("load_compiled"))
    with Interrupts("") as interrupts:
        start.start_nodes(cast(Any, Started()), Sweep.from_spec("", SMALL), 3, ["a", "b"], True, interrupts)
    compiled = did.index("load_compiled")
    assert did[0] == "painter"  # it needs nothing that the others load
    assert did.index("dashboard") < compiled  # on another core meanwhile
    assert compiled < min(map(did.index, ("coordinator", "classifier a", "simulator a")))
    assert [each for each in did if "simulator " in each] == ["simulator a", "simulator b", "simulator a"]
    for role in ("recorder a", "dashboard", "coordinator", "classifier a", "simulator a"):
        assert did.index(f"load {role.split()[0]}") < did.index(role)


def test_coordinator_and_simulators_find_the_fingerprint_computed() -> None:
    fingerprint._fingerprint.cache_clear()
    start.load_compiled(Sweep.from_spec("", SMALL))
    assert fingerprint._fingerprint.cache_info().misses == 1
    again = Sweep.from_spec("", SMALL)
    assert fingerprint_of(tuple(again.settings())) == again.fingerprint
    assert fingerprint._fingerprint.cache_info().misses == 1


ALONE = f"""
import os, sys, threading
from bow_sweep.plan.sweep import Sweep
from bow_sweep.processes import start_nodes as start

start.load_ros("recorder", "dashboard", "coordinator", "classifier", "simulator")
start.load_compiled(Sweep.from_spec("", {SMALL}))

import rclpy.context
assert not rclpy.context.g_logging_ref_count, "a context of ROS was initialised"
assert threading.active_count() == 1
assert not {"lark", "rosidl_generator_py.generate_py_impl"} & sys.modules.keys(), "what makes code of messages"
opened = [os.readlink(f"/proc/self/fd/{{number}}") for number in os.listdir("/proc/self/fd")[:-1]]
assert not [each for each in opened if each.startswith(("socket:", "/dev/shm/fast"))], opened
"""


def test_what_is_loaded_makes_no_dds_entities_and_starts_no_threads_of_python() -> None:
    done = subprocess.run([sys.executable, "-c", ALONE], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr


def test_processes_are_copies_until_their_supervisor_joins_the_graph(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[str] = []

    class Copied:
        pid = 1

        def __init__(self, *_: object) -> None:
            made.append(type(self).__name__)

    class Spawned(Copied): ...

    monkeypatch.setattr("bow_sweep.processes.supervisor.Forked", Copied)
    monkeypatch.setattr("bow_sweep.processes.supervisor.Spawned", Spawned)
    monkeypatch.setattr(Supervisor, "_running_cleaner", lambda self: cast(Any, Watcher()))
    monkeypatch.delitem(sys.modules, "rclpy", raising=False)
    supervisor = Supervisor("/bow/x", tmp_path / "log", {})
    monkeypatch.setitem(sys.modules, "rclpy", cast(Any, object()))  # loaded since, as load_ros does
    supervisor.start("simulator")
    supervisor.stop_copying()
    supervisor.start("simulator")
    Supervisor("/bow/x", tmp_path / "log", {}).start("simulator")  # its process may have DDS entities already
    assert made == ["Copied", "Spawned", "Spawned"]


def test_only_the_coordinator_can_ask_the_process_that_draws(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = "drawing_stand_in"
    (tmp_path / f"{module}.py").write_text(STAND_IN)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("bow_sweep.processes.supervisor.PAINTER", module)
    monkeypatch.setattr("bow_sweep.processes.supervisor.MODULES", {"recorder": module, "coordinator": module})
    monkeypatch.delitem(sys.modules, "rclpy", raising=False)
    supervisor = Supervisor("/bow/x", tmp_path / "log", {})
    supervisor.start_painter()
    recorder, coordinator = supervisor.start("recorder"), supervisor.start("coordinator")
    assert (recorder.process.wait(20), coordinator.process.wait(20)) == (0, 7), coordinator.log.read_text()
    painter, deadline = supervisor._painter, time.monotonic() + 20
    assert painter is not None
    while painter.returncode is None:  # it does not stay as a zombie
        assert time.monotonic() < deadline
        supervisor.exited()
        time.sleep(0.01)
    assert painter.returncode == 5  # its only coordinator has ended
    assert not supervisor.stop(idle=True)


STAND_IN = f"""
import os, socket

def serve(descriptor):
    with socket.socket(fileno=descriptor) as channel:
        while asked := channel.recv(9):
            channel.send(asked)
    return 5

def main():
    descriptor = os.environ.get("{PAINTER_SOCKET}")
    if descriptor is None:
        return 0
    with socket.socket(fileno=int(descriptor)) as channel:
        channel.settimeout(20)
        return 7 if channel.send(b"a") and channel.recv(9) == b"a" else 1
"""
"""The process that draws, which answers what it is asked, and a node: status 7 if it gets an answer."""


class Watcher:
    """In place of the shared-memory cleaner."""

    def watch(self, pid: int) -> None:
        """Take note of a process."""
