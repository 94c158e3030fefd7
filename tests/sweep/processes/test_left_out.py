"""A dashboard that does not start, or crashes again and again, is left out; the other processes are restarted."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from bow_sweep.processes.supervisor import CRASHES, Child, Exit, Supervisor


@pytest.fixture
def supervisor(tmp_path: Path) -> Supervisor:
    return Supervisor("/bow/x", tmp_path / "log", {})


def exited(supervisor: Supervisor, status: int, worked: bool = False, role: str = "dashboard") -> Exit:
    log = supervisor.logs / f"{role}.log"
    log.write_text("Traceback:\nImportError: no such library\n")
    return Exit(Child(role, role, SimpleNamespace(pid=1), log, worked=worked), status)  # type: ignore[arg-type]


def test_a_dashboard_that_fails_before_it_works_is_left_out_at_once(supervisor: Supervisor) -> None:
    assert supervisor.why_left_out(exited(supervisor, 1)) == "exit status 1: ImportError: no such library"
    assert supervisor.left_out == [supervisor.logs / "dashboard.log"]


@pytest.mark.parametrize(("status", "worked"), [(-9, False), (-9, True), (1, True), (0, True)])
def test_one_that_is_killed_or_fails_later_is_restarted_a_few_times(
    supervisor: Supervisor, status: int, worked: bool
) -> None:
    for _ in range(CRASHES - 1):
        assert supervisor.why_left_out(exited(supervisor, status, worked)) == ""
    assert supervisor.why_left_out(exited(supervisor, status, worked)).startswith(f"ended {CRASHES} times, at last: ")


@pytest.mark.parametrize("role", ["recorder", "classifier", "simulator", "coordinator"])
def test_no_other_process_is_left_out(supervisor: Supervisor, role: str) -> None:
    for _ in range(2 * CRASHES):
        assert supervisor.why_left_out(exited(supervisor, 1, role=role)) == ""
    assert supervisor.left_out == []
