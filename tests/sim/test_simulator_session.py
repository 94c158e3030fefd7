"""The simulator's session: whatever arrives, in whatever order, blocks and chunks are accounted for.

:class:`Sessions` throws plans, blocks, receipts and reports of the worker at a session: in any order, twice, late, from
strangers, of other runs and epochs. It holds

* at most two blocks that somebody waits for are held;
* a block is accepted if and only if it is addressed to this simulator by the coordinator in charge, belongs to the run
  and epoch in progress, asks for this kernel, can be computed and fits;
* every accepted block ends exactly once, complete or refused, and nothing of it is computed or published after that;
* a block is complete when each of its chunks was published once, in order;
* nothing is computed or published of a block that is void: of another run, an older epoch, or settled;
* never are more chunks under way than the credit; a chunk whose streams are not recorded is under way until it is
  judged;
* what is unanswered is sent again while both consumers are alive, never after it was answered or settled, and never
  while the worker has other work;
* a hello goes out only if nothing is under way, and only in a run: on the streams, also on verdicts where it judges;
* the simulator is ready only in a run whose consumers receive its streams, and names that run;
* publishers are created again only after they failed.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule
from session_messages import (
    BLOCKS,
    CHUNKS,
    COORDINATOR,
    OWN,
    RUNS,
    STRANGER,
    block,
    chunk_messages,
    plan,
    receipt,
    request,
)

from bow_sim.block_request import BlockRequest
from bow_sim.protocol import cdr
from bow_sim.protocol.authority import Authority
from bow_sim.protocol.flow_control import RESEND_S
from bow_sim.protocol.messages import STREAMS
from bow_sim.protocol.neighbours import UNCONFIRMED_S
from bow_sim.protocol.recording import RECORD, recorded_chunks
from bow_sim.protocol.states import NodeState, PlanState, ReceiptKind
from bow_sim.simulator_events import (
    BlockReceived,
    ChunkComputed,
    ChunkFailed,
    ComputeChunk,
    Event,
    Instruction,
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

HELLO = {topic: cdr.hello(name, OWN) for topic, name in STREAMS.items()}
HELLO_OF_JUDGE = {**HELLO, "verdicts": cdr.hello("Verdicts", OWN)}


class Sessions(RuleBasedStateMachine):
    @initialize(credit=st.integers(1, 3), record=st.sampled_from(list(RECORD)))
    def start(self, credit: int, record: str) -> None:
        self.record = record
        self.session = SimulatorSession(OWN, lambda _: "f", lambda *who: who in self.living, credit, self.prepare)
        self.authority = Authority(lambda *who: who in self.living)
        self.living = {(COORDINATOR, run) for run, _ in RUNS}
        self.credit, self.now = credit, 0.0
        self.run, self.epoch, self.settled = NO_RUN, 0, set()
        self.held: list[BlockRequest] = []
        self.prepared: list[BlockRequest] = []
        self.published: dict[int, int] = {}  # id of a request -> chunks
        self.refused: list[tuple[int, int]] = []
        self.unanswered: dict[tuple[int, int], tuple[Mapping[str, bytes], set[int]]] = {}
        self.work: deque[ComputeChunk | Publish] = deque()
        self.seen: list[dict[str, Any]] = []
        self.alive = self.failed = self.readers_receive = False
        self.stated_run, self.sent_again = "", []
        self.take_plan(plan())
        self.check_readers(True, True)

    def prepare(self, message: dict[str, Any]) -> BlockRequest:
        self.prepared.append(request(message, self.record))
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
                    self.sent_again.append(messages)
                case Publish(messages):
                    assert messages == (HELLO_OF_JUDGE if self.record == "verdicts" else HELLO)
                    assert not self.unanswered
                    assert self.run != NO_RUN
                case SetState(state, _, run_id):
                    assert state not in WORKING or self.readers_receive
                    self.stated_run = run_id
                case RecreatePublishers():
                    assert self.failed
                    self.failed = False
            if isinstance(item, ComputeChunk | Publish):
                self.work.append(item)
        self.what_is_held_and_under_way_is_bounded()
        assert self.stated_run == self.run[0]
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
        message["spec.settings"] = [f"record={self.record}"]
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

    @rule(
        numbers=st.lists(st.integers(0, BLOCKS - 1), min_size=1, max_size=3),
        attempt=st.integers(1, 2),
        later=st.sampled_from([0, 0, 0, 0, 1]),
        steps=st.integers(0, 8),
    )
    def receive_blocks_of_the_run(self, numbers: list[int], attempt: int, later: int, steps: int) -> None:
        """All is well: the coordinator in charge sends blocks to a simulator that is ready."""
        self.living = {(COORDINATOR, run) for run, _ in RUNS}
        if self.run == NO_RUN:
            self.take_plan(plan(epoch=10 + len(self.seen)))
        self.check_readers(True, True)
        for number in numbers:
            self.take_block(block(number, attempt, self.run, epoch=self.epoch + later))
        self.worker_goes_on(steps, fails=False)

    @rule(
        later=st.sampled_from([0, 1, -1]),
        run=st.sampled_from(RUNS),
        changes=st.sampled_from([{}, {}, {"coordinator": STRANGER}, {"simulator": STRANGER}]),
    )
    def receive_epoch(self, later: int, run: tuple[str, str], changes: dict[str, Any]) -> None:
        """A consumer of this station was restarted, and there is no block for us: what we hold is void all the same."""
        self.take_block(block(0, 0, run, epoch=self.epoch + later, cells=[], **changes))

    def take_block(self, message: dict[str, Any]) -> None:
        self.seen.append(message)
        key = message["block"], message["attempt"]
        obeyed = message["simulator"] == OWN and (message["coordinator"], message["run_id"]) in self.living
        if not message["attempt"] and not message["cells"]:
            if obeyed and (message["run_id"], message["sweep_id"]) == self.run:
                self.enter(message["epoch"])
            prepared = len(self.prepared)
            self.tell(BlockReceived(message))
            assert (len(self.prepared), self.session.epoch) == (prepared, self.epoch)
            return
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
    )
    def receive_receipt(self, keys: list[tuple[int, int, int]], unanswered: int) -> None:
        """The same receipt comes for another sweep, for another run, and for the run in progress."""
        keys += [(*key, kind) for key in list(self.unanswered)[:unanswered] for kind in (0, 1)]
        for run in ((self.run[0], "s9"), ("r9", self.run[1]), self.run):
            self.take_receipt(receipt(keys, run))

    def take_receipt(self, message: dict[str, Any]) -> None:
        self.seen.append(message)
        if (message["run_id"], message["sweep_id"]) == self.run:
            for number, chunk, kind in zip(message["block"], message["chunk"], message["kind"], strict=True):
                entry = self.unanswered.get((number, chunk))
                if entry is not None and kind != ReceiptKind.BLOCK:
                    entry[1].add(int(kind))
                    streams = {ReceiptKind.STREAMS} if chunk in recorded_chunks(self.record, CHUNKS) else set()
                    if entry[1] >= {ReceiptKind.VERDICTS} | streams:
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

    @rule(seconds=st.sampled_from([RESEND_S + 0.1, 0.1, 1.0]))
    def worker_is_idle(self, seconds: float) -> None:
        """The worker has done its work; while no consumer answers, consumers that are not alive come back."""
        while self.work:
            self.worker_does_its_next_work(False)
        self.sent_again = []
        for alive in (False, True):
            self.check_readers(self.readers_receive, alive)
            self.now += seconds
            self.tell(WorkerIdle())
        assert self.sent_again == [sent for sent, _ in self.unanswered.values()] or seconds < RESEND_S

    @rule(seconds=st.sampled_from([0.1, UNCONFIRMED_S + 0.1]))
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
