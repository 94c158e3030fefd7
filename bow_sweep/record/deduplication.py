"""The messages stored in a bag, each once: which to store, and which receipts answer them. No files, no clock.

A receipt answers an *attempt*: it is due when both stream messages of a chunk have come from that attempt and are
stored, from this attempt or an earlier one. So every attempt is answered, and again where it is sent again.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple

from bow_sim.protocol.cdr import chunk_checksum
from bow_sim.protocol.states import ReceiptKind

BRIDGE_FORCE, STICK_SLIP, VERDICTS = "bridge_force", "stick_slip", "verdicts"

MAX_HALVES = 4096
"""Attempts remembered of which only one message has come. More are never under way: only stray ones are forgotten."""


class Answer(NamedTuple):
    """One entry of a receipt; `kind` is a :class:`bow_sim.protocol.states.ReceiptKind`."""

    kind: int
    block: int
    chunk: int
    attempt: int
    checksum: int


class Taken(NamedTuple):
    """What to do with a message.

    Attributes
    ----------
    new
        It has to be stored.
    answer
        The entry of a receipt that is due when it is stored; None for none.
    """

    new: bool
    answer: Answer | None


class StoredMessages:
    """Checksums of the stored stream messages and verdicts of a run.

    Attributes
    ----------
    duplicates
        Number of messages that were stored before.
    contradictions
        (topic, block, chunk) -> number of duplicates with another checksum than the stored message.
    """

    def __init__(self) -> None:
        self._stored: dict[str, dict[tuple[int, int], int]] = {BRIDGE_FORCE: {}, STICK_SLIP: {}, VERDICTS: {}}
        self._counts: Counter[int] = Counter()
        self._halves: dict[tuple[int, int, int], str] = {}
        self.duplicates = 0
        self.contradictions: Counter[tuple[str, int, int]] = Counter()

    def restore(self, topic: str, checksums: Mapping[tuple[int, int], int]) -> None:
        """Take in the messages of a topic that are in the bag already: (block, chunk) -> checksum."""
        self._stored[topic].update(checksums)
        self._counts.update(block for block, _ in checksums)

    def count(self, block: int) -> int:
        """Return the number of stored messages of a block: three for each chunk if it is complete."""
        return self._counts[block]

    def __len__(self) -> int:
        return sum(map(len, self._stored.values()))

    def checksum(self, topic: str, block: int, chunk: int) -> int | None:
        """Return the checksum of a stored message; None where it is not stored."""
        return self._stored[topic].get((block, chunk))

    def chunk_checksum(self, block: int, chunk: int) -> int | None:
        """Return the checksum of a chunk whose two stream messages are stored; None otherwise."""
        force, slip = (self.checksum(topic, block, chunk) for topic in (BRIDGE_FORCE, STICK_SLIP))
        return None if force is None or slip is None else chunk_checksum(block, chunk, force, slip)

    def take(self, topic: str, block: int, chunk: int, attempt: int, checksum: int) -> Taken:
        """Take in a message that has come; return what to do with it."""
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
            return Taken(new, Answer(ReceiptKind.VERDICTS, block, chunk, attempt, stored[block, chunk]))
        both = self._halves.get((block, chunk, attempt), topic) != topic
        whole = self.chunk_checksum(block, chunk)
        if whole is not None and (both or new):
            self._halves.pop((block, chunk, attempt), None)
            return Taken(new, Answer(ReceiptKind.STREAMS, block, chunk, attempt, whole))
        self._halves[block, chunk, attempt] = topic
        if len(self._halves) > MAX_HALVES:
            del self._halves[next(iter(self._halves))]
        return Taken(new, None)
