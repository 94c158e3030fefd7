"""What a bag holds of a run, by identity: messages in, what to store and what to answer out. No files, no clock.

A receipt answers an *attempt*: it is due when both stream messages of a chunk have come from that attempt and are
stored, whether from it or from an earlier one. So every attempt is answered, again and again if it is sent again.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple

from bow_sim.protocol.cdr import RECEIPT_STREAMS, RECEIPT_VERDICTS, chunk_checksum

BRIDGE_FORCE, STICK_SLIP, VERDICTS = "bridge_force", "stick_slip", "verdicts"

MAX_HALVES = 4096
"""Attempts of which one half has come, remembered at most: more than are ever under way, only rubbish is forgotten."""


class Answer(NamedTuple):
    """One entry of a receipt."""

    kind: int
    block: int
    chunk: int
    attempt: int
    checksum: int


class Inventory:
    """The sealed messages of a run that are stored, each once.

    Attributes
    ----------
    duplicates
        Messages that were stored before.
    contradictions
        (topic, block, chunk) -> how many duplicates carried another checksum than the stored message.
    """

    def __init__(self) -> None:
        self._stored: dict[str, dict[tuple[int, int], int]] = {BRIDGE_FORCE: {}, STICK_SLIP: {}, VERDICTS: {}}
        self._counts: Counter[int] = Counter()
        self._halves: dict[tuple[int, int, int], str] = {}
        self.duplicates = 0
        self.contradictions: Counter[tuple[str, int, int]] = Counter()

    def restore(self, topic: str, checksums: Mapping[tuple[int, int], int]) -> None:
        """Take in what is stored of a topic from before: (block, chunk) -> checksum."""
        self._stored[topic].update(checksums)
        self._counts.update(block for block, _ in checksums)

    def count(self, block: int) -> int:
        """Return how many messages of a block are stored: three for each chunk where all of it is."""
        return self._counts[block]

    def __len__(self) -> int:
        return sum(map(len, self._stored.values()))

    def checksum(self, topic: str, block: int, chunk: int) -> int | None:
        """Return the checksum of a stored message, None where it is not stored."""
        return self._stored[topic].get((block, chunk))

    def chunk_checksum(self, block: int, chunk: int) -> int | None:
        """Return the checksum of a chunk of which both stream messages are stored, else None."""
        parts = [self._stored[topic].get((block, chunk)) for topic in (BRIDGE_FORCE, STICK_SLIP)]
        if parts[0] is None or parts[1] is None:
            return None
        return chunk_checksum(block, chunk, parts[0], parts[1])

    def take(self, topic: str, block: int, chunk: int, attempt: int, checksum: int) -> tuple[bool, Answer | None]:
        """Note a message that has come; return whether it is new and has to be stored, and what to answer then."""
        stored = self._stored[topic]
        new = (block, chunk) not in stored
        if new:
            stored[block, chunk] = checksum
            self._counts[block] += 1
        else:
            self.duplicates += 1
            if stored[block, chunk] != checksum:
                self.contradictions[topic, block, chunk] += 1
        if topic == VERDICTS:
            return new, Answer(RECEIPT_VERDICTS, block, chunk, attempt, stored[block, chunk])
        both = self._halves.get((block, chunk, attempt), topic) != topic
        whole = self.chunk_checksum(block, chunk)
        if whole is not None and (both or new):
            self._halves.pop((block, chunk, attempt), None)
            return new, Answer(RECEIPT_STREAMS, block, chunk, attempt, whole)
        self._halves[block, chunk, attempt] = topic
        if len(self._halves) > MAX_HALVES:
            del self._halves[next(iter(self._halves))]
        return new, None
