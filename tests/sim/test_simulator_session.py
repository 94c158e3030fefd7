"""The simulator's session: whatever arrives, in whatever order, blocks and chunks are accounted for.

:class:`Sessions` throws plans, blocks, receipts and reports of the worker at a session: in any order, twice, late, from
strangers, of other runs and epochs. It holds

* at most two blocks that somebody waits for are held;
* a block is accepted if and only if it is addressed to this simulator by the coordinator in charge, belongs to the run
  and epoch in progress, asks for this kernel, can be computed and fits;
* every accepted block ends exactly once, complete or refused, and nothing of it is computed or published after that;
* a block is complete when each of its chunks was published once, in order;
* nothing is computed or published of a block that is void: of another run, an older epoch, or settled;
* never are more chunks under way than the credit;
* what is unanswered is sent again while both consumers are alive, never after it was answered or settled, and never
  while the worker has other work;
* a hello goes out only if nothing is under way, and only in a run;
* the simulator is ready only in a run whose consumers receive its streams;
* publishers are created again only after they failed.
"""

from __future__ import annotations

from collections import deque
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule

from bow_sim.block_request import BlockRequest
from bow_sim.kernel.fingerprint import fingerprint
from bow_sim.protocol import cdr
from bow_sim.protocol.authority import Authority
from bow_sim.protocol.flow_control import RESEND_S
from bow_sim.protocol.neighbours import DEAF_S, FIRST_HELLO_S, HELLO_S
from bow_sim.protocol.states import BlockState, NodeState, PlanState, ReceiptKind
from bow_sim.simulator_events import (
    BlockReceived,
    ChunkComputed,
    ChunkFailed,
    ComputeChunk,
    Event,
    Ignore,
    Instruction,
    Log,
    PlanReceived,
    Publish,
    Published,
    ReadersChecked,
    ReceiptReceived,
    RecreatePublishers,
    Report,
    SetState,
    WorkerIdle,
)
from bow_sim.simulator_session import NO_RUN, REFUSED, WORKING, SimulatorSession
from bow_sweep.plan.sweep import Sweep

OWN, COORDINATOR, STRANGER = "a" * 16, "c" * 16, "d" * 16
RUNS = [("r1", "s1"), ("r1", "s2"), ("r2", "s2")]
BLOCKS, CHUNKS = 4, 3
HELLO = tuple(cdr.hello(name, OWN) for name in ("BridgeForce", "StickSlip"))


def plan(run: tuple[str, str] = RUNS[0], epoch: int = 1, settled: Any = (), **changes: Any) -> dict[str, Any]:
    states = np.full(BLOCKS, BlockState.OUTSTANDING, np.uint8)
    states[list(settled)] = BlockState.DONE
    values = {"run_id": run[0], "sweep_id": run[1], "epoch": epoch, "state": PlanState.OPEN, "block_states": states}
    return {**values, "incarnation": COORDINATOR, **changes}


def block(number: int = 0, attempt: int = 1, run: tuple[str, str] = RUNS[0], **changes: Any) -> dict[str, Any]:
    values = {"run_id": run[0], "sweep_id": run[1], "coordinator": COORDINATOR, "simulator": OWN, "epoch": 1}
    return {**values, "fingerprint": "f", "block": number, "attempt": attempt, "cells": [number], **changes}


def receipt(entries: list[tuple[int, int, int]], run: tuple[str, str] = RUNS[0]) -> dict[str, Any]:
    """A Receipt with entries of block, chunk and kind."""
    columns = np.array(entries, np.uint32).reshape(-1, 3).T
    return {"run_id": run[0], "sweep_id": run[1], **dict(zip(("block", "chunk", "kind"), columns, strict=True))}


def request(message: dict[str, Any]) -> BlockRequest:
    """Stands in for bow_sim.block_request.prepare: no kernel."""
    if not message["cells"]:
        raise ValueError("cells: there should be some")
    return BlockRequest(message, SimpleNamespace(parameters=SimpleNamespace(chunks=CHUNKS)))  # type: ignore[arg-type]


def chunk_messages(instruction: ComputeChunk) -> tuple[bytes, ...]:
    return tuple(f"{name} {instruction.request.key} {instruction.chunk}".encode() for name in ("force", "slip"))


class Sessions(RuleBasedStateMachine):
    @initialize(credit=st.integers(1, 3))
    def start(self, credit: int) -> None:
        self.session = SimulatorSession(OWN, "f", lambda *who: who in self.living, credit, self.prepare)
        self.authority = Authority(lambda *who: who in self.living)
        self.living = {(COORDINATOR, run) for run, _ in RUNS}
        self.credit, self.now = credit, 0.0
        self.run, self.epoch, self.settled = NO_RUN, 0, set()
        self.held: list[BlockRequest] = []
        self.prepared: list[BlockRequest] = []
        self.published: dict[int, int] = {}  # id of a request -> chunks
        self.refused: list[tuple[int, int]] = []
        self.unanswered: dict[tuple[int, int], tuple[tuple[bytes, ...], set[int]]] = {}
        self.work: deque[ComputeChunk | Publish] = deque()
        self.seen: list[dict[str, Any]] = []
        self.alive = self.failed = self.readers_receive = False
        self.take_plan(plan())
        self.check_readers(True, True)

    def prepare(self, message: dict[str, Any]) -> BlockRequest:
        self.prepared.append(request(message))
        return self.prepared[-1]

    def is_void(self, held: BlockRequest) -> bool:
        message = held.message
        foreign = (message["run_id"], message["sweep_id"]) != self.run or message["epoch"] < self.epoch
        return foreign or message["block"] in self.settled

    def forget(self, blocks: set[int] | None = None) -> None:
        gone = [key for key in self.unanswered if blocks is None or key[0] in blocks]
        for key in gone:
            del self.unanswered[key]

    def enter(self, epoch: int) -> None:
        if epoch > self.epoch:
            self.epoch = epoch
            self.forget()

    def tell(self, event: Event) -> list[Instruction]:
        """Give the session an event and check what it answers."""
        before, rests = len(self.prepared), not self.work
        out = self.session.handle(event, self.now)
        self.held += self.prepared[before:]
        reports = [item for item in out if isinstance(item, Report)]
        assert len(reports) <= 1
        for item in reports:
            for held in [held for held in self.held if held.key not in item.held]:
                self.held.remove(held)
                if self.published.get(id(held), 0) < CHUNKS:
                    self.refused.append(held.key)
            assert list(item.held) == [held.key for held in self.held]
            assert list(item.refused) == self.refused[-REFUSED:]
            assert (item.state == NodeState.BUSY) == bool(item.held) or item.state not in WORKING
        for item in out:
            match item:
                case ComputeChunk(held, chunk):
                    assert not any(isinstance(known, ComputeChunk) or known.of for known in self.work)
                    assert held is self.held[0]
                    assert not self.is_void(held)
                    assert chunk == self.published.get(id(held), 0)
                case Publish(messages, of=held) if held is not None:
                    assert held is self.held[0]
                    assert not self.is_void(held)
                    key = held.key[0], self.published.get(id(held), 0)
                    assert messages == chunk_messages(ComputeChunk(held, key[1]))
                    assert len(self.unanswered) < self.credit
                    self.unanswered[key] = (messages, set())
                case Publish(messages, again=True):
                    assert self.alive
                    assert rests
                    assert messages in [sent for sent, _ in self.unanswered.values()]
                case Publish(messages):
                    assert messages == HELLO
                    assert not self.unanswered
                    assert self.run != NO_RUN
                case SetState(state):
                    assert state not in WORKING or self.readers_receive
                case RecreatePublishers():
                    assert self.failed
                    self.failed = False
            if isinstance(item, ComputeChunk | Publish):
                self.work.append(item)
        self.what_is_held_and_under_way_is_bounded()
        return out

    @rule(
        run=st.sampled_from(RUNS),
        epoch=st.integers(1, 3),
        settled=st.sets(st.integers(0, BLOCKS - 1), max_size=2),
        state=st.sampled_from([PlanState.OPEN] * 4 + [PlanState.CLOSED]),
        sender=st.sampled_from([COORDINATOR] * 3 + [STRANGER]),
    )
    def receive_any_plan(self, run: tuple[str, str], epoch: int, settled: set[int], state: int, sender: str) -> None:
        self.take_plan(plan(run, epoch, settled, state=state, incarnation=sender))

    @precondition(lambda self: self.run != NO_RUN)
    @rule(settled=st.sets(st.integers(0, BLOCKS - 1), max_size=2), answered=st.booleans(), later=st.booleans())
    def receive_plan_of_the_run(self, settled: set[int], answered: bool, later: bool) -> None:
        """Blocks settle, among them one under way if `answered`; or a newer epoch begins."""
        settled |= {number for number, _ in list(self.unanswered)[:answered]}
        self.take_plan(plan(self.run, self.epoch + later, settled))

    @precondition(lambda self: self.run != NO_RUN)
    @rule(run=st.sampled_from(RUNS), epoch=st.integers(1, 3), closes=st.booleans())
    def coordinator_begins_another_run(self, run: tuple[str, str], epoch: int, closes: bool) -> None:
        if closes:
            self.take_plan(plan(self.run, self.epoch, state=PlanState.CLOSED))
        self.living = {(COORDINATOR, run[0])}
        self.take_plan(plan(run, epoch))

    def take_plan(self, message: dict[str, Any]) -> None:
        self.seen.append(message)
        if self.authority.objection(message):
            return
        run = message["run_id"], message["sweep_id"]
        if run != self.run:
            self.run, self.epoch, self.readers_receive = run, 0, False
            self.forget()
        self.enter(message["epoch"])
        self.settled = set(np.flatnonzero(message["block_states"]).tolist())
        self.forget(self.settled)
        if message["state"] == PlanState.CLOSED:
            self.run, self.readers_receive = NO_RUN, False
            self.forget()
        self.tell(PlanReceived(message))

    @rule(
        number=st.integers(0, BLOCKS - 1),
        attempt=st.integers(1, 2),
        later=st.sampled_from([0, 1, -1]),
        run=st.sampled_from(RUNS),
        changes=st.sampled_from(
            [{}, {"coordinator": STRANGER}, {"simulator": STRANGER}, {"fingerprint": "g"}, {"cells": []}]
        ),
    )
    def receive_any_block(
        self, number: int, attempt: int, later: int, run: tuple[str, str], changes: dict[str, Any]
    ) -> None:
        self.take_block(block(number, attempt, run, epoch=self.epoch + later, **changes))

    @precondition(lambda self: self.run != NO_RUN)
    @rule(
        numbers=st.lists(st.integers(0, BLOCKS - 1), min_size=1, max_size=3),
        attempt=st.integers(1, 2),
        later=st.sampled_from([0, 0, 0, 0, 1]),
    )
    def receive_blocks_of_the_run(self, numbers: list[int], attempt: int, later: int) -> None:
        if not self.readers_receive:
            self.check_readers(True, True)
        for number in numbers:
            self.take_block(block(number, attempt, self.run, epoch=self.epoch + later))

    def take_block(self, message: dict[str, Any]) -> None:
        self.seen.append(message)
        key = message["block"], message["attempt"]
        obeyed = message["simulator"] == OWN and (message["coordinator"], message["run_id"]) in self.living
        obeyed &= key not in [held.key for held in self.held]
        waiting = [held for held in self.held if not self.is_void(held) and held.message["epoch"] >= message["epoch"]]
        fits = (
            self.session.state in WORKING
            and (message["run_id"], message["sweep_id"]) == self.run
            and message["epoch"] >= self.epoch
            and message["fingerprint"] == "f"
            and message["cells"]
            and len(waiting) < 2
        )
        accepted = bool(obeyed and fits)
        if accepted:
            self.enter(message["epoch"])
        elif obeyed:
            self.refused.append(key)
        before = len(self.prepared)
        out = self.tell(BlockReceived(message))
        assert len(self.prepared) - before == accepted
        assert not obeyed or any(isinstance(item, Report) for item in out)

    @precondition(lambda self: self.seen)
    @rule(data=st.data())
    def receive_again(self, data: st.DataObject) -> None:
        """A message of before comes once more, late or out of a bag."""
        message = data.draw(st.sampled_from(self.seen))
        if "block_states" in message:
            self.take_plan(message)
        elif "simulator" in message:
            self.take_block(message)
        else:
            self.take_receipt(message)

    @rule(
        keys=st.lists(st.tuples(st.integers(0, BLOCKS - 1), st.integers(0, CHUNKS), st.sampled_from(ReceiptKind))),
        unanswered=st.integers(0, 2),
        run=st.sampled_from([None, None, *RUNS]),
    )
    def receive_receipt(self, keys: list[tuple[int, int, int]], unanswered: int, run: tuple[str, str] | None) -> None:
        keys += [(*key, kind) for key in list(self.unanswered)[:unanswered] for kind in (0, 1)]
        self.take_receipt(receipt(keys, run or self.run))

    def take_receipt(self, message: dict[str, Any]) -> None:
        self.seen.append(message)
        if (message["run_id"], message["sweep_id"]) == self.run:
            for number, chunk, kind in zip(message["block"], message["chunk"], message["kind"], strict=True):
                entry = self.unanswered.get((number, chunk))
                if entry is not None and kind != ReceiptKind.BLOCK:
                    entry[1].add(int(kind))
                    if len(entry[1]) == 2:
                        del self.unanswered[number, chunk]
        self.tell(ReceiptReceived(message))

    @rule(receive=st.booleans(), alive=st.booleans())
    def check_readers(self, receive: bool, alive: bool) -> None:
        self.readers_receive, self.alive = receive, alive
        out = self.tell(ReadersChecked(() if receive else ("no recorder has taken up the run",), alive))
        if self.run != NO_RUN:
            assert (self.session.state in WORKING) == receive
        else:
            assert not out

    @rule(steps=st.integers(1, 8), fails=st.sampled_from([False, False, False, True]))
    def worker_goes_on(self, steps: int, fails: bool) -> None:
        for step in range(steps):
            if self.work:
                self.worker_does_its_next_work(fails and step == steps - 1)

    def worker_does_its_next_work(self, fails: bool) -> None:
        instruction = self.work.popleft()
        if isinstance(instruction, Publish):
            self.failed |= fails
            if instruction.of is not None:
                self.published[id(instruction.of)] = self.published.get(id(instruction.of), 0) + 1
            self.tell(Published(instruction, fails))
        elif fails:
            self.tell(ChunkFailed(instruction.request, "ZeroDivisionError()"))
        else:
            self.tell(ChunkComputed(chunk_messages(instruction)))

    @rule(seconds=st.sampled_from([0.1, 1.0, RESEND_S + 0.1]))
    def worker_is_idle(self, seconds: float) -> None:
        while self.work:
            self.worker_does_its_next_work(False)
        self.now += seconds
        out = self.tell(WorkerIdle())
        if seconds > RESEND_S and self.alive:  # nobody has answered in this time
            again = [item.messages for item in out if isinstance(item, Publish) and item.again]
            assert again == [sent for sent, _ in self.unanswered.values()]

    @rule(seconds=st.sampled_from([0.1, DEAF_S + 0.1]))
    def pass_time(self, seconds: float) -> None:
        self.now += seconds

    @rule(gone=st.sampled_from([set(), set(), {"r1"}, {"r1", "r2"}]))
    def coordinator_goes_or_is_back(self, gone: set[str]) -> None:
        self.living = {(COORDINATOR, run) for run, _ in RUNS if run not in gone}

    def what_is_held_and_under_way_is_bounded(self) -> None:
        assert [held.key for held in self.held] == self.session.held
        assert sum(not self.is_void(held) for held in self.held) <= 2
        assert all(not self.is_void(held) for held in self.held[1:])
        assert len(self.unanswered) == self.session.under_way <= self.credit

    def teardown(self) -> None:
        """With consumers that answer, whatever is held ends, and nothing stays under way."""
        if not hasattr(self, "session"):
            return
        self.check_readers(True, True)
        for _ in range(200):
            if self.work:
                self.worker_does_its_next_work(False)
            elif self.unanswered:
                self.take_receipt(receipt([(*key, kind) for key in self.unanswered for kind in (0, 1)], self.run))
        assert self.session.held == []
        assert self.session.under_way == 0


TestSessions = Sessions.TestCase
TestSessions.settings = settings(max_examples=100, stateful_step_count=40, deadline=None)


# ---- one statement each


@pytest.fixture
def session() -> SimulatorSession:
    """A session that is ready in the first of `RUNS`, epoch 1."""
    made = SimulatorSession(OWN, "f", lambda *_: True, credit=2, prepare=request)
    made.handle(PlanReceived(plan()), 0)
    made.handle(ReadersChecked((), consumers_alive=True), 0)
    assert made.state == NodeState.READY
    return made


def compute(session: SimulatorSession, out: list[Instruction], now: float = 0.0) -> list[Instruction]:
    """Do what a worker is told, until it is told nothing more; return all instructions."""
    done = []
    while out:
        done += out
        (item,) = [item for item in out if isinstance(item, ComputeChunk | Publish)] or [None]
        if isinstance(item, ComputeChunk):
            out = session.handle(ChunkComputed(chunk_messages(item)), now)
        elif isinstance(item, Publish):
            out = session.handle(Published(item, failed=False), now)
        else:
            break
    return done


def test_a_block_is_computed_as_far_as_credit_goes_and_to_its_end_when_it_is_answered(
    session: SimulatorSession,
) -> None:
    out = compute(session, session.handle(BlockReceived(block()), 0))
    assert [item.chunk for item in out if isinstance(item, ComputeChunk)] == [0, 1, 2]
    assert len([item for item in out if isinstance(item, Publish)]) == 2
    assert session.state == NodeState.BUSY
    out = compute(session, session.handle(ReceiptReceived(receipt([(0, 0, 0), (0, 0, 1)])), 0))
    assert len([item for item in out if isinstance(item, Publish)]) == 1
    assert isinstance(out[-1], Report)
    assert (out[-1].state, out[-1].held, out[-1].refused) == (NodeState.READY, (), ())


def test_a_settled_block_is_dropped_before_its_next_message(session: SimulatorSession) -> None:
    out = session.handle(BlockReceived(block()), 0)
    assert any(isinstance(item, ComputeChunk) for item in out)
    assert session.handle(PlanReceived(plan(settled=[0])), 0) == []  # the kernel is at it
    (report,) = session.handle(ChunkComputed((b"force", b"slip")), 0)
    assert isinstance(report, Report)
    assert (report.held, report.refused) == ((), ((0, 1),))


def test_hellos_are_frequent_until_the_streams_are_received_and_stop_while_chunks_are_under_way() -> None:
    session = SimulatorSession(OWN, "f", lambda *_: True, prepare=request)
    assert session.handle(WorkerIdle(), 0) == []  # no run
    session.handle(PlanReceived(plan()), 0)

    def hellos(now: float) -> int:
        out = session.handle(WorkerIdle(), now)
        for item in out:
            assert isinstance(item, Publish)
            session.handle(Published(item, failed=False), now)
        return len(out)

    assert [hellos(now) for now in (1, 1, 1 + FIRST_HELLO_S)] == [1, 0, 1]
    session.handle(ReadersChecked((), consumers_alive=True), 1.2)
    assert [hellos(now) for now in (1 + 0.5 * HELLO_S, 1.2 + HELLO_S)] == [0, 1]
    compute(session, session.handle(BlockReceived(block()), 5), 5)
    assert hellos(5 + HELLO_S) == 0


def test_publishers_that_fail_for_good_are_created_again(session: SimulatorSession) -> None:
    publish = next(item for item in session.handle(WorkerIdle(), 9) if isinstance(item, Publish))
    session.handle(Published(publish, failed=True), 9)
    assert session.handle(ReadersChecked((), consumers_alive=True), 9 + 2 * DEAF_S) == []  # it was for a moment
    missing = ReadersChecked(("/bow/recorder does not hear bridge_force",), consumers_alive=True)
    early = SimulatorSession(OWN, "f", lambda *_: True, prepare=request, now=8)
    early.handle(PlanReceived(plan()), 9)
    early.handle(Published(publish, failed=True), 9)
    assert not any(isinstance(item, RecreatePublishers) for item in early.handle(missing, 9))
    assert RecreatePublishers() in early.handle(missing, 8.1 + DEAF_S)
    assert RecreatePublishers() not in early.handle(missing, 20 + DEAF_S)


def test_a_lost_consumer_takes_the_simulator_out_of_work_until_it_is_back(session: SimulatorSession) -> None:
    why = "/bow/recorder does not hear stick_slip"
    (item,) = session.handle(ReadersChecked((why,), consumers_alive=True), 1)
    assert item == SetState(NodeState.STARTING, f"waiting: {why}", "r1")
    out = session.handle(BlockReceived(block()), 1)
    assert any(isinstance(item, Log) and "not ready: waiting" in item.text for item in out)
    (item,) = session.handle(ReadersChecked((), consumers_alive=True), 2)
    assert item == SetState(NodeState.READY, "", "r1")


def test_receipts_whose_arrays_differ_in_length_are_ignored(session: SimulatorSession) -> None:
    odd = {**receipt([(0, 0, 0)]), "kind": np.zeros(2, np.uint8)}
    (item,) = session.handle(ReceiptReceived(odd), 0)
    assert isinstance(item, Ignore)


def test_a_simulator_refuses_blocks_that_cannot_be_right() -> None:
    sweep = Sweep.from_spec("fig11d", ["x.count=16", "y.count=8", "block_cells=8"])
    run = ("run", sweep.sweep_id)
    cells = sweep.block(3)
    lanes = sweep.lanes(cells)

    def objection(ready: bool = True, open_epoch: int = 1, **changes: Any) -> str:
        session = SimulatorSession(OWN, fingerprint(), lambda *_: True)
        session.handle(PlanReceived(plan(run, open_epoch)), 0)
        session.handle(ReadersChecked(() if ready else ("no recorder",), consumers_alive=True), 0)
        message = block(3, run=run, fingerprint=fingerprint(), cells=cells)
        message |= {"spec.settings": list(sweep.settings()), "x": lanes["f_asym"], "y": lanes["f_init_ratio"]}
        out = session.handle(BlockReceived({**message, **changes}), 0)
        return "".join(item.text for item in out if isinstance(item, Log))

    assert objection() == ""
    assert "array lengths" in objection(x=lanes["f_asym"][:-1])
    assert "array lengths" in objection(cells=[], x=[], y=[])
    assert "f_asym" in objection(x=-lanes["f_asym"])
    assert "f_asym" in objection(x=np.full(8, np.nan))
    assert "f_init_ratio" in objection(y=np.full(8, np.inf))
    assert "cells" in objection(cells=cells + 128)
    assert "cells" in objection(cells=np.zeros(8, np.uint32))
    assert "kernel" in objection(fingerprint="another")
    assert "is not the open one" in objection(run_id="another")
    assert "is not the open one" in objection(sweep_id="another")
    assert "v_mid" in objection(**{"spec.settings": [*sweep.settings(), "v_mid=1"]})
    assert "nonsense" in objection(**{"spec.settings": ["nonsense"]})
    assert "epoch 1 is over" in objection(open_epoch=2)
    assert "not ready" in objection(ready=False)
