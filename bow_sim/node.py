"""The simulator node: takes blocks, runs the kernel, publishes bridge force and stick/slip at full rate.

Of a sweep that records no streams it publishes verdicts instead, if it is given what judges a block; the streams then
go out only while somebody else than recorder and classifier listens.

What it knows and decides is in :class:`bow_sim.simulator_session.SimulatorSession`; here are parameters, topics, health
and the thread that computes and publishes.
"""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

from bow_msgs.msg import Block, BridgeForce, Health, InspectedCell, Receipt, StickSlip, Verdicts
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription

from bow_sim.block_request import BlockRequest, Judge, fingerprint_of, prepare
from bow_sim.chunk_messages import ChunkMessages
from bow_sim.graph.inbox import Inbox
from bow_sim.graph.node_base import INSPECT, STREAM, STREAM_WRITER, WORK, BowNode, RCLError
from bow_sim.graph.serialized import publish
from bow_sim.physics.errors import ParameterError
from bow_sim.protocol import cdr
from bow_sim.protocol.flow_control import LIMIT
from bow_sim.protocol.identity import random_id
from bow_sim.protocol.inspected import SPREAD, spread_over
from bow_sim.protocol.messages import STREAMS
from bow_sim.protocol.neighbours import CONSUMERS, FIRST_HELLO_S, Neighbour
from bow_sim.protocol.recording import judged_at_source
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sim.simulator_events import (
    BlockReceived,
    ChunkComputed,
    ChunkFailed,
    ComputeChunk,
    Event,
    Ignore,
    Instruction,
    Log,
    Messages,
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
from bow_sim.simulator_session import NO_RUN, SimulatorSession

HELP = """
usage: ros2 run bow simulator [--ros-args -r __node:=NAME -r __ns:=/bow/RUN -p credit:=8 -p inspect:=[0,77]]

Simulates blocks of bowed strings for a sweep. Start as many as there are cores, here or on other machines, each under a
name of its own; each joins the pool of the coordinator in its namespace (default /bow) by its heartbeat on `health`.
It takes work once the recorder and the classifier of that namespace receive its streams. In the namespace /bow/RUN/NAME
with -p station:=NAME it belongs to the station NAME of the run, which has a recorder and a classifier of its own.
"""

CHECK_S = 0.1
"""Between two checks of the consumers' heartbeats."""

LOOK_S = 0.005
"""Between two looks of the worker for receipts, while chunks are under way and it has nothing to do."""

MOST_RECEIPTS = 100
"""Receipts that are taken at once, at most."""

UNHEARD_S = 0.02
"""Between two looks whether consumers are there to be told that this simulator is."""

MATCHED_S = 1.0
"""So long after its publishers are made, a simulator that is not matched with both consumers publishes nothing: Fast
DDS may wait for ever for what a reader acknowledges that was matched between two messages (data sharing), see
`simulator_session.FAILURES`."""

TOPICS = {
    "bridge_force": (BridgeForce, STREAM_WRITER),
    "stick_slip": (StickSlip, STREAM_WRITER),
    "verdicts": (Verdicts, STREAM),
}
"""Topic -> type and quality of service, of what a simulator may publish of a chunk."""

READERS = tuple((topic, role) for role in CONSUMERS for topic in STREAMS)
"""Pairs of topic and the role that has to receive it."""

VERDICTS_READERS = (("verdicts", "recorder"), ("verdicts", "coordinator"))
"""The same, where this node judges what it computes."""

JudgeOf = Callable[[Mapping[str, Any], Sequence[int]], Judge]
"""Takes a decoded Plan and the cells of a block; returns what judges the block. Raises ValueError where it cannot."""


class SimulatorNode(BowNode):
    """One simulator of the pool.

    Parameters
    ----------
    judge_of
        Returns what judges a block; None: the blocks of sweeps that record no streams are refused.
    """

    def __init__(self, judge_of: JudgeOf | None = None) -> None:
        super().__init__("simulator", f"simulator_{random_id()[:8]}")  # unique on all machines
        credit = self.read_parameter(
            "credit", LIMIT, "chunks under way at most that are not both receipted and judged", between=(1, LIMIT)
        )
        inspected = self.read_parameter(
            "inspect",
            [0],
            "cells whose bridge force also goes out on `inspect`, for the dashboard; [-1]: some of each run",
        )
        self._inspected: Sequence[int] = inspected or ()
        self._spread = list(self._inspected) == [SPREAD]
        self._spread_for = ""  # run that the cells are of
        self._session = SimulatorSession(
            self.incarnation, fingerprint_of, self.works_for, credit, self._prepare, self.awake.now()
        )
        self._judge_of = judge_of
        self._plan: Mapping[str, Any] = {}
        self._lock = threading.Lock()  # of the session, and of the order of its instructions
        self._to_worker: queue.SimpleQueue[ComputeChunk | Publish | None] = queue.SimpleQueue()
        self._to_node: queue.SimpleQueue[Instruction] = queue.SimpleQueue()
        self._leaving = threading.Event()
        self._messages: ChunkMessages | None = None  # of the block being computed; the worker's
        self._chunks = 0  # published, not counting repetitions

        self._publishing = threading.Lock()  # of the publishers
        self._publisher_of: dict[str, Publisher] = {}
        self._create_publishers(STREAMS)
        self._inspect = self.create_publisher(InspectedCell, self.topic("inspect"), INSPECT)
        self.subscribe_plan(lambda plan, _: self._on_plan(PlanReceived(plan)))
        self._receipts = Inbox(self, Receipt, "receipts", STREAM)
        self.create_subscription(Block, self.topic("blocks"), self._on_block, WORK, raw=True)
        self.every(CHECK_S, self._check_readers)
        self._worker = threading.Thread(target=self._work, name="kernel", daemon=True)
        self._worker.start()

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """The subscriptions that the executor serves."""
        return (each for each in super().subscriptions if each is not self._receipts.subscription)

    def run_note(self) -> str:
        """Return how much this simulator has computed."""
        return f"{self._chunks} chunks computed here since the start"

    # ---- what comes in, in the executor's thread

    def confirms(self, role: str, node: str) -> bool:
        """Other simulators are not confirmed, unless they have the same name and one of the two has to end."""
        return role in CONSUMERS or role == "coordinator" or node == self.health.node

    def on_health(self, message: Health, neighbour: Neighbour | None) -> None:
        """Become ready at once when the last of consumers and coordinator reports that it hears this simulator."""
        if message.role in (*CONSUMERS, "coordinator") and self.health.state == Health.STARTING:
            self._check_readers()

    def _on_plan(self, event: PlanReceived) -> None:
        if self._spread and event.plan["run_id"] != self._spread_for:
            self._spread_for = event.plan["run_id"]
            with contextlib.suppress(ParameterError):  # the session says what is wrong with it
                self._inspected = spread_over(SweepOutline.of(event.plan))
        self._plan = event.plan
        self._handle(event)
        if self._session.judges and "verdicts" not in self._publisher_of:
            self._create_publishers(["verdicts"])
        self._check_readers()

    def _prepare(self, message: Mapping[str, Any]) -> BlockRequest:
        """Return the request for a block, with a judge where it is to be judged here; ValueError if it cannot be."""
        request = prepare(message)
        if judged_at_source(request.record):
            if self._judge_of is None:
                raise ValueError("this simulator cannot judge blocks")
            request.judge = self._judge_of(self._plan, message["cells"])
        return request

    def _on_block(self, data: bytes) -> None:
        message = self.decode("Block", data)
        if message is not None:
            self.heard("blocks", message["coordinator"])
            if message["simulator"] == self.incarnation:
                self._handle(BlockReceived(message))

    def _check_readers(self) -> None:
        run = self._session.run
        if run != NO_RUN:
            now = self.awake.now()
            missing = self.missing_readers(VERDICTS_READERS if self._session.judges else READERS, run[0])
            if self.health.state == Health.STARTING and not self.works_for(self.authority.owner, run[0]):
                missing.append("the coordinator's answer")  # without it blocks are ignored
            alive = all(self.neighbours.of_role(role, now, run[0]) for role in CONSUMERS)
            self._handle(ReadersChecked(tuple(missing), alive))
        self._carry_out()

    # ---- the session

    def _handle(self, event: Event) -> None:
        """Give the session an event, from any thread; its instructions are carried out in the thread they are for."""
        with self._lock:
            for instruction in self._session.handle(event, self.awake.now()):
                if isinstance(instruction, ComputeChunk | Publish):
                    self._to_worker.put(instruction)
                else:
                    self._to_node.put(instruction)
        if threading.current_thread() is not self._worker:
            self._carry_out()
        elif not self._to_node.empty() and self.executor is not None:
            self.executor.create_task(self._carry_out)

    def _carry_out(self) -> None:
        """Carry out the session's instructions for the node, in the executor's thread."""
        while not (self.finished or self._to_node.empty()):  # no other thread takes from it
            match self._to_node.get_nowait():
                case SetState(state, detail, run_id):
                    self.set_state(state, detail, run_id)
                case Report() as report:
                    self._report(report)
                case RecreatePublishers():
                    self._create_publishers(list(self._publisher_of))
                case Ignore(why):
                    self.ignore(why)
                case Log(text, severe=True):
                    self.get_logger().error(text)
                case Log(text):
                    self.get_logger().warning(text, throttle_duration_sec=5.0)

    def _report(self, report: Report) -> None:
        """State in the heartbeat which blocks are held and which were refused; the coordinator relies on that.

        That blocks were taken is published with the next heartbeat, but before one of them ends.
        """
        health = self.health
        ended = self._held() - set(report.held)
        if not ended <= self._shown:
            self.publish_health()
        refused = list(zip(health.refused_blocks, health.refused_attempts, strict=True))
        changes = (health.state, health.detail, refused) != (report.state, report.detail, list(report.refused))
        health.state, health.detail = report.state, report.detail
        health.held_blocks, health.held_attempts = ([key[part] for key in report.held] for part in (0, 1))
        health.refused_blocks, health.refused_attempts = ([key[part] for key in report.refused] for part in (0, 1))
        if changes or ended:
            self.publish_health()

    def publish_health(self) -> None:
        """Publish the state of this node now."""
        self._shown = self._held()
        super().publish_health()

    def _held(self) -> set[tuple[int, int]]:
        """Return block and attempt of the blocks that the next heartbeat says are held."""
        return set(zip(self.health.held_blocks, self.health.held_attempts, strict=True))

    def _create_publishers(self, topics: Iterable[str]) -> None:
        with self._publishing:
            for topic in topics:
                if topic in self._publisher_of:
                    self.destroy_publisher(self._publisher_of[topic])
                kind, qos = TOPICS[topic]
                self._publisher_of[topic] = self.create_publisher(kind, topic, qos)
            self._made = time.monotonic()

    def _is_matched(self) -> bool:
        """Return whether the middleware has found both readers of each topic, or has had the time for it."""
        if time.monotonic() - self._made > MATCHED_S:
            return True
        with self._publishing, contextlib.suppress(RCLError):  # while the process ends
            return min(each.get_subscription_count() for each in self._publisher_of.values()) >= len(CONSUMERS)
        return False

    # ---- the worker's thread

    def _work(self) -> None:
        idle_at = 0.0
        while not self._leaving.is_set():
            pause = UNHEARD_S if self._session.waits else FIRST_HELLO_S
            try:
                instruction = self._to_worker.get(timeout=LOOK_S if self._session.under_way else pause)
            except queue.Empty:
                self._take_receipts()
                now = time.monotonic()
                if now - idle_at >= pause:
                    idle_at, self._messages = now, None
                    if self._is_matched():
                        self._handle(WorkerIdle())
                continue
            match instruction:
                case ComputeChunk():
                    computed = self._compute(instruction)
                    self._take_receipts()
                    self._handle(computed)
                case Publish(messages, inspect, again=again):
                    self.health.duplicates += again
                    self._chunks += bool(instruction.of)
                    self._handle(Published(instruction, failed=not self._publish(messages)))
                    with contextlib.suppress(RCLError):  # only for display, may be lost
                        for message in inspect:
                            publish(self._inspect, message)

    def _take_receipts(self) -> None:
        """Give the session the receipts that wait. The executor would wake its thread for each, beside the kernel."""
        taken = self._receipts.take(MOST_RECEIPTS)
        for data in taken:
            try:
                receipt = cdr.decode("Receipt", data)
            except cdr.WireError as error:
                self._to_node.put(Ignore(str(error)))
            else:
                self.neighbours.heard("receipts", receipt["incarnation"], self.awake.now())
                self._handle(ReceiptReceived(receipt))
        if taken and self.neighbours.changed and self.executor is not None:
            self.executor.create_task(self.report_heard)  # heartbeats are published by the executor's thread alone

    def _compute(self, instruction: ComputeChunk) -> ChunkComputed | ChunkFailed:
        request = instruction.request
        try:
            if self._messages is None or self._messages.request is not request:
                self._messages = ChunkMessages(request, self.incarnation, self._inspected)
            streams = request.judge is None or self._others_listen()
            return ChunkComputed(*self._messages.next(time.time_ns(), streams))
        except Exception as error:
            return ChunkFailed(request, repr(error))

    def _others_listen(self) -> bool:
        """Whether a stream has more subscribers than recorder and classifier, as far as the middleware knows."""
        with self._publishing, contextlib.suppress(RCLError):  # while the process ends
            return max(self._publisher_of[topic].get_subscription_count() for topic in STREAMS) > len(CONSUMERS)
        return False

    def _publish(self, messages: Messages) -> bool:
        """Publish a message on each topic; return whether the middleware took them."""
        self.health.messages += len(messages)
        try:
            with self._publishing:
                for topic, message in messages.items():
                    if topic in self._publisher_of:  # that of verdicts may be missing for the first hello of a run
                        publish(self._publisher_of[topic], message)
                        self.health.bytes += len(message)
        except RCLError as error:  # a subscriber hangs or is just ending; unanswered chunks are sent again
            self.get_logger().warning(f"a chunk is not published: {error}", throttle_duration_sec=5.0)
            return False
        return True

    def close(self) -> None:
        """Stop the worker; the coordinator gives unfinished blocks to other simulators."""
        self._leaving.set()
        self._to_worker.put(None)
        self._worker.join(5.0)
