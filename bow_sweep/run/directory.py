"""A run directory: its lock, its ledger file, its report. Each file is either complete or not there."""

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
from bow_sim.kernel.fingerprint import difference
from bow_sim.physics.errors import ParameterError
from bow_sim.protocol.blocks import Blocks
from bow_sim.protocol.messages import FORMAT
from bow_sim.protocol.repeats import Repeats
from bow_sweep.maps.basin_map import Basin
from bow_sweep.maps.held_fixed import common_in_si
from bow_sweep.maps.reliability import Reliability
from bow_sweep.plan.adaptive import fill
from bow_sweep.plan.sweep import Sweep
from bow_sweep.run import ledger_file
from bow_sweep.run.errors import OtherProgramError, RunError
from bow_sweep.run.ledger import Ledger, State
from bow_sweep.run.ledger_file import LEDGER, latest_states, read_ledger, set_ledger_aside
from bow_sweep.run.lock import take

REPORT, PICTURE = "report.json", "map.png"
STUDY, SEARCH, CAMPAIGN = "study.yaml", "optimise.yaml", "campaign.json"
"""Files that say what a directory of several runs is for; the last is of before there were studies."""

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


def is_finished(directory: Path, entries: list[dict[str, Any]]) -> bool:
    """Return whether every block of a run is done or quarantined and its report is written."""
    settled = [state for state in latest_states(entries).values() if state != "reopened"]
    return len(settled) == max(entry.get("blocks", 0) for entry in entries) and (directory / REPORT).exists()


class Run:
    """One run on disk, as its coordinator has it. Make it with :meth:`create` or :meth:`resume`.

    Parameters
    ----------
    locked
        Lock the directory; False for file systems that have no locks.
    first
        Entries of a new ledger; empty if there is a ledger already.

    Attributes
    ----------
    blocks
        The blocks as far as they are planned; an adaptive sweep adds some with each round.
    ledger
        The state of each block.
    quarantined
        Quarantined block -> reason.
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
        self._lock = take(directory, "coordinator") if locked else -1
        if first:  # written at once: a ledger that a crash cuts off in its plan could not be read
            at = round(time.time(), 3)
            ledger_file.write_ledger(directory, [{**entry, "at": at} for entry in first])
        self._file = open(directory / LEDGER, "ab")  # noqa: SIM115  # open as long as the run
        sync_directory(directory)
        self.quarantined: dict[int, str] = {}

    @classmethod
    def create(cls, directory: Path, run_id: str, sweep: Sweep, locked: bool = True) -> Run:
        """Create a run in a new directory; files of its supervisor and recorder may be there already.

        Raises
        ------
        RunError
            If the directory holds a run already or cannot be written.
        """
        try:
            directory.mkdir(parents=True, exist_ok=True)
            sync_directory(directory.parent)
            if (directory / LEDGER).exists():
                raise RunError(f"{directory}: holds a run already; resume it, or choose another directory")
            blocks = sweep.first_blocks
            first = [planned(run_id, sweep), *([round_entry(blocks)] if blocks.adaptive else [])]
            ledger = Ledger(sweep.blocks, sweep.chunks, sweep.recorded_chunks)
            run = cls(directory, run_id, sweep, blocks, ledger, locked, first)
        except OSError as error:
            raise RunError(f"{directory}: cannot be written: {error.strerror}") from None
        return run

    @classmethod
    def resume(cls, directory: Path, locked: bool = True) -> Run:
        """Resume an interrupted run from its ledger.

        :mod:`bow_sweep.coordinator.resume` compares ledger and bag before.

        Raises
        ------
        RunError
            If there is no run, or this machine's kernel would not give the same bytes.
        """
        entries = read_ledger(directory)
        plan = entries[0]
        sweep = sweep_of(plan, directory / LEDGER)
        _cut_torn_line(directory)
        try:
            blocks = blocks_of(sweep, entries)
        except ValueError as error:
            raise RunError(f"{directory / LEDGER}: {error}") from None
        ledger = Ledger.resume(blocks.count, sweep.chunks, entries, sweep.recorded_chunks)
        run = cls(directory, plan["run_id"], sweep, blocks, ledger, locked)
        run.quarantined = {
            e["block"]: e.get("why", "")
            for e in entries
            if e.get("event") == "quarantined" and run.ledger.is_quarantined(e["block"])
        }
        run.record([{"event": "resumed", "epoch": run.ledger.epoch}])
        return run

    def record(self, entries: Iterable[Mapping[str, Any]]) -> None:
        """Append entries to the ledger file and sync it to the disk."""
        at = round(time.time(), 3)
        lines = ledger_file.lines_of({**entry, "at": at} for entry in entries)
        if lines:
            self._file.write(lines)
            self._file.flush()
            os.fsync(self._file.fileno())

    def next_round(self, basin: Basin) -> bool:
        """Plan the next round of an adaptive sweep, once all blocks are settled; return whether there is one."""
        more = self.sweep.more_blocks(self.blocks, np.where(self.done(), basin.transient_periods, np.nan))
        if more is not None:
            self.record([round_entry(more)])
            self.blocks = more
        return more is not None

    def done(self) -> np.ndarray:
        """Return which cells are in blocks that are done, (cells,), repeats included."""
        return self.blocks.cells_of(n for n, block in enumerate(self.ledger.blocks) if block.state is State.DONE)

    def transient_periods(self, basin: Basin) -> np.ndarray:
        """Return the final transient lengths, (ny, nx) periods.

        NaN: not done; cells that an adaptive sweep does not simulate are predicted.
        """
        length = basin.of_plane(np.where(self.done(), basin.transient_periods, np.float32(np.nan)))
        planned = basin.of_plane(self.blocks.planned)
        return np.where(planned, length, fill(length)) if self.blocks.adaptive else length

    def _findings(self, basin: Basin) -> dict[str, Any]:
        """Return the entries of the report that follow from the verdicts."""
        length, done = self.transient_periods(basin), self.done()
        regimes = basin.of_plane(basin.latest("regime"))[basin.of_plane(done)]
        gesture = self.sweep.parameters.gesture
        return findings(length, regimes, gesture, self.sweep.repeats, Reliability.of_basin(basin, done))

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
        """Write report.json and return its content.

        Parameters
        ----------
        basin
            The map.
        wall_seconds
            Duration of the run.
        extra
            More entries.
        """
        shared = common_in_si(vars(self.sweep.parameters), (self.sweep.x.name, self.sweep.y.name))
        report = {
            "run_id": self.run_id,
            "sweep_id": self.sweep.sweep_id,
            "preset": self.sweep.preset,
            "settings": list(self.sweep.settings()),
            **({"si": shared} if shared else {}),
            "notes": list(self.sweep.notes),
            "fingerprint": self.sweep.fingerprint,
            "classifier": self.sweep.thresholds.hash,
            "cells": self.accounts(),
            "cells_predicted": self.sweep.cells - self.blocks.planned_cells,
            "rounds": len(self.blocks.rounds),
            "samples": self.cells_in(State.DONE) * self.sweep.parameters.samples,
            "quarantined_blocks": {str(block): why for block, why in self.quarantined.items()},
            "attempts": sum(block.attempt for block in self.ledger.blocks),
            "epoch": self.ledger.epoch,
            **self._findings(basin),
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
        """Close the ledger file and release the lock."""
        self._file.close()
        if self._lock >= 0:
            os.close(self._lock)


def digest(path: Path) -> str | None:
    """Return the XXH3-64 of a file, 16 hexadecimal digits; None if there is no such file."""
    return xxhash.xxh3_64_hexdigest(path.read_bytes()) if path.is_file() else None


def findings(
    transient_periods: np.ndarray,
    regimes: np.ndarray,
    gesture: str,
    repeats: Repeats,
    reliability: Reliability | None,
) -> dict[str, Any]:
    """Return the entries of a report that follow from the map.

    Parameters
    ----------
    transient_periods
        (ny, nx), see :meth:`Run.transient_periods`.
    regimes
        (cells of the plane that are done,) codes at the latest test.
    gesture
        Of the sweep. For *guettler* there is also the share of cells whose transient is perfect, less than a period.
    repeats, reliability
        How the cells are repeated, and what the repeats end as; None where there are none.
    """
    length = np.nan_to_num(transient_periods)
    counts = np.bincount(regimes, minlength=len(REGIMES))[: len(REGIMES)]
    perfect = {"perfect_fraction": float(np.mean((length > 0) & (length < 1)))} if gesture == "guettler" else {}
    return {
        **perfect,
        "helmholtz_fraction": float(np.mean(length > 0)),
        "median_transient_periods": float(np.median(length[length > 0])) if length.any() else None,
        "regimes": {name: int(count) for name, count in zip(REGIMES, counts, strict=True)},
        **({"repeats": reliability.findings(repeats, length > 0)} if reliability is not None else {}),
    }


def planned(run_id: str, sweep: Sweep, epoch: int = 1) -> dict[str, Any]:
    """Return the ledger entry that a run begins with."""
    return {
        "event": "planned",
        "format": FORMAT,
        "run_id": run_id,
        "sweep_id": sweep.sweep_id,
        "preset": sweep.preset,
        "settings": sweep.settings(),
        "fingerprint": sweep.fingerprint,
        "classifier": sweep.thresholds.hash,
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
        If it describes none, or kernel or classifier of this machine would not give the same bytes.
    """
    if plan.get("format", 1) > FORMAT:
        what = f"format {plan['format']}, written by a later bow; this one reads formats up to {FORMAT}: update it"
        raise RunError(f"{where}, line 1: {what}")
    try:
        sweep = replace(Sweep.from_spec("", plan["settings"]), preset=str(plan["preset"]))
    except (ParameterError, KeyError, TypeError) as error:
        raise RunError(f"{where}, line 1: {error}") from None
    if (sweep.blocks, sweep.chunks) != (plan["blocks"], plan["chunks"]):
        given, right = f"{plan['blocks']} blocks of {plan['chunks']} chunks", f"{sweep.blocks} of {sweep.chunks}"
        raise RunError(f"{where}, line 1: {given}; its settings make {right}")
    there, here = str(plan.get("fingerprint")), sweep.fingerprint
    if sweep.sweep_id != plan.get("sweep_id") or there != here:
        raise OtherProgramError(
            f"{where.parent}: was computed by kernel {there}, here is {here}; they differ in "
            f"{difference(there, here) or 'the settings'}: resume where it began, or sweep anew"
        )
    classifier = sweep.thresholds.hash
    if plan.get("classifier", classifier) != classifier:  # ledgers of old have none
        raise OtherProgramError(
            f"{where.parent}: was begun with classifier {plan['classifier']}, its settings make {classifier} here; "
            "their verdicts could differ: resume where it began, or sweep anew"
        )
    return sweep


def round_entry(blocks: Blocks) -> dict[str, Any]:
    """Return the ledger entry of the latest round."""
    cells = blocks.rounds[-1].tolist()
    return {"event": "round", "round": len(blocks.rounds), "cells": cells, "blocks": blocks.count}


def blocks_of(sweep: Sweep, entries: Iterable[Mapping[str, Any]]) -> Blocks:
    """Return the blocks of a recorded run; those of the first round if none is recorded yet.

    Raises
    ------
    ValueError
        If its rounds cannot be of this sweep.
    """
    rounds = [np.array(entry["cells"], np.int64) for entry in entries if entry.get("event") == "round"]
    if not rounds:
        return sweep.first_blocks
    blocks = Blocks(sweep.cells, sweep.block_cells, [], sweep.kinds)
    for cells in rounds:
        blocks = blocks.grown(cells)
    return blocks


def _cut_torn_line(directory: Path) -> None:
    """Cut off what a crash left after the last newline, so that the next entry begins a new line."""
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
