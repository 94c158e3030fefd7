"""Flow control: the chunks that a simulator has sent and that are not answered yet.

A chunk is answered when the recorder has receipted it and the classifier has judged it. At most `LIMIT` chunks are
under way, and none begins while `LIMIT_BYTES` are. A DDS acknowledgement does not count, because it does not show that
the chunk was written and judged. A chunk whose streams are not recorded needs no receipt for them: it is answered when
its verdicts are, whoever judged it. What is unanswered is sent again; consumers answer a duplicate like the first.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from bow_sim.protocol.cdr import Buffer

LIMIT = 16
"""Chunks under way at most; shared memory is reserved for as many messages."""

LIMIT_BYTES = 22 << 20
"""No chunk begins while so many bytes are under way."""

RESEND_S = 2.0
"""If a block gets no answer for this long while both consumers are alive, its unanswered chunks are sent again."""

Key = tuple[int, int]
"""A chunk of the sweep: (block, chunk)."""


@dataclass
class _Sent:
    messages: Mapping[str, Buffer]
    size: int
    receipted: bool = False
    judged: bool = False


class Window:
    """The unanswered chunks of one simulator, oldest first.

    Parameters
    ----------
    limit
        Chunks under way at most.
    """

    def __init__(self, limit: int = LIMIT) -> None:
        self.limit = limit
        self._sent: dict[Key, _Sent] = {}
        self._quiet_since: dict[int, float] = {}

    def __len__(self) -> int:
        return len(self._sent)

    @property
    def full(self) -> bool:
        """Whether the next chunk has to wait."""
        return len(self._sent) >= self.limit or sum(entry.size for entry in self._sent.values()) >= LIMIT_BYTES

    def sent(self, key: Key, messages: Mapping[str, Buffer], now: float, recorded: bool = True) -> None:
        """Note that a chunk is published at `now` (seconds), by topic; `recorded`: its streams are stored."""
        self._quiet_since.setdefault(key[0], now)
        self._sent[key] = _Sent(messages, sum(map(len, messages.values())), receipted=not recorded)

    def answered(self, key: Key, now: float, *, receipted: bool = False, judged: bool = False) -> bool:
        """Note an answer; return whether the chunk is now answered by both consumers."""
        entry = self._sent.get(key)
        if entry is None:
            return False
        entry.receipted |= receipted
        entry.judged |= judged
        self._quiet_since[key[0]] = now
        if entry.receipted and entry.judged:
            del self._sent[key]
            if not any(block == key[0] for block, _ in self._sent):
                del self._quiet_since[key[0]]
            return True
        return False

    def drop(self, blocks: Iterable[int] | None = None) -> None:
        """Forget the chunks of `blocks`, or all, because nobody will answer them."""
        gone = None if blocks is None else set(blocks)
        self._sent = {key: entry for key, entry in self._sent.items() if gone is not None and key[0] not in gone}
        self._quiet_since = {key[0]: self._quiet_since[key[0]] for key in self._sent}

    def overdue(self, now: float) -> list[Mapping[str, Buffer]]:
        """Return the messages to publish again, in order: all of each block without answers for `RESEND_S`."""
        quiet = {block for block, since in self._quiet_since.items() if now - since >= RESEND_S}
        self._quiet_since.update(dict.fromkeys(quiet, now))
        return [entry.messages for key, entry in self._sent.items() if key[0] in quiet]
