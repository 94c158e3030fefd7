"""A graph of real processes, started as a user starts it, and killed as chance kills it."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import psutil
import pytest
from gated_simulator import GATE

from bow_sim.graph.discovery import SHARED_MEMORY
from bow_sim.graph.shm_files import files_of
from bow_sweep.record.verify import verify

PATIENCE_S = 120.0
"""Any of these sweeps takes seconds; so long on a machine busy with other things."""

SMALL = ["fig11d", "--nx", "16", "--ny", "8", "--set", "block_cells=8"]
"""128 cells in 16 blocks."""

TINY = ["fig11d", "--nx", "2", "--ny", "2", "--periods", "20"]
"""Four cells in one block."""


class Sweep:
    """`bow sweep` as a process, with its output in a file."""

    def __init__(self, directory: Path, *arguments: str, module: str = "bow_sweep", outer: Sequence[str] = ()) -> None:
        self.directory = directory
        self.output = directory.with_suffix(".out")
        with open(self.output, "ab") as output:
            self.process = subprocess.Popen(
                [*outer, sys.executable, "-m", module, "sweep", *arguments],
                stdout=output,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                env=os.environ,
                start_new_session=True,
            )

    @property
    def text(self) -> str:
        """What it has printed."""
        return self.output.read_text()

    def children(self, role: str = "") -> list[psutil.Process]:
        """Return the processes of its graph, or those of one role."""
        return nodes_of(self.process.pid, role)

    def shm_cleaners(self) -> list[psutil.Process]:
        """Return the process that removes what dead ones leave in shared memory: it can be killed too."""
        return _family(self.process.pid, lambda words: "shm_cleaner" in words)

    def done_blocks(self) -> int:
        """Return how many blocks the ledger says are done."""
        path = self.directory / "ledger.jsonl"
        return path.read_bytes().count(b'"event": "done"') if path.exists() else 0

    def wait_until(self, what: Callable[[], bool]) -> None:
        """Wait for something to become true while the sweep runs."""
        deadline = time.monotonic() + PATIENCE_S
        while not what():
            if (self.process.poll() is not None or time.monotonic() > deadline) and not what():
                pytest.fail(f"it never came true; the sweep says:\n{self.text}")
            time.sleep(0.02)

    def kill(self, role: str) -> None:
        """SIGKILL one process of a role in the middle of the sweep."""
        self.wait_until(lambda: bool(self.children(role)))
        self.children(role)[0].kill()

    def wait(self) -> int:
        """Wait for its end and return its exit status."""
        return self.process.wait(PATIENCE_S)

    def stop(self) -> None:
        """Leave nothing behind, whatever happened: all processes end at once, none hears that another one has."""
        family = self.children()
        if self.process.poll() is None:
            family.insert(0, psutil.Process(self.process.pid))
        kill_at_once(family)
        self.process.wait()


def kill_at_once(processes: Sequence[psutil.Process]) -> None:
    """SIGKILL processes of which none may notice that another one has ended, and wait for their end."""
    for number in (signal.SIGSTOP, signal.SIGKILL):
        for process in processes:
            with contextlib.suppress(psutil.NoSuchProcess):
                process.send_signal(number)
    until(lambda: all(map(has_ended, processes)), "killed processes do not end")


def has_ended(process: psutil.Process) -> bool:
    """Return whether a process has ended, though its parent may not have looked yet."""
    try:
        return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:  # since the first of the two questions
        return True


def nodes_of(pid: int, role: str = "") -> list[psutil.Process]:
    """Return the nodes of a graph, by the process that has started them; or those of one role."""
    return _family(pid, lambda words: "--ros-args" in words and f"__node:={role}" in words)


def _family(pid: int, says: Callable[[str], bool]) -> list[psutil.Process]:
    """Return the children of a process of which the command line says so."""
    found = []
    with contextlib.suppress(psutil.NoSuchProcess):
        for child in psutil.Process(pid).children():
            with contextlib.suppress(psutil.NoSuchProcess):
                if says(" ".join(child.cmdline())):
                    found.append(child)
    return found


def until(what: Callable[[], object], why: str) -> None:
    """Wait for something to become true; fail with `why` where it does not."""
    deadline = time.monotonic() + PATIENCE_S
    while not what():
        assert time.monotonic() < deadline, why
        time.sleep(0.02)


def bow(*arguments: str, module: str = "bow_sweep") -> subprocess.CompletedProcess[str]:
    """Run the command, or what stands for it, to its end."""
    command = [sys.executable, "-m", module, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)


def verified(directory: Path) -> dict:
    """Return what `bow verify` prints, which must be that all holds; in this process, which has the code loaded."""
    report: dict = json.loads(json.dumps(verify(directory)))
    assert report["ok"], json.dumps(report, indent=2)
    return report


def stations_of(run: Path) -> Counter[str]:
    """Return how many blocks each station has done, by the ledger."""
    return Counter(e.get("station", "") for e in entries_of(run) if e["event"] == "done")


def computed_by(run: Path) -> Counter[str]:
    """Return how many blocks each simulator has done, by the ledger."""
    entries = entries_of(run)
    hands = {(e["block"], e["attempt"]): e["simulator"] for e in entries if e["event"] == "dispatched"}
    return Counter(hands[e["block"], e["attempt"]] for e in entries if e["event"] == "done")


def entries_of(run: Path) -> list[dict[str, Any]]:
    """Return the entries of a ledger; its last line may be half written."""
    entries, ledger = [], run / "ledger.jsonl"
    for line in ledger.read_text().splitlines() if ledger.exists() else []:
        with contextlib.suppress(ValueError):
            entries.append(json.loads(line))
    return entries


def map_of(directory: Path) -> dict[str, np.ndarray]:
    """Return the arrays of map.npz but for the name of the run."""
    with np.load(directory / "map.npz") as file:
        return {name: file[name] for name in file.files if name != "run_id"}


def assert_same_map(one: Path, other: Path) -> None:
    """Two runs of one sweep give the same map, bit for bit."""
    first, second = map_of(one), map_of(other)
    assert first.keys() == second.keys()
    for name, values in first.items():
        np.testing.assert_array_equal(values, second[name], err_msg=name)


def orphans(directory: Path) -> list[str]:
    """Return the living processes that were told of a run directory."""
    found = []
    for process in psutil.process_iter(["cmdline"]):
        words = process.info["cmdline"] or []
        if "--ros-args" in words and any(str(directory) in word for word in words):
            found.append(" ".join(words))
    return found


def dead_files() -> set[str]:
    """Return what there is in shared memory, of anybody's, that no living process has."""
    files = {str(file) for file in SHARED_MEMORY.glob("fast*") if not file.name.endswith("_el")}
    living = set[str]().union(*(files_of(pid) for pid in psutil.pids()))
    return files - {file.removesuffix("_el") for file in living}


def left_behind(files: Iterable[str]) -> set[str]:
    """Return which files in shared memory are there still, without those of living processes: ports are used again."""
    there = {file for file in files if Path(file).exists() or Path(file.removesuffix("_el")).exists()}
    return there - set[str]().union(*(files_of(pid) for pid in psutil.pids() if there))


@contextlib.contextmanager
def sweeping(directory: Path, *arguments: str, module: str = "bow_sweep", outer: Sequence[str] = ()) -> Iterator[Sweep]:
    """Start a sweep into `directory`; kill what is left of it in the end.

    `module` stands for the command, and `outer` is the beginning of a command that runs another.
    """
    sweep = Sweep(directory, *arguments, module=module, outer=outer)
    try:
        yield sweep
    finally:
        sweep.stop()


@contextlib.contextmanager
def gated(gate: Path) -> Iterator[None]:
    """Give processes that are started meanwhile the environment of :mod:`gated_simulator`."""
    support = [str(Path(__file__).parent), *filter(None, [os.environ.get("PYTHONPATH")])]
    with mock.patch.dict(os.environ, {GATE: str(gate), "PYTHONPATH": os.pathsep.join(support)}):
        yield


class Halted(Sweep):
    """A sweep that is not over before the test lets it go on, however busy the machine is."""

    def __init__(self, directory: Path, *arguments: str, chunks: int) -> None:
        self._gate = directory.with_suffix(".gate")
        self.let(chunks)
        with self.gated():
            super().__init__(directory, *arguments, module="gated_simulator")

    def gated(self) -> contextlib.AbstractContextManager[None]:
        """Have the simulators of processes that are started meanwhile wait with those of the sweep."""
        return gated(self._gate)

    def let(self, chunks: int) -> None:
        """Let each simulator publish so many chunks in all."""
        self._gate.write_text(str(chunks))

    def go_on(self) -> None:
        """Let the simulators wait no more."""
        self._gate.unlink()


@contextlib.contextmanager
def halted(directory: Path, *arguments: str, chunks: int = 50) -> Iterator[Halted]:
    """Start a sweep into `directory` that waits in its middle; kill what is left of it in the end.

    Each simulator waits when it has published so many `chunks`: two and a half blocks of 100 periods.
    """
    sweep = Halted(directory, *arguments, "--out", str(directory), chunks=chunks)
    try:
        yield sweep
    finally:
        sweep.stop()


def assert_gone_on_with(run: Path, undisturbed: Path, *, shown: bool = False) -> None:
    """Resume a run that was cut off: it ends well, holds, and has the map of an undisturbed run.

    Without the dashboard, unless `shown`: it takes as long as all the rest.
    """
    with sweeping(run, "--resume", str(run), *([] if shown else ["--no-dashboard"])) as sweep:
        assert sweep.wait() == 0, sweep.text
    verified(run)
    assert_same_map(undisturbed, run)


def assert_survives_a_kill(role: str, run: Path, arguments: Sequence[str], blocks: int, undisturbed: Path) -> None:
    """Kill a process once some blocks are done: the sweep ends well by itself, with the map of an undisturbed run."""
    without = [] if role == "dashboard" else ["--no-dashboard"]  # it takes as long as all the rest
    with halted(run, *arguments, *without, chunks=20 * blocks + 10) as sweep:
        sweep.wait_until(lambda: sweep.done_blocks() >= blocks)
        sweep.kill(role)
        sweep.go_on()
        assert sweep.wait() == 0, sweep.text
        assert "killed by SIGKILL" in sweep.text
    verified(run)
    assert_same_map(undisturbed, run)


def run_sweep(directory: Path, *arguments: str) -> Path:
    """Run a sweep to its end, which must be a good one."""
    with sweeping(directory, *arguments, "--out", str(directory)) as sweep:
        assert sweep.wait() == 0, sweep.text
    return directory
