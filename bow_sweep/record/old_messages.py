"""Messages in bags from before version 3 of the record, as those of today: what they lack is put in front of them.

Until then streams and verdicts began with their identity; now a stamp or a header comes first. Both are multiples of
eight bytes, so nothing after them moves to another alignment, and what a checksum covers stays as it is. Which of the
two a message is can be seen from the definition of its type, which every bag has.
"""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import TYPE_CHECKING

from bow_sim.protocol.cdr import ENCAPSULATION, Buffer
from bow_sim.protocol.messages import FRAME

if TYPE_CHECKING:
    from mcap.records import Schema

_STAMP = bytes(8)
_HEADER = _STAMP + struct.pack("<I", len(FRAME) + 1) + FRAME.encode() + b"\0"

_LACKING = {
    "bow_msgs/msg/BridgeForce": _STAMP,
    "bow_msgs/msg/StickSlip": _HEADER,
    "bow_msgs/msg/Verdicts": _HEADER,
}
_FIRST = b"run_id"
"""First field of these messages before version 3."""

OLD_TYPES = {"inspect": "bow_msgs/msg/BridgeForce"}
"""Topic -> its type before version 3, where that was another one."""


def lacks(schema: Schema | None) -> bytes:
    """Return what has to be put in front of the messages of a type; nothing, if they are those of today."""
    if schema is None or schema.name not in _LACKING:
        return b""
    return _LACKING[schema.name] if _first_field(schema.data) == _FIRST else b""


@lru_cache
def _first_field(definition: bytes) -> bytes:
    """Return the name of the first field in the text of a message definition; constants are not fields."""
    for line in definition.splitlines():
        words = line.partition(b"#")[0].split()
        if len(words) == 2 and b"=" not in words[1]:
            return words[1]
    return b""


def complete(data: Buffer, lacking: bytes) -> Buffer:
    """Return a message with what :func:`lacks` says; the message itself where that is nothing."""
    return b"".join((ENCAPSULATION, lacking, memoryview(data)[len(ENCAPSULATION) :])) if lacking else data
