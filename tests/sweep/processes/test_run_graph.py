"""How a supervisor interprets exits of its processes, and how many simulators it starts."""

from __future__ import annotations

import json
import os
import sys
import threading
from pathlib import Path

import pytest

from bow_sim.block_request import fingerprint_of
from bow_sim.kernel import fingerprint
from bow_sweep.cli.sweep import bounded
from bow_sweep.plan.sweep import Sweep
from bow_sweep.processes import supervisor as supervisor_module
from bow_sweep.processes.fork import UNKNOWN, Process
from bow_sweep.processes.run_graph import has_finished, load_compiled
from bow_sweep.processes.supervisor import ROS_LOGS, Child, Exit, Supervisor
from bow_sweep.run.directory import LEDGER, REPORT

PLAN = {
    "event": "planned",
    "run_id": "0" * 16,
    "sweep_id": "0" * 16,
    "preset": "",
    "settings": [],
    "fingerprint": "",
    "blocks": 1,
    "chunks": 1,
    "cells": 1,
    "epoch": 1,
}
DONE = {"event": "done", "block": 0}
RESUMED = {"event": "resumed", "epoch": 2}


@pytest.mark.parametrize(
    ("entries", "report", "finished"),
    [
        ([PLAN, DONE], {"epoch": 1}, True),
        ([PLAN, DONE], None, False),
        ([PLAN], {"epoch": 1}, False),
        ([PLAN, DONE, RESUMED], {"epoch": 1}, False),
        ([PLAN, DONE, RESUMED], {"epoch": 2}, True),
        ([], {"epoch": 1}, False),
    ],
)
def test_a_coordinator_whose_status_is_unknown_is_judged_by_its_files(
    tmp_path: Path, entries: list[dict[str, object]], report: dict[str, int] | None, finished: bool
) -> None:
    (tmp_path / LEDGER).write_text("".join(json.dumps(entry) + "\n" for entry in entries))
    if report is not None:
        (tmp_path / REPORT).write_text(json.dumps(report))
    assert has_finished(tmp_path) is finished


def ended(role: str, log: Path) -> Child:
    process = Process(0)
    process.returncode = UNKNOWN
    return Child(role, role, process, log)


@pytest.mark.parametrize("finished", [True, False])
def test_an_unknown_status_is_a_success_only_of_a_coordinator_that_had_finished(tmp_path: Path, finished: bool) -> None:
    supervisor = Supervisor("/bow/x", tmp_path / "log", {}, lambda: finished)
    supervisor.children = [ended("coordinator", tmp_path), ended("recorder", tmp_path)]
    coordinator, recorder = supervisor.exited()
    assert coordinator.status == (0 if finished else UNKNOWN)
    assert recorder.status == UNKNOWN
    assert "exit status unknown" in Exit(ended("recorder", tmp_path), UNKNOWN).cause
    supervisor.stop(idle=True)


def test_the_nodes_of_a_supervisor_log_where_those_of_its_children_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for before in (None, "/somewhere"):
        if before:
            monkeypatch.setenv(ROS_LOGS, before)
        else:
            monkeypatch.delenv(ROS_LOGS, raising=False)
        supervisor = Supervisor("/bow/x", tmp_path / "log", {})
        assert os.environ[ROS_LOGS] == str(tmp_path / "log")
        supervisor.stop(idle=True)
        assert os.environ.get(ROS_LOGS) == before


@pytest.mark.parametrize(("asked", "cores", "started"), [(2, 2, 2), (64, 2, 16), (64, 64, 64), (128, 128, 64)])
def test_the_number_of_simulators_is_limited(asked: int, cores: int, started: int) -> None:
    assert bounded(asked, cores) == started


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """How processes were started, none of them really."""
    how: list[str] = []

    def made(kind: str) -> object:
        def make(*_: object) -> Process:
            how.append(kind)
            process = Process(os.getpid())
            process.returncode = 0
            return process

        return make

    class Cleaner:
        has_exited = False

        def __init__(self, *_: object) -> None: ...

        def watch(self, pid: int) -> None: ...

        def close(self, _: float) -> None: ...

    for name, value in (("Forked", made("fork")), ("Spawned", made("command")), ("ShmCleaner", Cleaner)):
        monkeypatch.setattr(supervisor_module, name, value)
    monkeypatch.setattr(threading, "active_count", lambda: 1)
    return how


def test_nodes_are_copies_that_have_ros_loaded_until_the_supervisor_uses_it(
    tmp_path: Path, started: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "rclpy", raising=False)
    supervisor = Supervisor("/bow/x", tmp_path / "log", {})
    supervisor.start("recorder")
    supervisor.load("json")
    monkeypatch.setitem(sys.modules, "rclpy", os)  # as if a module had imported it
    supervisor.load("json")
    supervisor.start("coordinator")
    supervisor.stop_forking()
    supervisor.start("simulator")
    supervisor.stop(idle=True)
    assert started == ["fork", "fork", "command"]


def test_where_others_may_have_used_ros_no_node_is_a_copy(
    tmp_path: Path, started: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rclpy", os)
    supervisor = Supervisor("/bow/x", tmp_path / "log", {})
    supervisor.load("no.such.module")
    supervisor.start("recorder")
    supervisor.stop(idle=True)
    assert started == ["command"]


def test_coordinator_and_simulators_find_the_fingerprint_computed() -> None:
    settings = ("model=delta_cremer", "x.count=8", "y.count=8", "periods=20")
    fingerprint._fingerprint.cache_clear()
    load_compiled(Sweep.from_spec("", settings))
    assert fingerprint._fingerprint.cache_info().misses == 1
    again = Sweep.from_spec("", settings)
    assert fingerprint_of(tuple(again.settings())) == again.fingerprint
    assert fingerprint._fingerprint.cache_info().misses == 1
