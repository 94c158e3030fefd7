"""Pictures and the dashboard never stop a sweep: where they fail, that is reported, and the sweep finishes."""

from __future__ import annotations

import contextlib
import os
import shlex
import signal
import socket
import threading
import time
from pathlib import Path

import psutil
import pytest
from graph import SMALL, TINY, Sweep, bow, halted, sweeping, verified

from bow_sweep.view.viewer import PROGRAM, _program

pytestmark = pytest.mark.usefixtures("ros_domain")


def shadowed(folder: Path, library: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the import of a library fail in all processes of the test."""
    (folder / library).mkdir(parents=True)
    (folder / library / "__init__.py").write_text(f'raise ImportError("{library} is broken here")')
    monkeypatch.setenv("PYTHONPATH", str(folder), prepend=os.pathsep)


def listed(text: str) -> set[str]:
    """Return the files that a summary lists."""
    names = ("map.png", "map.npz", "dashboard.rrd", "bag/", "report.json")
    return {name for name in names for line in text.splitlines() if line.startswith(f"  {name} ")}


def test_arguments_are_checked_before_a_directory_is_made(tmp_path: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        taken = str(other.getsockname()[1])
        for arguments, message in {
            ("--port", "99999"): "--port 99999: should be a whole number from 1 to 65535",
            ("--port", "mine"): "--port mine: should be a whole number",
            ("--port", taken): f"--port {taken}: cannot be used on 127.0.0.1",
            ("--port", taken, "--view"): f"--port {taken}: cannot be used on 127.0.0.1",
            ("--view", "--no-dashboard"): "--view needs the dashboard that --no-dashboard leaves out",
            ("--port", "9876", "--no-dashboard"): "--port 9876 needs the dashboard",
            ("--simulators", "0"): "--simulators 0: should be at least 1",
        }.items():
            result = bow("sweep", *TINY, *arguments, "--out", str(tmp_path / "run"))
            assert result.returncode == 2, arguments
            assert message in result.stderr
            assert len(result.stderr.strip().splitlines()) == 1
            assert not (tmp_path / "run").exists()


def test_a_summary_lists_what_is_there(tmp_path: Path) -> None:
    run = tmp_path / "run"
    with sweeping(run, *TINY, "--no-dashboard", "--out", str(run)) as sweep:
        assert sweep.wait() == 0, sweep.text
    assert listed(sweep.text) == {"map.png", "map.npz", "bag/", "report.json"}
    assert "without dashboard" not in sweep.text


def test_a_dashboard_that_cannot_be_imported_is_named_once_and_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shadowed(tmp_path / "shadow", "rerun", monkeypatch)
    run = tmp_path / "run"
    with sweeping(run, *TINY, "--out", str(run)) as sweep:
        assert sweep.wait() == 0, sweep.text
    assert sweep.text.count("rerun is broken here") == 1
    assert sweep.text.count(f"; see {run / 'log' / 'dashboard.log'}") == 1
    assert listed(sweep.text) == {"map.png", "map.npz", "bag/", "report.json"}
    monkeypatch.undo()
    verified(run)


def test_without_matplotlib_there_is_all_but_the_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shadowed(tmp_path / "shadow", "matplotlib", monkeypatch)
    run = tmp_path / "run"
    with sweeping(run, *TINY, "--out", str(run)) as sweep:
        assert sweep.wait() == 0, sweep.text
    assert f"not drawn: {run / 'map.png'}: matplotlib is broken here" in sweep.text
    assert {"map.npz", "bag/", "report.json"} <= listed(sweep.text)
    assert "map.png" not in listed(sweep.text)
    assert not (run / "map.png").exists()
    monkeypatch.undo()
    verified(run)


def test_a_port_that_is_taken_after_the_start_costs_the_live_view_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, taken, program = tmp_path / "run", tmp_path / "taken", tmp_path / "rerun"
    rerun = shlex.join(_program())
    program.write_text(f'#!/bin/sh\nwhile ! [ -e {taken} ]; do sleep 0.01; done\nexec {rerun} "$@"\n')
    program.chmod(0o755)
    monkeypatch.setenv(PROGRAM, str(program))  # rerun itself, but only when the port is taken
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        other.close()
        with sweeping(run, *SMALL, "--port", str(port), "--out", str(run)) as sweep, socket.socket() as late:
            sweep.wait_until(run.exists)
            late.bind(("127.0.0.1", port))
            late.listen()
            taken.touch()
            assert sweep.wait() == 0, sweep.text
    assert "the server for viewers ended (exit status 1): Address already in use" in sweep.text
    assert "dashboard.rrd" in listed(sweep.text)


@pytest.mark.full
def test_a_dashboard_that_is_killed_again_and_again_is_left_out(tmp_path: Path) -> None:
    run = tmp_path / "run"

    def kill_it(sweep: Sweep) -> None:
        while sweep.process.poll() is None:
            for child in sweep.children("dashboard"):
                with contextlib.suppress(psutil.NoSuchProcess):
                    child.kill()
            time.sleep(0.1)

    with sweeping(run, *SMALL, "--periods", "2000", "--out", str(run)) as sweep:
        killer = threading.Thread(target=kill_it, args=(sweep,))
        killer.start()
        status = sweep.wait()
        killer.join()
    assert status == 0, sweep.text
    assert sweep.text.count("the sweep goes on without dashboard (ended 5 times") == 1
    assert sweep.text.count("without dashboard to its end") == 1
    verified(run)


@pytest.mark.full
def test_a_dashboard_whose_disk_is_full_is_named_once_and_does_not_delay_the_end(tmp_path: Path) -> None:
    run = tmp_path / "run"
    with halted(run, *SMALL) as sweep:
        sweep.wait_until((run / "dashboard.rrd").exists)  # so it is connected: files in shared memory have a limit too
        (dashboard,) = sweep.children("dashboard")
        dashboard.rlimit(psutil.RLIMIT_FSIZE, (20_000, 20_000))
        sweep.go_on()
        sweep.wait_until((run / "report.json").exists)
        began = time.monotonic()
        assert sweep.wait() == 0, sweep.text
    assert time.monotonic() - began < 14
    assert len([line for line in sweep.text.splitlines() if "/dashboard: " in line]) == 1
    assert f"{run / 'dashboard.rrd'}: " in sweep.text
    assert "had to kill" not in sweep.text
    verified(run)


@pytest.mark.full
def test_a_dashboard_that_hangs_delays_the_end_by_a_limit_that_is_printed(tmp_path: Path) -> None:
    run = tmp_path / "run"
    with halted(run, *SMALL) as sweep:
        sweep.wait_until((run / "dashboard.rrd").exists)
        (dashboard,) = sweep.children("dashboard")
        dashboard.send_signal(signal.SIGSTOP)
        sweep.go_on()
        sweep.wait_until((run / "map.npz").exists)
        began = time.monotonic()
        assert sweep.wait() == 0, sweep.text
    assert time.monotonic() - began < 60
    assert "waiting for the dashboard to draw its last picture, 20 s at most" in sweep.text
    assert not psutil.pid_exists(dashboard.pid)
    verified(run)


@pytest.mark.full
def test_a_campaign_reports_a_dashboard_that_cannot_run_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shadowed(tmp_path / "shadow", "rerun", monkeypatch)
    run = tmp_path / "run"
    with sweeping(run, "fig11", "--nx", "32", "--ny", "16", "--periods", "50", "--out", str(run)) as sweep:
        assert sweep.wait() == 0, sweep.text
    assert sweep.text.count("the sweep goes on without dashboard") == 1
    assert sweep.text.count("without dashboard to its end") == 1
