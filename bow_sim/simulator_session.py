"""The simulator's side of the contract (docs/DESIGN.md): a pure state machine, events in, instructions out.

The session knows the run in progress, which blocks are held, what is under way and whether the consumers receive the
streams. The node around it has the topics, the clock and a worker thread that computes and publishes. The worker
carries out one :class:`ComputeChunk` or :class:`Publish` after the other, and reports each with an event.

A block is *held* from its acceptance until its last chunk is published. It ends as complete, or as refused if it cannot
be computed or has become *void*: it is of another run or an older epoch, or it is settled.
"""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from bow_sim.block_request import BlockRequest
from bow_sim.block_request import prepare as prepare_request
from bow_sim.kernel.fingerprint import difference
from bow_sim.physics.errors import ParameterError
from bow_sim.protocol import cdr
from bow_sim.protocol.flow_control import LIMIT, Window
from bow_sim.protocol.messages import STREAMS
from bow_sim.protocol.neighbours import FIRST_HELLO_S, HELLO_S, UNCONFIRMED_S
from bow_sim.protocol.recording import judged_at_source, record_of
from bow_sim.protocol.states import BlockState, NodeState, PlanState, ReceiptKind
from bow_sim.protocol.sweep_spec import split
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

IN_HAND = 2
"""Blocks held at most: one being computed, one waiting."""

REFUSED = 8
"""Refused blocks that a heartbeat names, at most: the latest."""

FAILURES = 3
"""After so many messages in a row that could not be published, the publishers are created again; at most every
`UNCONFIRMED_S`. Fast DDS 2.14 sometimes has no memory left for a message that it lends to several readers, and then
never again (its issues 6134, 6361)."""

NO_RUN = ("", "")

VERDICTS = {"verdicts": "Verdicts"}
"""What a simulator that judges its chunks publishes instead of `STREAMS`."""

WORKING = (NodeState.READY, NodeState.BUSY)


class SimulatorSession:
    """What one simulator knows and does; changed by :meth:`handle` alone.

    Parameters
    ----------
    incarnation
        Of the simulator: blocks are addressed to it.
    fingerprint
        Returns what this machine computes for a sweep, by its settings: a block of a coordinator whose machine computes
        something else is refused.
    works_for
        Returns whether a coordinator, by its incarnation, is alive and works for a run, by its run_id.
    credit
        Chunks under way at most that are not both receipted and judged.
    prepare
        Returns the request for a decoded Block message; raises ValueError if the block cannot be computed.
    now
        When the publishers of the streams were created, in seconds.

    Attributes
    ----------
    run
        run_id and sweep_id of the run in progress; empty if there is none.
    judges
        Whether simulators of this run judge their chunks, see :mod:`bow_sim.protocol.recording`.
    state, detail
        As in the next heartbeat.
    """

    def __init__(
        self,
        incarnation: str,
        fingerprint: Callable[[tuple[str, ...]], str],
        works_for: Callable[[str, str], bool],
        credit: int = LIMIT,
        prepare: Callable[[Mapping[str, Any]], BlockRequest] = prepare_request,
        now: float = 0.0,
    ) -> None:
        self.incarnation = incarnation
        self.run = NO_RUN
        self.judges = False
        self.epoch = 0
        self.state, self.detail, self._stated_run = NodeState.STARTING, "", ""
        self._fingerprint, self._works_for, self._prepare = fingerprint, works_for, prepare
        self._window = Window(credit)
        self._settled: frozenset[int] = frozenset()
        self._held: list[BlockRequest] = []
        self._refused: deque[tuple[int, int]] = deque(maxlen=REFUSED)
        self._report_due = False
        self._chunk = 0  # next chunk of the first block held
        self._computed: ChunkComputed | None = None  # its messages wait for credit
        self._busy = False  # the worker computes a chunk, or publishes it for the first time
        self._publishing = 0  # instructions to publish that the worker has not reported
        self._consumers_alive = False
        self._publishers_fail, self._failures = False, 0  # since they were created; in a row
        self._publishers_since, self._last_hello, self._recreated = now, float("-inf"), float("-inf")
        self._hello = {topic: cdr.hello(name, incarnation) for topic, name in (STREAMS | VERDICTS).items()}

    # ---- reading

    @property
    def held(self) -> list[tuple[int, int]]:
        """Block and attempt of the blocks held, the one being computed first."""
        return [request.key for request in self._held]

    @property
    def under_way(self) -> int:
        """Chunks that are published and not both receipted and judged."""
        return len(self._window)

    @property
    def waits(self) -> bool:
        """Whether the run in progress waits for the readers of the streams to report that they hear them."""
        return self.run != NO_RUN and self.state == NodeState.STARTING

    # ---- changing

    def handle(self, event: Event, now: float) -> list[Instruction]:
        """Take in an event at `now` (seconds, any origin) and return what to do, in order."""
        out: list[Instruction] = []
        match event:  # the most frequent first
            case ChunkComputed():
                self._busy, self._computed = False, event
            case Published(instruction, failed):
                self._take_published(instruction, failed)
            case ReceiptReceived(receipt):
                self._take_receipt(receipt, now, out)
            case ReadersChecked(missing, consumers_alive):
                self._consumers_alive = consumers_alive
                self._check_readers(missing, now, out)
            case PlanReceived(plan):
                self._take_plan(plan, out)
            case BlockReceived(message):
                self._take_block(message, out)
            case ChunkFailed(request, why):
                self._busy = False
                out.append(Log(f"block {request.key[0]}: {why}", severe=True))
                self._end(request, complete=False)
            case WorkerIdle():
                self._show_that_streams_arrive(now, out)
        self._go_on(now, out)
        if self._report_due:
            self._report_due = False
            if self.state in WORKING:
                self.state = NodeState.BUSY if self._held else NodeState.READY
            out.append(Report(self.state, self.detail, tuple(self.held), tuple(self._refused)))
        return out

    # ---- messages of other nodes

    def _take_plan(self, plan: Mapping[str, Any], out: list[Instruction]) -> None:
        run = (plan["run_id"], plan["sweep_id"])
        is_new = run != self.run
        if is_new:
            self.run, self.epoch = run, 0
            self._window.drop()
            self.judges = False
            with contextlib.suppress(ParameterError):  # then its blocks are refused
                self.judges = judged_at_source(record_of(split(plan["spec.settings"]).record))
        self._enter_epoch(plan["epoch"])
        self._settled = frozenset(np.flatnonzero(plan["block_states"] != BlockState.OUTSTANDING).tolist())
        self._window.drop(self._settled)
        if plan["state"] != PlanState.OPEN:
            self.run = NO_RUN
            self._window.drop()
            self._set_state(NodeState.STARTING, "no sweep is open", out)
        elif is_new:
            self._set_state(NodeState.STARTING, "a sweep opens", out)

    def _enter_epoch(self, epoch: int) -> None:
        """Enter the epoch of a plan or a block, if it is newer: chunks of older epochs get no answers."""
        if epoch > self.epoch:
            self.epoch = epoch
            self._window.drop()

    def _take_block(self, message: Mapping[str, Any], out: list[Instruction]) -> None:
        key = (message["block"], message["attempt"])
        if message["simulator"] != self.incarnation:
            return
        if not self._works_for(message["coordinator"], message["run_id"]):  # for example from a bag that is played
            out.append(Ignore(f"block {key[0]}: coordinator {message['coordinator']} is not known to work for its run"))
            return
        if key in self.held:
            return
        if not message["attempt"] and not len(message["cells"]):  # it only says that older epochs are over
            if (message["run_id"], message["sweep_id"]) == self.run:
                self._enter_epoch(message["epoch"])
            return
        try:
            request = self._accept(message)
        except ValueError as error:  # ParameterError is one
            out.append(Log(f"block {key[0]}, attempt {key[1]} refused: {error}"))
            self._refused.append(key)
            self.detail = f"refuses blocks: {error}"
        else:
            self._enter_epoch(message["epoch"])
            self._held.append(request)
        self._report_due = True

    def _accept(self, message: Mapping[str, Any]) -> BlockRequest:
        """Return the request for a block.

        Raises
        ------
        ValueError
            If the block cannot be taken; the text says why.
        """
        if self.state not in WORKING:
            raise ValueError(f"not ready: {self.detail}")
        if (message["run_id"], message["sweep_id"]) != self.run:
            raise ValueError(
                f"run {message['run_id']!r}, sweep {message['sweep_id']!r} is not the open one, {self.run}"
            )
        if message["epoch"] < self.epoch:
            raise ValueError(f"epoch {message['epoch']} is over, this is epoch {self.epoch}")
        there, here = message["fingerprint"], self._fingerprint(tuple(message["spec.settings"]))
        if there != here:
            raise ValueError(
                f"kernel {there} was asked for, this one is {here}: results could differ, by {difference(there, here)}"
            )
        epoch = message["epoch"]
        held = sum(not self._is_void(request) and request.message["epoch"] >= epoch for request in self._held)
        if held >= IN_HAND:
            raise ValueError(f"already holds {held} blocks")
        return self._prepare(message)

    def _take_receipt(self, receipt: Mapping[str, Any], now: float, out: list[Instruction]) -> None:
        """Take the recorder's answers, for streams and for verdicts; one message has many."""
        if (receipt["run_id"], receipt["sweep_id"]) != self.run:
            return
        columns = [receipt[name].tolist() for name in ("block", "chunk", "kind")]
        if len({len(column) for column in columns}) != 1:
            out.append(Ignore("receipt: its arrays differ in length"))
            return
        for block, chunk, kind in zip(*columns, strict=True):
            if kind != ReceiptKind.BLOCK:
                judged = kind == ReceiptKind.VERDICTS
                self._window.answered((block, chunk), now, receipted=not judged, judged=judged)

    # ---- readiness

    def _check_readers(self, missing: tuple[str, ...], now: float, out: list[Instruction]) -> None:
        """Be ready as long as the consumers of this run receive what this simulator publishes."""
        if self.run == NO_RUN:
            return
        unheard = missing and self._publishers_fail and now - self._publishers_since > UNCONFIRMED_S
        if unheard or (self._failures >= FAILURES and now - self._recreated > UNCONFIRMED_S):
            self._publishers_fail, self._failures = False, 0
            self._publishers_since = self._recreated = now
            out.append(Log("chunks cannot be published: their publishers are created again"))
            out.append(RecreatePublishers())
        if missing:
            self._set_state(NodeState.STARTING, f"waiting: {', '.join(missing)}", out)
        elif self.state == NodeState.STARTING:
            self._set_state(NodeState.BUSY if self._held else NodeState.READY, "", out)

    def _set_state(self, state: NodeState, detail: str, out: list[Instruction]) -> None:
        if (self.state, self.detail, self._stated_run) != (state, detail, self.run[0]):
            self.state, self.detail, self._stated_run = state, detail, self.run[0]
            if state == NodeState.STARTING:  # readers may have taken up the run: they hear the next hello
                self._last_hello = float("-inf")
            out.append(SetState(state, detail, self._stated_run))

    # ---- computing and publishing

    def _is_void(self, request: BlockRequest) -> bool:
        """Whether a block need not be computed any more."""
        return request.run != self.run or request.message["epoch"] < self.epoch or request.key[0] in self._settled

    def _go_on(self, now: float, out: list[Instruction]) -> None:
        """End void blocks, publish the computed chunk if credit permits it, have the next chunk computed."""
        for request in list(self._held):
            if self._is_void(request) and not (self._busy and request is self._held[0]):
                self._end(request, complete=False)
        if self._busy or not self._held:
            return
        request = self._held[0]
        if self._computed is None:
            self._busy = True
            out.append(ComputeChunk(request, self._chunk))
        elif not self._window.full:
            self._busy = True
            recorded = self._chunk in request.recorded
            self._window.sent((request.key[0], self._chunk), self._computed.messages, now, recorded)
            self._publish(Publish(self._computed.messages, self._computed.inspect, of=request), out)
        else:
            self._send_again(now, out)

    def _publish(self, instruction: Publish, out: list[Instruction]) -> None:
        self._publishing += 1
        out.append(instruction)

    def _take_published(self, instruction: Publish, failed: bool) -> None:
        self._publishing -= 1
        self._publishers_fail |= failed  # a lost chunk is sent again
        self._failures = self._failures + 1 if failed else 0
        if instruction.of is not None:
            self._busy, self._computed = False, None
            self._chunk += 1
            if self._chunk == instruction.of.chunks:
                self._end(instruction.of, complete=True)

    def _end(self, request: BlockRequest, *, complete: bool) -> None:
        if request is self._held[0]:
            self._chunk, self._computed = 0, None
        self._held.remove(request)
        if not complete:
            self._refused.append(request.key)
        self._report_due = True

    # ---- while nothing else is to do

    def _show_that_streams_arrive(self, now: float, out: list[Instruction]) -> None:
        """Send unanswered chunks again; if there are none, send a hello."""
        if len(self._window):
            self._send_again(now, out)
            return
        pause = FIRST_HELLO_S if self.state == NodeState.STARTING else HELLO_S
        if self.run != NO_RUN and self._rests and now - self._last_hello >= pause:
            self._last_hello = now
            # Streams too where it judges: whether consumers hear a simulator shows the watchdog which of them is deaf.
            hello = {topic: data for topic, data in self._hello.items() if self.judges or topic in STREAMS}
            self._publish(Publish(hello), out)

    @property
    def _rests(self) -> bool:
        """Whether the worker has nothing to do."""
        return not self._busy and not self._publishing

    def _send_again(self, now: float, out: list[Instruction]) -> None:
        """Publish unanswered chunks again, if both consumers are alive.

        Only while the worker has nothing to do: under load answers may be late, and while a subscriber hangs,
        instructions must not accumulate.
        """
        if self._consumers_alive and self._rests:
            for messages in self._window.overdue(now):
                self._publish(Publish(messages, again=True), out)
