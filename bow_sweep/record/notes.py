"""MCAP metadata records of our files: version and run of the record, and the numbers of messages that are missing.

Messages are missing where a run was resumed although a file of its bag was lost or damaged.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from mcap.records import Metadata

from bow_sim.protocol.messages import FORMAT

NAME = "bow.missing"
"""Name of the record that lists the messages missing before its file, and why."""

HOW = "bow.record"
"""Name of the record in every file that states its version, see :data:`bow_sim.protocol.messages.FORMAT`, and its run.
Files of version 1 have none."""


class Range(NamedTuple):
    """Numbers of the first and the last of some messages."""

    first: int
    last: int


_RANGES = re.compile(r"\d{1,10}-\d{1,10}(,\d{1,10}-\d{1,10})*")


def how(run_id: str, sweep_id: str) -> Metadata:
    """Return the record that states version and run of a file."""
    return Metadata(HOW, {"version": str(FORMAT), "run_id": run_id, "sweep_id": sweep_id})


def custom_data(run_id: str, sweep_id: str) -> dict[str, str]:
    """Return what metadata.yaml of a bag says of its run, in `custom_data`."""
    return {"bow.version": str(FORMAT), "bow.run_id": run_id, "bow.sweep_id": sweep_id}


def too_new(version: int) -> str:
    """Return why a file of a version cannot be read; "" where it can."""
    if version <= FORMAT:
        return ""
    return f"is of version {version}, written by a later bow; this one reads versions up to {FORMAT}: update it"


def note(missing: Sequence[Range], why: str) -> Metadata:
    """Return the record that lists missing messages."""
    return Metadata(NAME, {"messages": ",".join(f"{first}-{last}" for first, last in missing), "why": why})


def version_in(records: Iterable[Metadata]) -> int:
    """Return the version that a file states; 1 where it states none."""
    versions = [record.metadata.get("version", "") for record in records if record.name == HOW]
    return max([1, *(int(text) for text in versions if re.fullmatch(r"\d{1,4}", text))])


def noted_in(records: Iterable[Metadata]) -> list[Range]:
    """Return the missing messages that the records of a file list; records that cannot be parsed list none."""
    found = []
    for record in records:
        text = record.metadata.get("messages", "")
        if record.name == NAME and _RANGES.fullmatch(text):
            for part in text.split(","):
                first, _, last = part.partition("-")
                found.append(Range(int(first), int(last)))
    return found


def outside(ranges: Iterable[Range], others: Iterable[Range]) -> list[Range]:
    """Return the parts of `ranges` that are in none of the `others`, sorted."""
    left = list(ranges)
    for start, end in others:
        cut = []
        for one in left:
            if one.last < start or one.first > end:
                cut.append(one)
                continue
            if one.first < start:
                cut.append(Range(one.first, start - 1))
            if one.last > end:
                cut.append(Range(end + 1, one.last))
        left = cut
    return sorted(left)
