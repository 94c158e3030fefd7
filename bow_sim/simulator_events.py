"""Events and instructions of :class:`bow_sim.simulator_session.SimulatorSession`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bow_sim.block_request import BlockRequest
from bow_sim.protocol.cdr import Buffer
from bow_sim.protocol.states import NodeState

Messages = Mapping[str, Buffer]
"""Topic -> the message to publish on it: bridge_force and stick_slip of a chunk, its verdicts, or all three."""

# ---- events: what the others send


@dataclass(frozen=True)
class PlanReceived:
    """A decoded Plan of the coordinator in charge, see :class:`bow_sim.protocol.authority.Authority`."""

    plan: Mapping[str, Any]


@dataclass(frozen=True)
class BlockReceived:
    """A decoded Block, from any sender and for any simulator."""

    message: Mapping[str, Any]


@dataclass(frozen=True)
class ReceiptReceived:
    """A decoded Receipt, from any sender."""

    receipt: Mapping[str, Any]


@dataclass(frozen=True)
class ReadersChecked:
    """The heartbeats of the consumers were evaluated; to be reported several times a second."""

    missing: tuple[str, ...]
    """What keeps consumers of this run from receiving the streams, in words; empty if they do."""
    consumers_alive: bool
    """Whether recorder and classifier of this run are both alive."""


# ---- events: what the worker has done


@dataclass(frozen=True)
class ChunkComputed:
    """The chunk of the last :class:`ComputeChunk`, encoded."""

    messages: Messages
    inspect: tuple[Buffer, ...] = ()
    """InspectedCell of each inspected cell of the block."""


@dataclass(frozen=True)
class ChunkFailed:
    """The kernel raised an error."""

    request: BlockRequest
    why: str


@dataclass(frozen=True)
class Published:
    """A :class:`Publish` was carried out."""

    instruction: Publish
    failed: bool
    """Whether the middleware reported an error: a subscriber hangs, or is just ending."""


@dataclass(frozen=True)
class WorkerIdle:
    """The worker has had nothing to do for a while."""


Event = (
    PlanReceived
    | BlockReceived
    | ReceiptReceived
    | ReadersChecked
    | ChunkComputed
    | ChunkFailed
    | Published
    | WorkerIdle
)

# ---- instructions for the worker


@dataclass(frozen=True)
class ComputeChunk:
    """Compute the next chunk of a block; answered by ChunkComputed or ChunkFailed."""

    request: BlockRequest
    chunk: int


@dataclass(frozen=True)
class Publish:
    """Publish a message on each of some topics; answered by Published."""

    messages: Messages
    inspect: tuple[Buffer, ...] = ()
    of: BlockRequest | None = None
    """The block, where its next chunk is published for the first time."""
    again: bool = False
    """Whether the messages were published before."""


# ---- instructions for the node


@dataclass(frozen=True)
class SetState:
    """Publish another state in the heartbeat."""

    state: NodeState
    detail: str
    run_id: str


@dataclass(frozen=True)
class Report:
    """Publish a heartbeat at once: blocks held or refused have changed."""

    state: NodeState
    detail: str
    held: tuple[tuple[int, int], ...]
    """Pairs of block and attempt."""
    refused: tuple[tuple[int, int], ...]
    """Pairs of block and attempt: the latest."""


@dataclass(frozen=True)
class RecreatePublishers:
    """Destroy the publishers of chunks and create new ones: DDS does not release a reader that has gone."""


@dataclass(frozen=True)
class Ignore:
    """Count a message as ignored."""

    why: str


@dataclass(frozen=True)
class Log:
    """Write a warning, or if `severe` an error."""

    text: str
    severe: bool = False


Instruction = ComputeChunk | Publish | SetState | Report | RecreatePublishers | Ignore | Log
