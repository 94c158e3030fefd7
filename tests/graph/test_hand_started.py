"""Nodes without a supervisor, killed: what they had in shared memory goes when the next node starts."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from graph import TINY, run_sweep, sweeping, until

from bow_sim.graph import shm_notes
from bow_sim.graph.discovery import SHARED_MEMORY
from bow_sim.graph.shm_files import files_of, is_lock, is_port, noted

pytestmark = pytest.mark.usefixtures("ros_domain")

FIRST_PORT, PORTS = 7411, 250
"""The first port of a node in domain 0, and how many a domain has (DDSI-RTPS, section 9.6)."""

LENT_BYTES = 16 << 20
"""A simulator's messages take more."""


def size(file: Path) -> int:
    with contextlib.suppress(FileNotFoundError):
        return file.stat().st_size
    return 0


class ByHand:
    """A simulator that somebody started in a terminal."""

    def __init__(self, name: str) -> None:
        words = [sys.executable, "-m", "bow_sweep", "simulator", "--ros-args", "-r", f"__node:={name}"]
        self.process = subprocess.Popen(words)
        self.note = SHARED_MEMORY / shm_notes._name(self.process.pid)
        until(self.note.exists, "it writes a note")
        until(lambda: noted(self.note) >= files_of(self.process.pid), "the note names all that it has")

    @property
    def files(self) -> set[Path]:
        """What it has, but for ports, which others of its number take over."""
        named = noted(self.note)
        segments = {file.removesuffix("_el") for file in named if is_lock(file) and not is_port(file)}
        return {Path(file) for file in named | segments if not is_port(file)}


@pytest.fixture
def simulators() -> Iterator[list[ByHand]]:
    running: list[ByHand] = []
    yield running
    for one in running:
        one.process.kill()
        one.process.wait()
    shm_notes.remove_leftovers()


def test_what_a_killed_node_had_goes_when_the_next_one_starts(simulators: list[ByHand]) -> None:
    simulators += [ByHand("first"), ByHand("second")]
    killed, living = simulators
    had, has = killed.files, living.files
    assert sum(map(size, had)) > LENT_BYTES
    killed.process.kill()
    killed.process.wait()
    assert any(map(Path.exists, had)), "nobody sees to it before"
    simulators.append(ByHand("third"))
    assert [file for file in (*had, killed.note) if file.exists()] == []
    assert all(file.exists() for file in (*has, living.note))
    assert sum(map(size, has)) > LENT_BYTES


def test_a_port_that_was_left_half_made_holds_nobody_up(simulators: list[ByHand], ros_domain: int) -> None:
    port = SHARED_MEMORY / f"fastrtps_port{FIRST_PORT + PORTS * ros_domain}"
    port.touch()
    os.utime(port, (0, 0))
    simulators.append(ByHand("first"))
    assert port.stat().st_size > 0


def test_a_sweep_removes_it_too(simulators: list[ByHand], tmp_path: Path) -> None:
    simulators.append(ByHand("first"))
    (killed,) = simulators
    had = killed.files
    killed.process.kill()
    killed.process.wait()
    run_sweep(tmp_path / "run", *TINY, "--no-dashboard")
    assert [file for file in (*had, killed.note) if file.exists()] == []


@pytest.mark.parametrize("told", ["SIGINT", "SIGTERM"])
def test_a_node_that_ends_in_order_leaves_no_note(simulators: list[ByHand], told: str) -> None:
    simulators.append(ByHand("first"))
    (only,) = simulators
    only.process.send_signal(signal.Signals[told])
    assert only.process.wait(30) == 0
    assert not only.note.exists()


def test_nodes_of_a_sweep_have_their_supervisor(tmp_path: Path) -> None:
    run = tmp_path / "run"
    with sweeping(run, *TINY, "--no-dashboard", "--out", str(run)) as sweep:
        sweep.wait_until((run / "map.npz").exists)
        for child in sweep.children():
            assert not (SHARED_MEMORY / shm_notes._name(child.pid)).exists()
        assert sweep.wait() == 0, sweep.text
