"""A graph around a coordinator's session, in one process and without ROS, that checks every instruction."""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from bow_sim.protocol import cdr
from bow_sim.protocol.identity import random_id
from bow_sim.protocol.neighbours import CONSUMERS, SILENT_S, Neighbours
from bow_sim.protocol.states import BlockState, NodeState, PlanState
from bow_sweep.coordinator.closing import CLOSE_S
from bow_sweep.coordinator.session import CoordinatorSession
from bow_sweep.coordinator.session_events import (
    AnswerGoal,
    Event,
    HealthReceived,
    Instruction,
    Publish,
    PublishFeedback,
    PublishMap,
    ResultsWritten,
    RunEnded,
    RunGiven,
    SetState,
    WriteResults,
)
from bow_sweep.plan.sweep import Sweep
from bow_sweep.run.directory import LEDGER, REPORT, Run

SHARED_MEMORY = Path("/dev/shm")
"""Here a file is synced at once."""

WORKING = (NodeState.READY, NodeState.BUSY)
ENDED = (NodeState.CLOSED, NodeState.FAILED)


@dataclass
class Node:
    """Another node of the graph, as it is itself; what the coordinator knows of it is in its heartbeats."""

    role: str
    name: str
    incarnation: str
    pid: int
    state: int = NodeState.STARTING
    run_id: str = ""
    held: list[tuple[int, int]] = field(default_factory=list)
    number: int = 0
    heard_at: float = -1e9

    def health(self, coordinator: str, refused: tuple[tuple[int, int], ...] = (), **changes: Any) -> Any:
        self.number += 1
        values = {"role": self.role, "node": self.name, "incarnation": self.incarnation, "pid": self.pid}
        values |= {"host": "there", "started": SimpleNamespace(sec=1, nanosec=0), "number": self.number, "detail": ""}
        values |= {"state": self.state, "run_id": self.run_id, "hears": [f"{coordinator} blocks health"]}
        for name, attempts in (("held", self.held), ("refused", refused)):
            values |= {f"{name}_blocks": [a[0] for a in attempts], f"{name}_attempts": [a[1] for a in attempts]}
        return SimpleNamespace(**{**values, **changes})


class World:
    """A session, and a graph around it that checks every instruction."""

    def __init__(self) -> None:
        self.directory = Path(tempfile.mkdtemp(dir=SHARED_MEMORY if SHARED_MEMORY.is_dir() else None))
        self.now, self.born = 100.0, 0
        self.slow_results = False
        self.goals: dict[bytes, str] = {}  # not answered -> run, "" if it should fail
        self.cancelled: set[bytes] = set()
        self.ignored = 0
        self.begin_process()

    def begin_process(self) -> None:
        """Begin as a new process does: nothing is known of the others."""
        self.born += 1
        self.own = f"c{self.born:015}"
        self.neighbours = Neighbours(self.own, "here")
        self.session = CoordinatorSession(
            self.own, "here", "/bow", self.neighbours, self.create, lambda: self.now, shown=False
        )
        self.nodes: dict[str, Node] = {}
        self.chosen: dict[str, Node] = {}
        self.forget_run()

    def forget_run(self) -> None:
        self.plan: dict[str, Any] = {}
        self.states = np.zeros(0, np.uint8)
        self.sent: set[tuple[int, int]] = set()
        self.mail: list[dict[str, Any]] = []
        self.tests: set[tuple[int, int]] = set()  # cell, chunk
        self.to_write: WriteResults | None = None
        self.written = False
        self.closed_at = self.plan_at = 0.0
        self.goal: bytes | None = None

    def create(self, sweep: Sweep, _goal: bytes) -> RunGiven:
        identity = random_id()
        return RunGiven(Run.create(self.directory / identity, identity, sweep))

    # ---- events

    def do(self, *events: Event) -> None:
        """Have the session take in events together."""
        run = self.session.run
        joined = set(run.ledger.in_flight) if run else set()
        out = self.session.handle_all(events, self.now)
        if self.session.run is run and run is not None and set(run.ledger.in_flight) - joined:
            assert all(self.is_ready(role, run.run_id) for role in CONSUMERS), "simulators wait for both consumers"
        self.ignored += self.session.fetch_counts().ignored
        for instruction in out:
            self.carry_out(instruction)

    def is_alive(self, node: Node | None) -> bool:
        return node is not None and self.now - node.heard_at <= SILENT_S

    def is_ready(self, role: str, run_id: str) -> bool:
        node = self.chosen.get(role)
        known = self.neighbours.get(node.incarnation) if node else None
        return self.is_alive(node) and known is not None and known.run_id == run_id and known.state in WORKING

    def beat(self, node: Node, **changes: Any) -> None:
        """Deliver a heartbeat as BowNode does."""
        message = node.health(self.own, **changes)
        assert not self.neighbours.is_old(message)
        run = self.session.run
        epoch, is_open = (run.ledger.epoch, not self.is_closed) if run else (0, False)
        neighbour = self.neighbours.take(message, self.now)
        if neighbour is None:
            node.heard_at = -1e9
        replaced = False
        if node.role in CONSUMERS and neighbour is not None:
            chosen = self.chosen.get(node.role)
            replaced = chosen is not None and chosen is not node and not self.is_alive(chosen)
            if chosen is None or replaced:
                self.chosen[node.role] = node
            node.heard_at = self.now
        self.do(HealthReceived(message, neighbour))
        if run is not None and is_open:
            assert run.ledger.epoch == epoch + replaced

    # ---- instructions

    def carry_out(self, instruction: Instruction) -> None:
        match instruction:
            case Publish("plan", data):
                self.on_plan(cdr.decode("Plan", data))
            case Publish(_, data):
                self.on_block(cdr.decode("Block", data))
            case PublishMap(values):
                run = self.session.run
                assert run is not None
                assert values["run_id"] == run.run_id
                counts = [values[f"cells_{name}"] for name in ("done", "quarantined", "outstanding")]
                assert min(counts) >= 0
                assert sum(counts) <= run.sweep.cells
                cdr.encode("BasinMap", values)
            case PublishFeedback(goal, values):
                assert goal == self.goal
                assert values["cells_planned"] == sum(
                    values[f"cells_{name}"] for name in ("done", "quarantined", "outstanding")
                )
            case AnswerGoal(goal, values):
                assert values.get("run_id", "") == self.goals.pop(goal), "each goal is answered once, by its own run"
                assert values["message"]
            case WriteResults(run, _):
                assert run is self.session.run
                assert self.is_closed
                assert self.to_write is None and not self.written, "a run closes once"
                self.to_write = instruction
                if not self.slow_results:
                    self.write()
            case SetState(_, _, run_id):
                assert run_id in (None, "", self.session.run and self.session.run.run_id)
            case RunEnded():
                assert self.written
                assert self.bag_is_closed() or self.now - self.closed_at > CLOSE_S
                report = json.loads((self.directory / self.plan["run_id"] / REPORT).read_bytes())
                quarantined = np.flatnonzero(self.states == BlockState.QUARANTINED).tolist()
                assert sorted(map(int, report["quarantined_blocks"])) == quarantined
                assert self.session.run is None
                self.forget_run()

    def bag_is_closed(self) -> bool:
        """Return whether a recorder of this run, or one that never had a run, has reported that it is done."""
        heard = [node for node in self.session.nodes.values() if node.role == "recorder" and node.state in ENDED]
        return any(node.run_id in (self.plan["run_id"], "") for node in heard)

    def write(self) -> None:
        if self.to_write is not None:
            self.to_write, self.written = None, True
            self.do(ResultsWritten({}, "no picture" if self.born % 2 else ""))

    @property
    def is_closed(self) -> bool:
        return bool(self.plan) and self.plan["state"] == PlanState.CLOSED

    def on_plan(self, plan: dict[str, Any]) -> None:
        run = self.session.run
        assert run is not None
        assert (plan["run_id"], plan["sweep_id"]) == (run.run_id, run.sweep.sweep_id)
        assert plan["incarnation"] == self.own
        assert not self.is_closed, "a closed plan is the last one"
        assert plan["epoch"] >= self.plan.get("epoch", 0)
        before, after = self.states, plan["block_states"]
        assert len(after) >= len(before)
        kept = before != BlockState.OUTSTANDING
        assert np.array_equal(after[: len(before)][kept], before[kept]), "what is settled stays settled"
        self.plan, self.states, self.plan_at = plan, after, self.now
        if self.is_closed:
            self.closed_at = self.now
            if self.goal not in self.cancelled:
                assert (after != BlockState.OUTSTANDING).all()
                assert run.ledger.finished
                length = np.where(run.done(), self.session._active.basin.transient_periods, np.nan)
                assert run.sweep.more_blocks(run.blocks, length) is None, "no round is left"

    def on_block(self, values: dict[str, Any]) -> None:
        run = self.session.run
        assert run is not None
        assert (values["run_id"], values["sweep_id"], values["epoch"]) == (
            run.run_id,
            run.sweep.sweep_id,
            run.ledger.epoch,
        )
        assert values["epoch"] == self.plan["epoch"], "a new epoch is announced before its blocks"
        assert values["coordinator"] == self.own
        if not len(values["cells"]):
            return
        assert not self.is_closed
        assert values["block"] < len(self.states), "a round is announced before its blocks"
        key = (values["block"], values["attempt"])
        assert key not in self.sent
        self.sent.add(key)
        entry = f'"dispatched", "block": {key[0]}, "attempt": {key[1]},'
        assert entry in (run.directory / LEDGER).read_text(), "the ledger's file first"
        known = self.neighbours.get(values["simulator"])
        assert known is not None
        assert (known.run_id, known.state in WORKING) == (run.run_id, True)
        assert np.array_equal(values["cells"], run.blocks.block(key[0]))
        self.mail.append(values)


def verdicts(run: Run, block: int, chunk: int, **changes: Any) -> bytes:
    """Return the verdicts of a classifier on a chunk: the same whenever they are asked for."""
    cells = run.blocks.block(block) if block < run.blocks.count else np.arange(3)
    values = {"run_id": run.run_id, "sweep_id": run.sweep.sweep_id, "block": block, "chunk": chunk, "attempt": 1}
    values |= {"incarnation": "d" * 16, "chunk_checksum": 7, "classifier": run.sweep.thresholds.hash, "cells": cells}
    values |= changes
    cells = np.asarray(values["cells"])
    values |= dict.fromkeys(("correlation", "period", "slips", "corners", "confidence"), np.ones(len(cells)))
    values |= dict.fromkeys(("beat", "transient"), np.full(len(cells), np.nan))
    return cdr.encode("Verdicts", {**values, "regime": cells % 3})


def receipt(run: Run, entries: list[tuple[int, int, int, int]], **changes: Any) -> bytes:
    """Return a receipt with entries (kind, block, chunk, checksum)."""
    columns = dict(zip(("kind", "block", "chunk", "checksum"), zip(*entries, strict=True), strict=True))
    values = {"run_id": run.run_id, "sweep_id": run.sweep.sweep_id, "incarnation": "e" * 16, **columns}
    return cdr.encode("Receipt", {**values, "attempt": [1] * len(entries), **changes})
