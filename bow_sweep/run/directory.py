"""A run directory: its lock, its ledger file, its report. Everything lands whole or not at all."""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xxhash

from bow_classifier.verdict.regimes import REGIMES
from bow_sim.atomic_files import replacing, sync_directory
from bow_sim.kernel.fingerprint import fingerprint
from bow_sim.physics.errors import ParameterError
from bow_sim.protocol.blocks import Blocks
from bow_sweep.maps.basin_map import Basin
from bow_sweep.plan.adaptive import fill
from bow_sweep.plan.sweep import Sweep
from bow_sweep.run import ledger_file
from bow_sweep.run.ledger import Ledger, State
from bow_sweep.run.ledger_file import LEDGER, LedgerError, latest_states, set_ledger_aside
from bow_sweep.run.lock import LockError, take

REPORT, PICTURE = "report.json", "map.png"
VERSIONS_OF = (
    "bow",
    "numpy",
    "numba",
    "llvmlite",
    "mcap",
    "rerun-sdk",
    "ros-jazzy-rclpy",
    "ros-jazzy-rmw-fastrtps-cpp",
)


class RunError(Exception):
    """A run directory cannot be used as asked; the message says which, why, and what would be right."""


def lock(directory: Path, role: str) -> int:
    """Lock a run directory for a role, see :func:`bow_sweep.run.lock.take`; return the file descriptor.

    Raises
    ------
    RunError
        Where the lock cannot be taken.
    """
    try:
        return take(directory, role)
    except LockError as error:
        raise RunError(str(error)) from None


def read_ledger(directory: Path) -> list[dict[str, Any]]:
    """Return the entries of a run's ledger; see :func:`bow_sweep.run.ledger_file.read_ledger`.

    Raises
    ------
    RunError
        Where there is no ledger, or a line before the last is damaged.
    """
    try:
        return ledger_file.read_ledger(directory)
    except LedgerError as error:
        raise RunError(str(error)) from None


def is_finished(directory: Path, entries: list[dict[str, Any]]) -> bool:
    """Return whether every block of a run is settled and its report written."""
    settled = [state for state in latest_states(entries).values() if state != "reopened"]
    return len(settled) == max(entry.get("blocks", 0) for entry in entries) and (directory / REPORT).exists()


class Run:
    """One run on disk, held by its coordinator. Make it with :meth:`create` or :meth:`resume`.

    Without `locked` nobody is kept off the directory: for file systems that have no locks.
    """

    def __init__(
        self,
        directory: Path,
        run_id: str,
        sweep: Sweep,
        blocks: Blocks,
        ledger: Ledger,
        locked: bool = True,
        first: Sequence[Mapping[str, Any]] = (),
    ) -> None:
        self.directory, self.run_id, self.sweep, self.blocks, self.ledger = directory, run_id, sweep, blocks, ledger
        self._lock = lock(directory, "coordinator") if locked else -1
        if first:  # whole or not at all: a ledger without its plan would say nothing
            at = round(time.time(), 3)
            ledger_file.write_ledger(directory, [{**entry, "at": at} for entry in first])
        self._file = open(directory / LEDGER, "ab")  # noqa: SIM115  # open as long as the run
        sync_directory(directory)
        self.quarantined: dict[int, str] = {}

    @classmethod
    def create(cls, directory: Path, run_id: str, sweep: Sweep, locked: bool = True) -> Run:
        """Begin a run in a directory that is new, or holds at most what its supervisor and recorder put there.

        Raises
        ------
        RunError
            Where the directory holds a run already or cannot be written.
        """
        try:
            directory.mkdir(parents=True, exist_ok=True)
            sync_directory(directory.parent)
            if (directory / LEDGER).exists():
                raise RunError(f"{directory}: holds a run already; resume it, or choose another directory")
            blocks = sweep.first_blocks
            first = [planned(run_id, sweep), *([round_entry(blocks)] if blocks.adaptive else [])]
            run = cls(directory, run_id, sweep, blocks, Ledger(sweep.blocks, sweep.chunks), locked, first)
        except OSError as error:
            raise RunError(f"{directory}: cannot be written: {error.strerror}") from None
        return run

    @classmethod
    def resume(cls, directory: Path, locked: bool = True) -> Run:
        """Go on with a run that was cut off, as its ledger has it.

        What the bag has is in :mod:`bow_sweep.coordinator.resume`.

        Raises
        ------
        RunError
            Where there is none, or this machine's kernel would not give the same bytes.
        """
        entries = read_ledger(directory)
        plan = entries[0]
        sweep = sweep_of(plan, directory / LEDGER)
        _cut_torn_line(directory)
        try:
            blocks = blocks_of(sweep, entries)
        except ValueError as error:
            raise RunError(f"{directory / LEDGER}: {error}") from None
        run = cls(directory, plan["run_id"], sweep, blocks, Ledger.resume(blocks.count, sweep.chunks, entries), locked)
        run.quarantined = {
            e["block"]: e.get("why", "")
            for e in entries
            if e.get("event") == "quarantined" and run.ledger.is_quarantined(e["block"])
        }
        run.record([{"event": "resumed", "epoch": run.ledger.epoch}])
        return run

    def record(self, entries: Iterable[Mapping[str, Any]]) -> None:
        """Append entries to the ledger file and see them on disk."""
        at = round(time.time(), 3)
        lines = ledger_file.lines_of({**entry, "at": at} for entry in entries)
        if lines:
            self._file.write(lines)
            self._file.flush()
            os.fsync(self._file.fileno())

    def next_round(self, basin: Basin) -> bool:
        """Plan another round of an adaptive sweep, all blocks being settled; return whether there is one."""
        more = self.sweep.more_blocks(self.blocks, np.where(self.done(), basin.transient_periods, np.nan))
        if more is not None:
            self.record([round_entry(more)])
            self.blocks = more
        return more is not None

    def done(self) -> np.ndarray:
        """Return which cells are in blocks that are done, (ny * nx,)."""
        return self.blocks.cells_of(n for n, block in enumerate(self.ledger.blocks) if block.state is State.DONE)

    def transient_periods(self, basin: Basin) -> np.ndarray:
        """Return the map as it is left, (ny, nx): NaN where not done, predicted where an adaptive sweep does not go."""
        shape = (basin.ny, basin.nx)
        length = np.where(self.done(), basin.transient_periods, np.float32(np.nan)).reshape(shape)
        return np.where(self.blocks.planned.reshape(shape), length, fill(length)) if self.blocks.adaptive else length

    def cells_in(self, state: State) -> int:
        """Return how many cells are in blocks of a state."""
        return sum(self.blocks.size(n) for n, block in enumerate(self.ledger.blocks) if block.state is state)

    def accounts(self) -> dict[str, int]:
        """Return cells planned so far, done, quarantined and outstanding; the last three add up to the first."""
        done, quarantined = self.cells_in(State.DONE), self.cells_in(State.QUARANTINED)
        planned = self.blocks.planned_cells
        return {
            "planned": planned,
            "done": done,
            "quarantined": quarantined,
            "outstanding": planned - done - quarantined,
        }

    def report(self, basin: Basin, wall_seconds: float, extra: Mapping[str, Any]) -> dict[str, Any]:
        """Write report.json and return what it says."""
        report = {
            "run_id": self.run_id,
            "sweep_id": self.sweep.sweep_id,
            "preset": self.sweep.preset,
            "settings": list(self.sweep.settings()),
            "fingerprint": fingerprint(),
            "classifier": self.sweep.thresholds.hash,
            "cells": self.accounts(),
            "cells_predicted": self.sweep.cells - self.blocks.planned_cells,
            "rounds": len(self.blocks.rounds),
            "samples": self.cells_in(State.DONE) * self.sweep.parameters.samples,
            "quarantined_blocks": {str(block): why for block, why in self.quarantined.items()},
            "attempts": sum(block.attempt for block in self.ledger.blocks),
            "epoch": self.ledger.epoch,
            **findings(self.transient_periods(basin), basin.latest("regime")[self.done()]),
            "wall_seconds": wall_seconds,
            "cells_per_second": self.accounts()["done"] / wall_seconds if wall_seconds > 0 else None,
            "versions": _versions(),
            "machine": f"{platform.machine()}, {os.cpu_count()} cores, {platform.system()} {platform.release()}",
            "picture": digest(self.directory / PICTURE),
            **extra,
        }
        with replacing(self.directory / REPORT) as file:
            file.write(json.dumps(report, indent=2).encode() + b"\n")
        return report

    def close(self) -> None:
        """Give up the lock and the ledger file."""
        self._file.close()
        if self._lock >= 0:
            os.close(self._lock)


def digest(path: Path) -> str | None:
    """Return the XXH3-64 of a file, 16 hexadecimal digits; None where there is none."""
    return xxhash.xxh3_64_hexdigest(path.read_bytes()) if path.is_file() else None


def findings(transient_periods: np.ndarray, regimes: np.ndarray) -> dict[str, Any]:
    """Return what a report says of a map.

    Parameters
    ----------
    transient_periods
        (ny, nx) as the map is left: NaN where not done, predicted where an adaptive sweep does not go.
    regimes
        (cells that are done,) codes at the last test.
    """
    length = np.nan_to_num(transient_periods)
    counts = np.bincount(regimes, minlength=len(REGIMES))[: len(REGIMES)]
    return {
        "helmholtz_fraction": float(np.mean(length > 0)),
        "median_transient_periods": float(np.median(length[length > 0])) if length.any() else None,
        "regimes": {name: int(count) for name, count in zip(REGIMES, counts, strict=True)},
    }


def planned(run_id: str, sweep: Sweep, epoch: int = 1) -> dict[str, Any]:
    """Return the ledger entry that a run begins with."""
    return {
        "event": "planned",
        "run_id": run_id,
        "sweep_id": sweep.sweep_id,
        "preset": sweep.preset,
        "settings": sweep.settings(),
        "fingerprint": fingerprint(),
        "blocks": sweep.blocks,
        "chunks": sweep.chunks,
        "cells": sweep.cells,
        "epoch": epoch,
    }


def sweep_of(plan: Mapping[str, Any], where: Path) -> Sweep:
    """Return the sweep that the first entry of a ledger describes.

    Raises
    ------
    RunError
        Where it describes none, or this machine's kernel would not give the same bytes.
    """
    try:
        sweep = replace(Sweep.from_spec("", plan["settings"]), preset=str(plan["preset"]))
    except (ParameterError, KeyError, TypeError) as error:
        raise RunError(f"{where}, line 1: {error}") from None
    if (sweep.blocks, sweep.chunks) != (plan["blocks"], plan["chunks"]):
        given, right = f"{plan['blocks']} blocks of {plan['chunks']} chunks", f"{sweep.blocks} of {sweep.chunks}"
        raise RunError(f"{where}, line 1: {given}; its settings make {right}")
    if sweep.sweep_id != plan.get("sweep_id") or fingerprint() != plan.get("fingerprint"):
        raise RunError(
            f"{where.parent}: was computed by kernel {plan.get('fingerprint')}, here is {fingerprint()}; "
            "their results could differ: resume where it began, or sweep anew"
        )
    return sweep


def round_entry(blocks: Blocks) -> dict[str, Any]:
    """Return the ledger entry of the latest round."""
    cells = blocks.rounds[-1].tolist()
    return {"event": "round", "round": len(blocks.rounds), "cells": cells, "blocks": blocks.count}


def blocks_of(sweep: Sweep, entries: Iterable[Mapping[str, Any]]) -> Blocks:
    """Return the blocks of a recorded run; one cut off before its first round was recorded begins with it.

    Raises
    ------
    ValueError
        Where its rounds are none of this sweep.
    """
    rounds = [np.array(entry["cells"], np.int64) for entry in entries if entry.get("event") == "round"]
    if not rounds:
        return sweep.first_blocks
    blocks = Blocks(sweep.cells, sweep.block_cells, [])
    for cells in rounds:
        blocks = blocks.grown(cells)
    return blocks


def _cut_torn_line(directory: Path) -> None:
    """Drop what a crash left after the last newline, so that the next entry begins a line."""
    path = directory / LEDGER
    content = path.read_bytes()
    whole = content.rfind(b"\n") + 1
    if whole != len(content):
        set_ledger_aside(directory)
        os.truncate(path, whole)


def _versions() -> dict[str, str]:
    versions = {"python": platform.python_version()}
    for name in VERSIONS_OF:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return versions
