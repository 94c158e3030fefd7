"""The ledger on disk, ``ledger.jsonl``: one entry in each line, the plan first; read strictly, or leniently."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bow_sim.atomic_files import replacing, sync_directory
from bow_sweep.run.errors import RunError

LEDGER = "ledger.jsonl"
TORN = f"{LEDGER}.torn"
"""Name of the copy of a ledger that is repaired; a number is added if there is one already."""

_IDENTIFIER = re.compile("[0-9a-f]{16}")


_NEEDS = {
    "planned": ("run_id", "sweep_id", "preset", "settings", "blocks", "chunks"),
    "round": ("cells", "blocks"),
    "dispatched": ("block", "attempt"),
    "died": ("block", "alone"),
    "returned": ("block", "alone"),
    "done": ("block",),
    "quarantined": ("block",),
    "reopened": ("block",),
}
"""Event -> the fields that its entry must have."""

_TEXTS = ("event", "run_id", "sweep_id", "preset", "fingerprint", "why", "simulator", "role", "station")
_NUMBERS = ("block", "attempt", "epoch", "blocks", "chunks", "cells", "round", "format")
_IDENTIFIERS = ("run_id", "sweep_id")


def check_entry(entry: Any) -> None:
    """Raise ValueError if a value read from a ledger's file is not an entry."""
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
        if name in _NUMBERS and (type(value) is not int or not 0 <= value < 1 << 31):
            raise ValueError(f"{name} = {value!r}: should be a number from 0 on")
        if name in _IDENTIFIERS and not _IDENTIFIER.fullmatch(value):
            raise ValueError(f"{name} = {value!r}: should be 16 hexadecimal digits")
        if name == "alone" and not isinstance(value, bool):
            raise ValueError(f"{name} = {value!r}: should be true or false")
    if "settings" in entry:
        settings = entry["settings"]
        if not isinstance(settings, list) or not all(isinstance(line, str) for line in settings):
            raise ValueError("settings should be a list of texts")


def _entry(line: bytes) -> dict[str, Any]:
    """Return the entry in a line; raises ValueError or RecursionError if it is not one."""
    entry: dict[str, Any] = json.loads(line.decode())
    check_entry(entry)
    return entry


def read_ledger(directory: Path) -> list[dict[str, Any]]:
    """Return the entries of a run's ledger; a last line that a crash cut off is left out.

    Raises
    ------
    RunError
        If there is no ledger, or a line before the last is damaged.
    """
    path = directory / LEDGER
    try:
        lines = path.read_bytes().split(b"\n")
    except OSError as error:
        raise RunError(f"{path}: {error.strerror}; a run directory of `bow sweep` holds one") from None
    entries = []
    for number, line in enumerate(lines[:-1], 1):  # what follows the last newline was being written
        try:
            entries.append(_entry(line))
        except (ValueError, RecursionError) as error:
            raise RunError(f"{path}, line {number}: not a ledger entry: {error}") from None
    if not entries or entries[0].get("event") != "planned":
        raise RunError(f"{path}: does not begin with the plan of a run")
    return entries


@dataclass
class Reading:
    """A ledger as far as it can be read.

    Attributes
    ----------
    entries
        In order; the first is the plan, unless that is lost.
    bad
        Numbers of the lines that are not entries, from 1; the last may be cut off.
    exists
        Whether there is a ledger.
    """

    entries: list[dict[str, Any]]
    bad: list[int]
    exists: bool

    @property
    def planned(self) -> bool:
        """Whether the entries begin with the plan."""
        return bool(self.entries) and self.entries[0].get("event") == "planned"


def read_leniently(directory: Path) -> Reading:
    """Return the entries of a run's ledger, leaving out lines that are not entries.

    A lost entry can cause work to be repeated, never a wrong map: a run is resumed from what is in its bag.
    """
    try:
        content = (directory / LEDGER).read_bytes()
    except OSError:
        return Reading([], [], False)
    entries, bad = [], []
    for number, line in enumerate(content.split(b"\n"), 1):
        try:
            if line or number <= content.count(b"\n"):
                entries.append(_entry(line))
        except (ValueError, RecursionError):
            bad.append(number)
            continue
        if entries and entries[-1].get("event") == "planned" and len(entries) > 1:
            del entries[-1]  # a plan is valid only as the first entry
            bad.append(number)
    if content and not content.endswith(b"\n") and content.count(b"\n") + 1 not in bad:
        bad.append(content.count(b"\n") + 1)  # complete, but the next entry would be appended to its line
    return Reading(entries, bad, True)


def latest_states(entries: Iterable[Mapping[str, Any]]) -> dict[int, str]:
    """Return block -> "done", "quarantined" or "reopened", whichever event of these is its latest."""
    states = ("done", "quarantined", "reopened")
    return {entry["block"]: entry["event"] for entry in entries if entry.get("event") in states}


def done_at(entries: Iterable[Mapping[str, Any]]) -> dict[int, str]:
    """Return block -> the station that did it, "" for that of the coordinator's machine, of blocks that are done."""
    found: dict[int, str] = {}
    for entry in entries:
        if entry.get("event") == "done":
            found[entry["block"]] = entry.get("station", "")
        elif entry.get("event") in ("quarantined", "reopened"):
            found.pop(entry["block"], None)
    return found


def set_ledger_aside(directory: Path) -> Path:
    """Copy a ledger to a new file beside it; return that file."""
    number, to = 0, directory / TORN
    while os.path.lexists(to):
        number += 1
        to = directory / f"{TORN}.{number}"
    shutil.copyfile(directory / LEDGER, to)
    with open(to, "rb") as file:
        os.fsync(file.fileno())
    sync_directory(directory)
    return to


def lines_of(entries: Iterable[Mapping[str, Any]]) -> bytes:
    """Return entries as the lines of a ledger."""
    return b"".join(json.dumps(entry).encode() + b"\n" for entry in entries)


def write_ledger(directory: Path, entries: Iterable[Mapping[str, Any]]) -> None:
    """Write a ledger with these entries, replacing the one that is there, if any."""
    with replacing(directory / LEDGER) as file:
        file.write(lines_of(entries))
