"""Child processes: exit status, signals, output, whether they are forks or commands."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bow_sweep.processes.fork import UNKNOWN, Forked, Spawned


def test_what_it_returns_is_its_exit_status_and_what_it_prints_is_in_its_file(tmp_path):
    log = tmp_path / "log"

    def run():
        print("on stdout")
        print("on stderr", file=sys.stderr)
        return 7

    child = Forked(run, log)
    assert child.wait(10) == 7
    assert child.poll() == 7
    assert log.read_text() == "on stdout\non stderr\n"


def test_an_error_shows_in_the_file_and_as_status(tmp_path):
    child = Forked(lambda: 1 // 0, tmp_path / "log")
    assert child.wait(10) == 1
    assert "ZeroDivisionError" in (tmp_path / "log").read_text()


def test_a_signal_that_ends_it_is_its_negative_status(tmp_path):
    child = Forked(lambda: time.sleep(60) or 0, tmp_path / "log")
    assert child.poll() is None
    with pytest.raises(subprocess.TimeoutExpired):
        child.wait(0.05)
    child.kill()
    assert child.wait() == -signal.SIGKILL


def test_it_has_no_open_file_of_its_parent(tmp_path):
    """Otherwise a child would keep the lock that its parent holds on a run."""
    with open(tmp_path / "lock", "w") as held:
        number = held.fileno()

        def run():
            return int(Path(f"/proc/self/fd/{number}").readlink() != Path(os.devnull))

        assert Forked(run, tmp_path / "log").wait(10) == 0


def test_a_file_of_its_parent_that_goes_closes_none_of_its_own(tmp_path):
    holder = [open(tmp_path / "file", "w")]  # noqa: SIM115  # it goes in the child
    number = holder[0].fileno()

    def run():
        own = [open(tmp_path / "log") for _ in range(number)]  # noqa: SIM115  # one could have the number of that file
        holder.clear()
        for each in own:
            each.close()
        return 0

    child = Forked(run, tmp_path / "log")
    assert child.wait(10) == 0, (tmp_path / "log").read_text()
    holder[0].close()


def test_handlers_of_its_parent_are_not_its_own(tmp_path):
    before = signal.signal(signal.SIGTERM, lambda *_: None)
    try:
        child = Forked(lambda: time.sleep(60) or 0, tmp_path / "log")
        child.send_signal(signal.SIGTERM)  # at once: it may not have begun
        assert child.wait(10) == -signal.SIGTERM
    finally:
        signal.signal(signal.SIGTERM, before)


def test_an_exit_status_that_others_took_is_unknown(tmp_path):
    child = Forked(lambda: 3, tmp_path / "log")
    os.waitpid(child.pid, 0)
    assert child.poll() == UNKNOWN
    assert child.wait(1) == UNKNOWN
    child.kill()


def test_a_command_whose_status_was_taken_is_no_success(tmp_path):
    child = Spawned([sys.executable, "-c", "print('here')"], tmp_path / "log", dict(os.environ), lambda: None)
    os.waitpid(child.pid, 0)
    assert child.wait(1) == UNKNOWN
    assert (tmp_path / "log").read_text() == "here\n"


def test_where_sigchld_is_ignored_the_exit_is_noticed_and_its_status_unknown(tmp_path):
    before = signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    waits, end = os.pipe()
    try:
        child = Forked(lambda: len(os.read(waits, 1)), tmp_path / "log", keep=waits)
        assert child.poll() is None
        os.close(end)
        assert child.wait(10) == UNKNOWN
    finally:
        os.close(waits)
        signal.signal(signal.SIGCHLD, before)


def test_a_command_gets_status_signal_and_environment(tmp_path):
    code = "import os, sys, time; print(os.environ['MINE'], flush=True); sys.stdin.read(); time.sleep(60)"
    child = Spawned([sys.executable, "-c", code], tmp_path / "log", {**os.environ, "MINE": "x"}, lambda: None)
    while not (tmp_path / "log").read_text():
        assert child.poll() is None
    child.send_signal(signal.SIGTERM)
    assert child.wait(10) == -signal.SIGTERM


def test_output_that_is_full_or_closed_does_not_matter(tmp_path, monkeypatch):
    with open("/dev/full", "w") as full:
        monkeypatch.setattr(sys, "stdout", full)
        monkeypatch.setattr(sys, "stderr", None)
        print("x")
        assert Forked(lambda: 5, tmp_path / "log").wait(10) == 5
        monkeypatch.undo()
        with contextlib.suppress(OSError):
            full.close()
