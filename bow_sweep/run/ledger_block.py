"""One block in the ledger: its state, and the answers to it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from bow_sweep.run.ledger_events import State

SUSPECT_CRASHES = 2
"""A block during which this many simulators crashed is sent only to simulators that hold no other block."""


class Checksums(NamedTuple):
    """Of a chunk: of its streams, as the classifier judged them, and of its verdicts."""

    streams: int
    verdicts: int


@dataclass
class Block:
    """What the ledger knows of a block."""

    state: State = State.DUE
    attempt: int = 0
    crashes: int = 0
    crashes_alone: int = 0
    touched: float = 0.0
    station: str = ""
    on_disk: bool = False
    streams: dict[int, int] = field(default_factory=dict)
    judged: dict[int, Checksums] = field(default_factory=dict)
    verdicts: dict[int, int] = field(default_factory=dict)
    judged_before: dict[int, Checksums] = field(default_factory=dict)  # by the stations that had it before

    def count_crash(self, alone: bool, by: int = 1) -> None:
        """Count a crash of a simulator that was computing it, and held no other block if `alone`."""
        self.crashes = max(0, self.crashes + by)
        self.crashes_alone = max(0, self.crashes_alone + alone * by)

    @property
    def suspect(self) -> bool:
        """Whether it is sent only to simulators that hold no other block."""
        return self.crashes >= SUSPECT_CRASHES

    def discard_answers(self) -> None:
        """Forget all answers."""
        for answers in (self.streams, self.judged, self.verdicts):
            answers.clear()
        self.on_disk = False

    def move(self, station: str) -> None:
        """Have it belong to another station; what the others judged must still be equal."""
        self.judged_before.update(self.judged)
        self.discard_answers()
        self.station = station

    def contradiction(self, chunk: int) -> str:
        """Return which checksums of a chunk differ, or ""."""
        judged = self.judged.get(chunk)
        if judged is None:
            return ""
        streams, verdicts = self.streams.get(chunk, judged.streams), self.verdicts.get(chunk, judged.verdicts)
        if streams != judged.streams:
            return f"chunk {chunk}: streams recorded as {streams:016x}, judged as {judged.streams:016x}"
        if verdicts != judged.verdicts:
            return f"chunk {chunk}: verdicts recorded as {verdicts:016x}, judged as {judged.verdicts:016x}"
        return ""
