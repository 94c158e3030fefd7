"""A whole sweep in this process, without DDS: real coordinator, recorder and classifier, simulator from a table.

It writes the files that `bow sweep` writes, can be interrupted after any chunk, and resumed. A snapshot of its files is
what a copy made at that moment would contain.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import recording
from coordinator_world import Node

from bow_classifier.stream import Classifier
from bow_sim.protocol import cdr
from bow_sim.protocol.blocks import Blocks
from bow_sim.protocol.neighbours import Neighbours
from bow_sim.protocol.states import NodeState, PlanState
from bow_sweep.coordinator.results import map_of, playability_of
from bow_sweep.coordinator.resume import resume
from bow_sweep.coordinator.session import CoordinatorSession
from bow_sweep.coordinator.session_events import (
    Event,
    HealthReceived,
    Publish,
    ReceiptReceived,
    ResultsWritten,
    RunGiven,
    VerdictsReceived,
    WriteResults,
)
from bow_sweep.maps.map_file import MAP, write_map_npz
from bow_sweep.plan.sweep import Sweep
from bow_sweep.record.session import Session
from bow_sweep.run.directory import PICTURE, Run
from bow_sweep.run.ledger import State

COORDINATOR = "c" * 16

Snapshot = dict[str, bytes]
"""Path in the run directory -> content."""

PIXEL = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010806000000"
    "1f15c4890000000d49444154789c6360606060000000050001a5f645400000000049454e44ae426082"
)
"""A picture: drawing the map would take longer than all the rest."""


class Cut(Exception):
    """All processes of the graph are killed here."""


class SmallGraph:
    """One sweep in a directory; :meth:`run` it to its end or to an interruption.

    Parameters
    ----------
    again
        Resume the run that is there.
    cut_after
        Chunks after which all processes are killed; None: never.
    on_chunk
        Called after each chunk that was committed.
    sync
        Sync the bag to the disk as the recorder does.
    """

    def __init__(
        self,
        directory: Path,
        sweep: Sweep,
        again: bool = False,
        cut_after: int | None = None,
        on_chunk: Callable[[], None] = lambda: None,
        sync: bool = False,
    ) -> None:
        self.directory, self.sweep, self.cut_after, self.on_chunk = directory, sweep, cut_after, on_chunk
        self.log: list[str] = []
        create = lambda sweep, _goal=b"": RunGiven(Run.create(directory, recording.RUN, sweep))
        self.given = RunGiven(*resume(directory, self.log.append)) if again else create(sweep)
        self.seconds = itertools.count()
        self.neighbours = Neighbours(COORDINATOR, "here")
        self.coordinator = CoordinatorSession(
            COORDINATOR, "here", "/bow", self.neighbours, create, lambda: float(next(self.seconds))
        )
        self.session: Session | None = None
        self.session_survives = False
        self.sync = sync
        self.classifier = Classifier("d" * 16)
        roles = ("recorder", "classifier", "simulator")
        self.nodes = {
            role: Node(role, f"/bow/{role}", f"a{pid:015}", pid, NodeState.READY, self.given.run.run_id)
            for pid, role in enumerate(roles)
        }
        self.closed = False

    def run(self) -> None:
        """Run the sweep to its end, or to the interruption."""
        try:
            self._handle(self.given)
            while (run := self.coordinator.run) is not None:
                if self.closed:
                    assert self.session is not None
                    self.session.close(time.time_ns())
                    self.nodes["recorder"].state = NodeState.CLOSED
                held = self.nodes["simulator"].held
                reported = held[:1]
                self._beat()
                for block, attempt in reported:
                    self._compute(run, block, attempt)
                    del held[0]
        except Cut:
            assert self.session is not None
            if not self.session_survives:
                self.session.abandon()
        finally:
            self.coordinator.close()

    def _beat(self) -> None:
        for node in self.nodes.values():
            message = node.health(COORDINATOR)
            self._handle(HealthReceived(message, self.neighbours.take(message, 0.0)))

    def _handle(self, event: Event) -> None:
        for instruction in self.coordinator.handle(event, 0.0):
            match instruction:
                case Publish("plan", data):
                    self._take_plan(data)
                case Publish("blocks", data):
                    block = cdr.decode("Block", data)
                    self.nodes["simulator"].held.append((block["block"], block["attempt"]))
                case WriteResults(run, basin):
                    write_map_npz(self.directory / MAP, map_of(run, basin))
                    (self.directory / PICTURE).write_bytes(PIXEL)
                    self._handle(ResultsWritten(playability_of(run, basin)))

    def _take_plan(self, data: bytes) -> None:
        plan = cdr.decode("Plan", data)
        if self.session is None:
            options: dict[str, Any] = {"sync": self.sync}
            self.session = Session(self.directory, plan, data, "7" * 16, time.time_ns(), **options)
        else:
            self.session.plan(plan, data, time.time_ns())
        self.classifier.plan(data)
        self.closed = plan["state"] == PlanState.CLOSED

    def _compute(self, run: Run, block: int, attempt: int) -> None:
        assert self.session is not None
        for force, slip in streams(self.sweep, block, run.blocks, run.run_id):
            for topic, name, data in (("bridge_force", "BridgeForce", force), ("stick_slip", "StickSlip", slip)):
                message = with_attempt(name, data, attempt)
                self.session.take(topic, message, time.time_ns())
                for verdicts in self.classifier.take(name, message):
                    self.session.take("verdicts", verdicts, time.time_ns())
                    self._handle(VerdictsReceived(verdicts))
            self._commit()
            self.on_chunk()
            if self.cut_after is not None:
                self.cut_after -= 1
                if self.cut_after < 0:
                    raise Cut
        while self.sync and run.ledger.blocks[block].state is State.DISPATCHED:
            time.sleep(0.005)
            self._commit()

    def _commit(self) -> None:
        assert self.session is not None
        data = self.session.commit(time.time_ns())
        if data is not None:
            self._handle(ReceiptReceived(data))


def streams(sweep: Sweep, block: int, blocks: Blocks, run: str) -> tuple[tuple[bytes, bytes], ...]:
    """Return what a simulator publishes of a block, (bridge force, stick/slip) of each chunk."""
    key = (id(sweep), block, blocks.block(block).tobytes(), run)
    if key not in _TABLE:
        chunks = recording.chunks(sweep, block, 1, run, blocks)
        _TABLE[key] = tuple((chunk.bridge_force, chunk.stick_slip) for chunk in chunks)
    return _TABLE[key]


_TABLE: dict[Any, tuple[tuple[bytes, bytes], ...]] = {}


def with_attempt(name: str, data: bytes, attempt: int) -> bytes:
    """Return a message as another attempt would give it."""
    return data if attempt == 1 else cdr.encode(name, {**cdr.decode(name, data), "attempt": attempt})


def snapshot(directory: Path) -> Snapshot:
    """Return all files of a run directory but its locks."""
    return {
        str(path.relative_to(directory)): path.read_bytes()
        for path in sorted(directory.rglob("*"))
        if path.is_file() and not path.name.endswith(".lock")
    }


def restore(directory: Path, files: Snapshot) -> None:
    """Write files into a new run directory."""
    (directory / "bag").mkdir(parents=True)
    for name, content in files.items():
        (directory / name).write_bytes(content)
