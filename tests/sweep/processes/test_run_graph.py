"""How a graph is started, how a supervisor interprets exits, and how many simulators it starts."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from bow_sim.block_request import fingerprint_of
from bow_sim.kernel import fingerprint
from bow_sweep.cli.sweep import bounded
from bow_sweep.plan.sweep import Sweep
from bow_sweep.processes import run_graph as graph
from bow_sweep.processes.fork import UNKNOWN, Process
from bow_sweep.processes.progress import Display
from bow_sweep.processes.run_graph import has_finished, load_compiled, run_graph
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


SMALL = ("model=delta_cremer", "x.count=8", "y.count=8", "periods=20")


def test_what_several_processes_need_is_loaded_before_they_are_copied(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    did: list[str] = []

    class Started:
        left_out: list[Path] = []

        def __init__(self, *_: object) -> None: ...

        def start(self, role: str, station: str = "") -> None:
            did.append(role)

        def stop(self, idle: bool) -> list[Any]:
            assert idle
            return []

    monkeypatch.setattr(graph, "Supervisor", Started)
    for name in ("load_measures", "load_compiled"):
        monkeypatch.setattr(graph, name, lambda *_, name=name: did.append(name))
    watcher = SimpleNamespace(watch=lambda *_: did.append("watch"))
    monkeypatch.setitem(sys.modules, "bow_sweep.processes.supervisor_node", watcher)
    sweep = Sweep.from_spec("", SMALL)
    run_graph(tmp_path, "0" * 16, sweep, resume=False, simulators=2, dashboard=True, display=Display())
    measured, compiled = did.index("load_measures"), did.index("load_compiled")
    assert measured < did.index("dashboard") < compiled  # on another core meanwhile
    assert compiled < min(map(did.index, ("coordinator", "classifier", "simulator")))
    assert did.count("simulator") == 2
    assert did[-1] == "watch"


def test_coordinator_and_simulators_find_the_fingerprint_computed() -> None:
    fingerprint._fingerprint.cache_clear()
    load_compiled(Sweep.from_spec("", SMALL))
    assert fingerprint._fingerprint.cache_info().misses == 1
    again = Sweep.from_spec("", SMALL)
    assert fingerprint_of(tuple(again.settings())) == again.fingerprint
    assert fingerprint._fingerprint.cache_info().misses == 1
