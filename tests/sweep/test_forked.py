"""A child that is a copy of this process behaves as one that was started."""

import os
import signal
import subprocess
import sys
import time

import pytest

from bow_sweep.forked import Forked


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
    """A lock that a process holds on a run must not live on in its children."""
    with open(tmp_path / "lock", "w") as held:
        number = held.fileno()

        def run():
            try:
                os.fstat(number)
            except OSError:
                return 0
            return 1

        assert Forked(run, tmp_path / "log").wait(10) == 0


def test_handlers_of_its_parent_are_not_its_own(tmp_path):
    before = signal.signal(signal.SIGTERM, lambda *_: None)
    try:
        child = Forked(lambda: time.sleep(60) or 0, tmp_path / "log")
        time.sleep(0.1)
        child.send_signal(signal.SIGTERM)
        assert child.wait(10) == -signal.SIGTERM
    finally:
        signal.signal(signal.SIGTERM, before)
