"""How a supervisor interprets exits, and how many simulators it starts."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from bow_sweep.cli.sweep import bounded
from bow_sweep.processes.fork import UNKNOWN, Process
from bow_sweep.processes.run_graph import has_finished
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
