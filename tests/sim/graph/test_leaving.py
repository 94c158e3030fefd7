"""A command leaves DDS when its work is done, and ends with the status of that work although DDS does not shut down."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading

import pytest

from bow_sim.graph import leaving
from bow_sim.graph.leaving import at_end, close_all, run_command

COMMAND = """
import ctypes, sys
from bow_sim.graph import leaving

leaving.LEAVE_S = float(sys.argv[1])

def work():
    leaving.at_end(lambda: ctypes.PyDLL(None).sleep(int(sys.argv[2])))  # holds Python's interpreter lock, as DDS does
    if sys.argv[4:]:
        leaving.close_all(1, sys.argv[4])
    print("works", flush=True)
    return int(sys.argv[3])

status = leaving.run_command(work)
print("returns", flush=True)
sys.exit(status)
"""


def run(leave_s: float, hangs_s: int, status: int, *hint: str) -> tuple[int, str, str]:
    """Run a command whose DDS hangs; return its status, stdout and stderr."""
    words = [sys.executable, "-c", COMMAND, str(leave_s), str(hangs_s), str(status), *hint]
    done = subprocess.run(words, capture_output=True, text=True, timeout=100, check=False)
    return done.returncode, done.stdout, done.stderr


def test_a_command_ends_with_the_status_of_its_work_and_a_line_although_dds_does_not_shut_down() -> None:
    assert run(0.1, 600, 0) == (0, "works\n", f"bow: {leaving.HANGS}\n")
    assert run(0.1, 600, 3) == (3, "works\n", f"bow: {leaving.HANGS}\n")


def test_a_command_that_has_not_done_its_work_yet_says_how_to_go_on() -> None:
    hint = "go on with: bow sweep --resume 100%d"
    assert run(0.1, 600, 0, hint) == (1, "", f"bow: {leaving.HANGS}; {hint}\n")


def test_a_command_that_leaves_in_time_returns() -> None:
    assert run(100.0, 0, 3) == (3, "works\nreturns\n", "")


def test_timers_that_are_taken_back_end_nothing() -> None:
    code = (
        "import time; from bow_sim.graph import leaving; leaving.TO_READ_S = 0.1;"
        "leaving.exit_after(2.0, 1); leaving.exit_after(2.0, 1); leaving.cancel_exit(); time.sleep(2.5)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, b"")


def test_what_is_left_to_the_end_is_closed_in_order_after_the_work() -> None:
    done: list[str] = []

    def work() -> int:
        at_end(lambda: done.append("graph"))
        at_end(lambda: done.append("cleaner"))
        done.append("work")
        return 3

    assert run_command(work) == 3
    assert done == ["work", "graph", "cleaner"]


def test_one_that_cannot_be_closed_does_not_keep_the_others() -> None:
    done: list[str] = []

    def fail() -> None:
        raise OSError("no")

    def work() -> int:
        at_end(fail)
        at_end(lambda: done.append("cleaner"))
        return 3

    with pytest.raises(OSError, match="no"):
        run_command(work)
    assert done == ["cleaner"]


def test_without_a_command_it_is_closed_at_once() -> None:
    done: list[str] = []
    at_end(lambda: done.append("graph"))
    assert done == ["graph"]
    close_all(1)


def test_ctrl_c_after_the_work_does_not_change_its_status() -> None:
    done: list[str] = []

    def work() -> int:
        at_end(lambda: os.kill(os.getpid(), signal.SIGINT))
        at_end(lambda: done.append("all"))
        return 3

    before = signal.getsignal(signal.SIGINT)
    assert run_command(work) == 3
    assert done == ["all"]
    assert signal.getsignal(signal.SIGINT) is before


def test_outside_the_main_thread_no_timer_ends_the_process() -> None:
    thread = threading.Thread(target=leaving.exit_after, args=(0.0, 1))
    thread.start()
    thread.join()
    assert not leaving._timers
