"""A whole sweep in this process, without DDS: real ledger, recorder and classifier, simulators from a table.

It writes the files that `bow sweep` writes, can be interrupted after any chunk, and resumed. A snapshot of its files is
what a copy made at that moment would contain.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import recording

from bow_classifier.stream import Classifier
from bow_sim.protocol import cdr
from bow_sim.protocol.blocks import Blocks
from bow_sim.protocol.states import BlockState, PlanState, ReceiptKind
from bow_sweep.coordinator.results import basin_of, map_of, playability_of
from bow_sweep.coordinator.resume import resume
from bow_sweep.maps.basin_map import Basin
from bow_sweep.maps.map_file import MAP, write_map_npz
from bow_sweep.plan.sweep import Sweep
from bow_sweep.record.session import Session
from bow_sweep.run.directory import PICTURE, Run
from bow_sweep.run.ledger import (
    Dispatch,
    Event,
    Finished,
    Grown,
    Judged,
    OnDisk,
    Receipted,
    Record,
    SimulatorReady,
    State,
)

STATES = {State.DONE: BlockState.DONE, State.QUARANTINED: BlockState.QUARANTINED}
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
    cut_after
        Chunks after which all processes are killed; None: never.
    on_chunk
        Called after each chunk that was committed.
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
        self.basin = Basin(sweep.x.count, sweep.y.count, sweep.chunks)
        if again:
            self.of, recorded = resume(directory, self.log.append)
            if recorded is not None:
                self.basin = basin_of(recorded, sweep)
        else:
            self.of = Run.create(directory, recording.RUN, sweep)
        self.session: Session | None = None
        self.session_survives = False
        self.sync = sync
        self.classifier = Classifier("c" * 16)
        self.out: list[Dispatch] = []

    def run(self) -> None:
        """Run the sweep to its end, or to the interruption."""
        ledger = self.of.ledger
        try:
            if ledger.finished and not self._next_round():
                self._conclude()
                return
            self._announce(PlanState.OPEN)
            self._handle(SimulatorReady("s"))
            while not ledger.finished:
                dispatch = self.out.pop(0)
                self._compute(dispatch.block, dispatch.attempt)
                self._handle(Finished("s", dispatch.block, dispatch.attempt))
                if ledger.finished:
                    self._next_round()
            self._conclude()
        except Cut:
            assert self.session is not None
            if not self.session_survives:
                self.session.abandon()
        finally:
            self.of.close()

    def _next_round(self) -> bool:
        if not self.of.next_round(self.basin):
            return False
        self._announce(PlanState.OPEN)
        self._handle(Grown(self.of.blocks.count))
        return True

    def _announce(self, state: int) -> None:
        run = self.of
        data = recording.plan(
            self.sweep,
            state,
            run.ledger.epoch,
            np.array([STATES.get(block.state, 0) for block in run.ledger.blocks], np.uint8),
            run.run_id,
            run.blocks.announce(),
        )
        plan = cdr.decode("Plan", data)
        if self.session is None:
            options: dict[str, Any] = {"sync": self.sync}
            names = recording.NAMES
            self.session = Session(self.directory, plan, data, names, "7" * 16, time.time_ns(), **options)
        else:
            self.session.plan(plan, data, time.time_ns())
        self.classifier.plan(data)

    def _compute(self, block: int, attempt: int) -> None:
        assert self.session is not None
        for force, slip in streams(self.sweep, block, self.of.blocks, self.of.run_id):
            for topic, name, data in (("bridge_force", "BridgeForce", force), ("stick_slip", "StickSlip", slip)):
                message = with_attempt(name, data, attempt)
                self.session.take(topic, message, time.time_ns())
                for verdicts in self.classifier.take(name, message):
                    self.session.take("verdicts", verdicts, time.time_ns())
                    values = cdr.unseal("Verdicts", verdicts)
                    self.basin.take(values["chunk"], values["cells"], values)
                    judged = Judged(block, values["chunk"], values["chunk_checksum"], values["checksum"])
                    self._handle(judged)
            self._commit()
            self.on_chunk()
            if self.cut_after is not None:
                self.cut_after -= 1
                if self.cut_after < 0:
                    raise Cut
        while self.sync and self.of.ledger.blocks[block].state is State.DISPATCHED:
            time.sleep(0.005)
            self._commit()

    def _commit(self) -> None:
        assert self.session is not None
        data = self.session.commit(time.time_ns())
        if data is None:
            return
        receipt = cdr.decode("Receipt", data)
        for kind, block, chunk, checksum in zip(
            *(receipt[name].tolist() for name in ("kind", "block", "chunk", "checksum")), strict=True
        ):
            if kind == ReceiptKind.BLOCK:
                self._handle(OnDisk(block))
            else:
                self._handle(Receipted(block, chunk, checksum, kind == ReceiptKind.VERDICTS))

    def _handle(self, event: Event) -> None:
        instructions = self.of.ledger.handle(event, 0.0)
        self.of.record(item.entry for item in instructions if isinstance(item, Record))
        self.out += [item for item in instructions if isinstance(item, Dispatch)]

    def _conclude(self) -> None:
        self._announce(PlanState.CLOSED)
        assert self.session is not None
        self.session.close(time.time_ns())
        write_map_npz(self.directory / MAP, map_of(self.of, self.basin))
        (self.directory / PICTURE).write_bytes(PIXEL)
        self.of.report(self.basin, 1.0, {"playability": playability_of(self.of, self.basin)})


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
