"""The events that the ledger takes in, and the instructions that it answers with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, NamedTuple

from bow_sim.protocol.states import ReceiptKind


class State(Enum):
    """What has become of a block."""

    DUE = "due"
    DISPATCHED = "dispatched"
    DONE = "done"
    QUARANTINED = "quarantined"


# ---- events


@dataclass(frozen=True)
class SimulatorReady:
    """A simulator of a station takes blocks, for the first time or again."""

    simulator: str
    station: str = ""


@dataclass(frozen=True)
class SimulatorLost:
    """A simulator takes no more blocks; `blame`: the block that it was computing may be the cause."""

    simulator: str
    why: str
    blame: bool = True


@dataclass(frozen=True)
class SimulatorReturned:
    """A simulator that was lost because it was silent is heard again: its block was not the cause."""

    simulator: str


@dataclass(frozen=True)
class Finished:
    """A simulator has published all messages of a block."""

    simulator: str
    block: int
    attempt: int


@dataclass(frozen=True)
class Refused:
    """A simulator does not compute a block that was sent to it."""

    simulator: str
    block: int
    attempt: int
    why: str


@dataclass(frozen=True)
class ConsumerRestarted:
    """Recorder or classifier of a station has a new incarnation: its unfinished blocks must be sent again."""

    role: str
    station: str = ""


class Judged(NamedTuple):
    """A classifier's verdicts on a chunk have arrived; `chunk_checksum` is that of the streams it judged."""

    block: int
    chunk: int
    chunk_checksum: int
    checksum: int
    station: str = ""


class Receipted(NamedTuple):
    """A recorder has written a chunk's streams (`verdicts` False) or the verdicts on it (True) to its file."""

    block: int
    chunk: int
    checksum: int
    verdicts: bool
    station: str = ""


class OnDisk(NamedTuple):
    """All of a block, streams and verdicts, has been synced to the disk."""

    block: int
    station: str = ""


@dataclass(frozen=True)
class StationLost:
    """The recorder or classifier of a station has gone: blocks that its simulators have finished get no answers."""

    station: str


@dataclass(frozen=True)
class Grown:
    """Another round of an adaptive sweep is planned: there are `blocks` in all now."""

    blocks: int


@dataclass(frozen=True)
class Tick:
    """Time has passed."""


AnswerEvent = Judged | Receipted | OnDisk
"""The events of which there are thousands in a second; tuples are made faster."""

Event = (
    SimulatorReady
    | SimulatorLost
    | SimulatorReturned
    | Finished
    | Refused
    | ConsumerRestarted
    | AnswerEvent
    | StationLost
    | Grown
    | Tick
)


def receipted(kind: int, block: int, chunk: int, checksum: int, station: str = "") -> AnswerEvent:
    """Return the event for one entry of a Receipt of a station's recorder; `kind` is a ReceiptKind."""
    if kind == ReceiptKind.BLOCK:
        return OnDisk(block, station)
    return Receipted(block, chunk, checksum, kind == ReceiptKind.VERDICTS, station)


# ---- instructions, to be carried out in order


@dataclass(frozen=True)
class Record:
    """Append an entry to the ledger's file and sync it to the disk before the next instruction."""

    entry: Mapping[str, Any]


@dataclass(frozen=True)
class Dispatch:
    """Send a block to a simulator."""

    block: int
    attempt: int
    simulator: str


@dataclass(frozen=True)
class NewEpoch:
    """Announce a new epoch of the run: blocks sent in an older one are void."""

    epoch: int


@dataclass(frozen=True)
class Settled:
    """A block is done or quarantined."""

    block: int
    state: State
    why: str = ""


Instruction = Record | Dispatch | NewEpoch | Settled
