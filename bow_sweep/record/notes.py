"""What our files say of themselves in MCAP metadata records: how they are written, and which messages are missing.

Messages are missing, by their numbers, where a run goes on although a file of its bag was lost or damaged.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from mcap.records import Metadata

NAME = "bow.missing"
"""Of the metadata record that says which messages before its file are missing, and why."""

HOW = Metadata("bow.record", {"version": "2"})
"""Stands in every file. Version 2: every block that is whole is receipted as on the disk. Files of old lack it."""

Range = tuple[int, int]
"""Numbers of the first and the last message of some."""

_RANGES = re.compile(r"\d{1,10}-\d{1,10}(,\d{1,10}-\d{1,10})*")


def note(missing: Sequence[Range], why: str) -> Metadata:
    """Return the record that notes missing messages."""
    return Metadata(NAME, {"messages": ",".join(f"{start}-{end}" for start, end in missing), "why": why})


def version_in(records: Iterable[Metadata]) -> int:
    """Return how a file says that it is written; 1 where it says nothing."""
    said = [record.metadata.get("version", "") for record in records if record.name == HOW.name]
    return max([1, *(int(text) for text in said if re.fullmatch(r"\d{1,4}", text))])


def noted_in(records: Iterable[Metadata]) -> list[Range]:
    """Return what the records of a file note as missing; one that makes no sense notes nothing."""
    found = []
    for record in records:
        text = record.metadata.get("messages", "")
        if record.name == NAME and _RANGES.fullmatch(text):
            found += [(int(start), int(end)) for start, _, end in (part.partition("-") for part in text.split(","))]
    return found


def outside(ranges: Iterable[Range], others: Iterable[Range]) -> list[Range]:
    """Return the parts of some ranges that are in none of the others."""
    left = list(ranges)
    for first, last in others:
        cut = []
        for start, end in left:
            if last < start or first > end:
                cut.append((start, end))
            else:
                cut += [(start, first - 1)] * (start < first) + [(last + 1, end)] * (end > last)
        left = cut
    return sorted(left)
