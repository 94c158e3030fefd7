"""The constants of Plan, Health and Receipt, as their .msg files name them."""

from __future__ import annotations

from enum import IntEnum

ONE_AT_A_TIME = "one sweep at a time"
"""How the message of a result of RunSweep ends, where the goal is refused because of another sweep: try again."""


class PlanState(IntEnum):
    """Plan.state."""

    OPEN = 1
    CLOSED = 2


class BlockState(IntEnum):
    """Plan.block_states."""

    OUTSTANDING = 0
    DONE = 1
    QUARANTINED = 2


class NodeState(IntEnum):
    """Health.state."""

    STARTING = 0
    READY = 1
    BUSY = 2
    CLOSED = 3
    DEAD = 4
    FAILED = 5


NODE_STATE_NAMES = {int(state): state.name.lower() for state in NodeState}
"""Health.state in words; a message may have another number."""


class ReceiptKind(IntEnum):
    """Receipt.kind: what was recorded."""

    STREAMS = 0  # both stream messages of a chunk
    VERDICTS = 1  # the verdicts on a chunk
    BLOCK = 2  # all of a block, synced to disk
