"""A run directory: its lock, its ledger file, its report. Everything lands whole or not at all."""

from __future__ import annotations

import fcntl
import importlib.metadata
import json
import os
import platform
import re
import shutil
import time
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bow_classifier.regimes import REGIMES
from bow_sim.blocks import Blocks
from bow_sim.files import replacing
from bow_sim.identity import fingerprint
from bow_sim.model import ParameterError

from .adaptive import fill
from .basin import Basin
from .ledger import Ledger, State
from .plan import Sweep

_IDENTIFIER = re.compile("[0-9a-f]{16}")

LEDGER = "ledger.jsonl"
REPORT = "report.json"
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
    """Hold the lock of a role on a run directory until this process ends; return its file descriptor.

    Raises
    ------
    RunError
        Where another process holds it.
    """
    path = directory / f".{role}.lock"
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise RunError(f"{directory}: another {role} is at work on this run ({path.name} is locked)") from None
    return descriptor


def read_ledger(directory: Path) -> list[dict[str, Any]]:
    """Return the entries of a run's ledger; a last line cut off by a crash is no entry.

    Raises
    ------
    RunError
        Where there is no ledger, or a line before the last is damaged.
    """
    path = directory / LEDGER
    try:
        lines = path.read_bytes().split(b"\n")
    except OSError as error:
        raise RunError(f"{path}: {error.strerror}; a run directory of `bow sweep` holds one") from None
    entries = []
    for number, line in enumerate(lines[:-1], 1):  # what follows the last newline was being written
        try:
            entry = json.loads(line)
            _check_entry(entry)
        except (ValueError, RecursionError) as error:
            raise RunError(f"{path}, line {number}: not a ledger entry: {error}") from None
        entries.append(entry)
    if not entries or entries[0].get("event") != "planned":
        raise RunError(f"{path}: does not begin with the plan of a run")
    return entries


_NEEDS = {
    "planned": ("run_id", "sweep_id", "preset", "settings", "blocks", "chunks"),
    "round": ("cells", "blocks"),
    "dispatched": ("block", "attempt"),
    "died": ("block", "alone"),
    "done": ("block",),
    "quarantined": ("block",),
    "reopened": ("block",),
}
"""What an entry that counts must say."""

_TEXTS = ("event", "run_id", "sweep_id", "preset", "fingerprint", "why", "simulator", "role")
_NUMBERS = ("block", "attempt", "epoch", "blocks", "chunks", "cells")
_IDENTIFIERS = ("run_id", "sweep_id")


def _check_entry(entry: Any) -> None:
    """Raise ValueError where an entry of a ledger, read from its file, is none."""
    if not isinstance(entry, dict):
        raise ValueError("not an object")
    for name in _NEEDS.get(str(entry.get("event")), ()):
        if name not in entry:
            raise ValueError(f"{entry['event']!r} without {name}")
    if entry.get("event") == "round":
        cells = entry["cells"]
        if not isinstance(cells, list) or not all(type(cell) is int and 0 <= cell < 1 << 32 for cell in cells):
            raise ValueError("cells should be a list of numbers from 0 on")
        entry = {**entry, "cells": len(cells)}
    for name, value in entry.items():
        if name in _TEXTS and not isinstance(value, str):
            raise ValueError(f"{name} = {value!r}: should be text")
        if name in _NUMBERS and (type(value) is not int or not 0 <= value < 1 << 32):
            raise ValueError(f"{name} = {value!r}: should be a number from 0 on")
        if name in _IDENTIFIERS and not _IDENTIFIER.fullmatch(value):
            raise ValueError(f"{name} = {value!r}: should be 16 hexadecimal digits")
        if name == "alone" and not isinstance(value, bool):
            raise ValueError(f"{name} = {value!r}: should be true or false")
    if "settings" in entry:
        settings = entry["settings"]
        if not isinstance(settings, list) or not all(isinstance(line, str) for line in settings):
            raise ValueError("settings should be a list of texts")


def is_finished(directory: Path, entries: list[dict[str, Any]]) -> bool:
    """Return whether every block of a run is settled and its report written."""
    settled = {entry["block"] for entry in entries if entry.get("event") in ("done", "quarantined")}
    settled -= {entry["block"] for entry in entries if entry.get("event") == "reopened"}
    return len(settled) == max(entry.get("blocks", 0) for entry in entries) and (directory / REPORT).exists()


class Run:
    """One run on disk, held by its coordinator. Make it with :meth:`create` or :meth:`resume`."""

    def __init__(self, directory: Path, run_id: str, sweep: Sweep, blocks: Blocks, ledger: Ledger) -> None:
        self.directory, self.run_id, self.sweep, self.blocks, self.ledger = directory, run_id, sweep, blocks, ledger
        self._lock = lock(directory, "coordinator")
        self._file = open(directory / LEDGER, "ab")  # noqa: SIM115  # open as long as the run
        self.quarantined: dict[int, str] = {}

    @classmethod
    def create(cls, directory: Path, run_id: str, sweep: Sweep) -> Run:
        """Begin a run in a directory that is new, or holds at most what its supervisor and recorder put there.

        Raises
        ------
        RunError
            Where the directory holds a run already or cannot be written.
        """
        try:
            directory.mkdir(parents=True, exist_ok=True)
            if (directory / LEDGER).exists():
                raise RunError(f"{directory}: holds a run already; resume it, or choose another directory")
            run = cls(directory, run_id, sweep, sweep.first_blocks, Ledger(sweep.blocks, sweep.chunks))
            plan = {
                "event": "planned",
                "run_id": run_id,
                "sweep_id": sweep.sweep_id,
                "preset": sweep.preset,
                "settings": sweep.settings(),
                "fingerprint": fingerprint(),
                "blocks": sweep.blocks,
                "chunks": sweep.chunks,
                "cells": sweep.cells,
                "epoch": 1,
            }
            run.record([plan, *([_round(run.blocks)] if run.blocks.adaptive else [])])
        except OSError as error:
            raise RunError(f"{directory}: cannot be written: {error.strerror}") from None
        return run

    @classmethod
    def resume(cls, directory: Path) -> Run:
        """Go on with a run that was cut off.

        Raises
        ------
        RunError
            Where there is none, or this machine's kernel would not give the same bytes.
        """
        entries = read_ledger(directory)
        plan = entries[0]
        try:
            sweep = replace(Sweep.from_spec("", plan["settings"]), preset=str(plan["preset"]))
        except (ParameterError, KeyError, TypeError) as error:
            raise RunError(f"{directory / LEDGER}, line 1: {error}") from None
        if (sweep.blocks, sweep.chunks) != (plan["blocks"], plan["chunks"]):
            given, right = f"{plan['blocks']} blocks of {plan['chunks']} chunks", f"{sweep.blocks} of {sweep.chunks}"
            raise RunError(f"{directory / LEDGER}, line 1: {given}; its settings make {right}")
        if sweep.sweep_id != plan.get("sweep_id") or fingerprint() != plan.get("fingerprint"):
            raise RunError(
                f"{directory}: was computed by kernel {plan.get('fingerprint')}, here is {fingerprint()}; "
                "their results could differ: resume where it began, or sweep anew"
            )
        _cut_torn_line(directory / LEDGER)
        try:
            blocks = _blocks(sweep, entries)
        except ValueError as error:
            raise RunError(f"{directory / LEDGER}: {error}") from None
        run = cls(directory, plan["run_id"], sweep, blocks, Ledger.resume(blocks.count, sweep.chunks, entries))
        run.quarantined = {e["block"]: e.get("why", "") for e in entries if e.get("event") == "quarantined"}
        run.record([{"event": "resumed", "epoch": run.ledger.epoch}])
        return run

    def record(self, entries: Iterable[Mapping[str, Any]]) -> None:
        """Append entries to the ledger file and see them on disk."""
        at = time.time()
        lines = b"".join(json.dumps({**entry, "at": round(at, 3)}).encode() + b"\n" for entry in entries)
        if lines:
            self._file.write(lines)
            self._file.flush()
            os.fsync(self._file.fileno())

    def next_round(self, basin: Basin) -> bool:
        """Plan another round of an adaptive sweep, all blocks being settled; return whether there is one."""
        more = self.sweep.more_blocks(self.blocks, np.where(self.done(), basin.transient_periods, np.nan))
        if more is not None:
            self.record([_round(more)])
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
            **extra,
        }
        with replacing(self.directory / REPORT) as file:
            file.write(json.dumps(report, indent=2).encode() + b"\n")
        return report

    def close(self) -> None:
        """Give up the lock and the ledger file."""
        self._file.close()
        os.close(self._lock)


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


def _round(blocks: Blocks) -> dict[str, Any]:
    """Return the ledger entry of the latest round."""
    cells = blocks.rounds[-1].tolist()
    return {"event": "round", "round": len(blocks.rounds), "cells": cells, "blocks": blocks.count}


def _blocks(sweep: Sweep, entries: Iterable[Mapping[str, Any]]) -> Blocks:
    """Return the blocks of a recorded run; one cut off before its first round was recorded begins with it."""
    rounds = [np.array(entry["cells"], np.int64) for entry in entries if entry.get("event") == "round"]
    if not rounds:
        return sweep.first_blocks
    blocks = Blocks(sweep.cells, sweep.block_cells, [])
    for cells in rounds:
        blocks = blocks.grown(cells)
    return blocks


def _cut_torn_line(path: Path) -> None:
    """Drop what a crash left after the last newline, so that the next entry begins a line."""
    content = path.read_bytes()
    whole = content.rfind(b"\n") + 1
    if whole != len(content):
        shutil.copyfile(path, path.with_name(path.name + ".torn"))
        os.truncate(path, whole)


def _versions() -> dict[str, str]:
    versions = {"python": platform.python_version()}
    for name in VERSIONS_OF:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return versions
