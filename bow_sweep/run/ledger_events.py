"""What the ledger hears and what it answers: events, which carry the time in seconds, and instructions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

from bow_sim.protocol.states import ReceiptKind


class State(Enum):
    """Where a block is."""

    DUE = "due"
    DISPATCHED = "dispatched"
    DONE = "done"
    QUARANTINED = "quarantined"


# ---- events


@dataclass(frozen=True)
class SimulatorReady:
    """A simulator takes goals (again)."""

    simulator: str


@dataclass(frozen=True)
class SimulatorLost:
    """A simulator is gone. `blame` is False where we stopped it ourselves: then no block is suspect."""

    simulator: str
    why: str
    blame: bool = True


@dataclass(frozen=True)
class Finished:
    """A simulator has published all of a block."""

    simulator: str
    block: int
    attempt: int


@dataclass(frozen=True)
class Refused:
    """A simulator rejected, cancelled or aborted a goal."""

    simulator: str
    block: int
    attempt: int
    why: str


@dataclass(frozen=True)
class ConsumerRestarted:
    """The recorder or the classifier has a new incarnation: what it has not finished must be sent again."""

    role: str


@dataclass(frozen=True)
class Judged:
    """The classifier's verdicts on a chunk arrived."""

    block: int
    chunk: int
    chunk_checksum: int
    checksum: int


@dataclass(frozen=True)
class Receipted:
    """The recorder has a chunk's streams (`verdicts` False) or the verdicts on it (True) in its file."""

    block: int
    chunk: int
    checksum: int
    verdicts: bool


@dataclass(frozen=True)
class OnDisk:
    """The recorder has seen all of a block, streams and verdicts, on the disk."""

    block: int


@dataclass(frozen=True)
class Grown:
    """The plan has more blocks now, `blocks` in all: an adaptive sweep goes on."""

    blocks: int


@dataclass(frozen=True)
class Tick:
    """Time has passed."""


Event = (
    SimulatorReady | SimulatorLost | Finished | Refused | ConsumerRestarted | Judged | Receipted | OnDisk | Grown | Tick
)


def receipted(kind: int, block: int, chunk: int, checksum: int) -> Event:
    """Return the event that an entry of a receipt is, `kind` as the message has it."""
    return (
        OnDisk(block) if kind == ReceiptKind.BLOCK else Receipted(block, chunk, checksum, kind == ReceiptKind.VERDICTS)
    )


# ---- instructions, to be carried out in order


@dataclass(frozen=True)
class Record:
    """Append to the ledger file and see it on disk before going on."""

    entry: Mapping[str, Any]


@dataclass(frozen=True)
class Dispatch:
    """Send a block to a simulator."""

    block: int
    attempt: int
    simulator: str


@dataclass(frozen=True)
class NewEpoch:
    """Tell everybody that goals of older epochs are void."""

    epoch: int


@dataclass(frozen=True)
class Settled:
    """A block is done or quarantined."""

    block: int
    state: State
    why: str = ""


Instruction = Record | Dispatch | NewEpoch | Settled
