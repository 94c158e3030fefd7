"""A node in a process of its own ends when it gets a signal, or several, and even where DDS does not shut down."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

from graph import PATIENCE_S, orphans

from bow_sim.graph import leaving
from bow_sim.graph.discovery import SHARED_MEMORY
from bow_sim.graph.shm_notes import remove_leftovers
from bow_sweep.record.verify import verify

NODE = """
import ctypes, os, signal, sys
from bow_sim.graph import node_base, node_process

class Node(node_base.BowNode):
    def __init__(self):
        super().__init__("nobody")
        self.create_timer(0.1, lambda: print("lives", flush=True))

    def destroy_node(self):
        ctypes.PyDLL(None).sleep(int(sys.argv[1]))  # holds Python's interpreter lock, as DDS does
        super().destroy_node()

"""

SHORT = "node_process.LEAVE_S = 1.0\n"
"""Seconds that DDS has to shut down."""

SIGNAL_AGAIN = """
def signal_again(frame, event, argument):
    if event == "call" and frame.f_code.co_name == "notify_all":
        os.kill(os.getpid(), signal.SIGTERM)

sys.setprofile(signal_again)
"""
"""A signal handler sets a threading.Event; a second signal comes while the event is locked."""

LIVE = 'sys.exit(node_process.run_node(Node, ["nobody"]))'


def start(*parts: str, hangs_s: int = 0) -> subprocess.Popen[bytes]:
    """Start a node whose shutdown of DDS takes so long; return when its timer runs."""
    process = subprocess.Popen([sys.executable, "-c", "".join(parts), str(hangs_s)], stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"lives\n"
    return process


def test_a_node_ends_that_gets_a_signal_while_it_handles_one(ros_domain: int) -> None:
    with start(NODE, SIGNAL_AGAIN, LIVE) as process:
        process.send_signal(signal.SIGINT)
        try:
            assert process.wait(20) == 0
        finally:
            process.kill()


def test_a_node_ends_with_its_own_status_although_dds_does_not_shut_down(ros_domain: int) -> None:
    with start(NODE, SHORT, LIVE, hangs_s=120) as process:
        process.send_signal(signal.SIGTERM)
        assert process.wait(60) == 0


SWEEP = """
import ctypes, sys
from bow_sim.graph import leaving
from bow_sweep.cli import main
from bow_sweep.processes import supervisor_node

leaving.LEAVE_S = 1.0
supervisor_node.SupervisorNode.destroy_node = lambda self: ctypes.PyDLL(None).sleep(600)
sys.exit(main(["sweep", "fig11d", "--nx", "4", "--ny", "2", "--periods", "20", "--out", sys.argv[1]]))
"""


def test_a_sweep_ends_as_always_although_dds_does_not_shut_down(ros_domain: int, tmp_path: Path) -> None:
    run = tmp_path / "run"
    command = [sys.executable, "-c", SWEEP, str(run)]
    with subprocess.Popen(command, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        out, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, errors
    assert out.splitlines()[-1] == f"check it: bow verify {run}"
    assert errors.splitlines()[-1].endswith(leaving.HANGS)
    deadline = time.monotonic() + 30
    while left := orphans(run):
        assert time.monotonic() < deadline, left
        time.sleep(0.1)
    assert verify(run)["ok"]
    remove_leftovers()  # as the next command or node does
    assert not list(SHARED_MEMORY.glob(f"bow_*_{process.pid}_*"))
