"""The simulator node: takes blocks, runs the kernel, publishes bridge force and stick/slip at full rate.

It is ready once this run's recorder and classifier say that its streams arrive, keeps at most 16 chunks under way that
are not both receipted and judged, and sends again what stays unanswered. Which blocks it holds is in its heartbeat.
"""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from bow_msgs.msg import Block, BridgeForce, Health, Plan, Receipt, StickSlip
from numpy.typing import NDArray
from rcl_interfaces.msg import IntegerRange, ParameterDescriptor
from rclpy.publisher import Publisher

from bow_sim.block_request import Job, prepare
from bow_sim.graph.node_base import HEARD, INSPECT, STREAM, WAVES, WORK, BowNode, RCLError, live
from bow_sim.kernel.block import ChunkResult
from bow_sim.kernel.fingerprint import fingerprint
from bow_sim.physics.errors import ParameterError
from bow_sim.protocol import cdr
from bow_sim.protocol.authority import Authority
from bow_sim.protocol.flow_control import LIMIT, Window
from bow_sim.protocol.identity import random_id
from bow_sim.protocol.neighbours import CONSUMERS, DEAF_S, FIRST_HELLO_S, HELLO_S, Neighbour
from bow_sim.protocol.states import ReceiptKind

HELP = """
usage: ros2 run bow simulator [--ros-args -r __node:=NAME -r __ns:=/bow/RUN -p credit:=8 -p inspect:=[0,77]]

Simulates blocks of bowed strings for a sweep. Start as many as there are cores, here or on other machines, each under a
name of its own; each joins the pool of the coordinator in its namespace (default /bow) by its heartbeat on `health`.
It takes work once the recorder and the classifier of that namespace hear its streams.
"""

IN_HAND = 2
"""Blocks held at most: one being computed, one waiting."""

REFUSED = 8
"""Refused blocks that a heartbeat names, at most: the latest."""

LOOK_S = 0.1

STREAMS = ("bridge_force", "stick_slip")

READERS = tuple((topic, role) for role in CONSUMERS for topic in STREAMS)
"""Who has to hear what."""


class SimulatorNode(BowNode):
    """One simulator of the pool."""

    def __init__(self) -> None:
        super().__init__("simulator", f"simulator_{random_id()[:8]}")  # of all machines, so no number of this one
        credit = self.declare_parameter(
            "credit",
            LIMIT,
            ParameterDescriptor(
                description="chunks under way at most that are not both receipted and judged",
                integer_range=[IntegerRange(from_value=1, to_value=LIMIT, step=1)],
                read_only=True,
            ),
        ).value
        shown = "cells whose bridge force also goes out on `inspect`, for the dashboard"
        self._inspected = self.declare_parameter(
            "inspect", [0], ParameterDescriptor(description=shown, read_only=True)
        ).value
        self._lock = threading.Condition()
        self._window = Window(credit)
        self._jobs: queue.SimpleQueue[Job] = queue.SimpleQueue()
        self._held: list[Job] = []
        self._refused: deque[tuple[int, int]] = deque(maxlen=REFUSED)
        self._changed = False  # what is held or refused: worth a heartbeat
        self._run: tuple[str, str] = ("", "")
        self._epoch = 0
        self._settled: set[int] = set()
        self._authority = Authority(self.works_for)
        self._leaving = threading.Event()
        self._last_hello = 0.0

        self._sending = threading.Lock()
        self._streams: list[Publisher] = []
        self._fails = False
        self._open_streams()
        self._inspect = self.create_publisher(BridgeForce, "inspect", INSPECT)
        self.create_subscription(Plan, "plan", self._on_plan, HEARD, raw=True)
        self.create_subscription(Receipt, "receipts", self._on_receipts, STREAM, raw=True)
        self.create_subscription(Block, "blocks", self._on_block, WORK, raw=True)
        self._fingerprint = fingerprint()
        self.every(LOOK_S, self._look)
        self._worker = threading.Thread(target=self._work, name="kernel", daemon=True)
        self._worker.start()

    # ---- who listens

    def cares(self, role: str, node: str) -> bool:
        """Other simulators do not matter, unless they have our name."""
        return role in CONSUMERS or role == "coordinator" or node == self.health.node

    def on_health(self, message: Health, neighbour: Neighbour | None) -> None:
        """Become ready at once when the last of the consumers says that it hears us."""
        if message.role in CONSUMERS and self.health.state == Health.STARTING:
            self._look()

    def _open_streams(self) -> None:
        """Make the publishers of the streams; anew where DDS does not let go of a reader that has gone, for good."""
        self._opened = self.awake.now()
        with self._sending:
            for broken in self._streams:
                self.destroy_publisher(broken)
            kinds = zip((BridgeForce, StickSlip), STREAMS, strict=True)
            self._streams, self._fails = [self.create_publisher(kind, topic, WAVES) for kind, topic in kinds], False

    def _look(self) -> None:
        """Be ready as long as the consumers of this run hear our streams."""
        if self._changed:
            self._say_what_is_held()
        run = self._run[0]
        if not run:
            return
        starting = self.health.state == Health.STARTING
        if not self.is_heard(READERS, run):
            if self._fails and self.awake.now() - self._opened > DEAF_S:
                self.get_logger().warning("the streams do not go out: their publishers are made anew")
                self._open_streams()
        elif starting:
            self.become(Health.BUSY if self._held else Health.READY)

    def _say_hello(self) -> None:
        """Show that our streams arrive, where nothing else does: called where nothing is under way."""
        pause = FIRST_HELLO_S if self.health.state == Health.STARTING else HELLO_S
        now = time.monotonic()
        if self._run[0] and now - self._last_hello >= pause:
            self._last_hello = now
            self._publish([cdr.hello(name, self.incarnation) for name in ("BridgeForce", "StickSlip")])

    def _on_plan(self, data: bytes) -> None:
        try:
            plan = cdr.decode("Plan", data)
        except cdr.WireError:
            self.health.ignored += 1
            return
        if self._authority.objection(plan):
            self.health.ignored += 1
            return
        run = (plan["run_id"], plan["sweep_id"])
        with self._lock:
            if run != self._run:
                self._run, self._epoch = run, 0
            self._enter(plan["epoch"])
            self._settled = set(np.flatnonzero(plan["block_states"] != Plan.OUTSTANDING).tolist())
            self._window.drop(self._settled)
            self._lock.notify_all()
        if plan["state"] == Plan.CLOSED:
            self._run = ("", "")
            self.become(Health.STARTING, "no sweep is open", "")
        elif self.health.run_id != run[0]:
            self.become(Health.STARTING, "a sweep opens", run[0])
            self._look()

    def _enter(self, epoch: int) -> None:
        """Begin a newer epoch, told by a plan or a block: nobody waits for what was sent in older ones."""
        if epoch > self._epoch:
            self._epoch = epoch
            self._window.drop()

    # ---- answers

    def _on_receipts(self, data: bytes) -> None:
        """Take the recorder's answers, for chunks and for the verdicts on them: one message for many."""
        try:
            receipt = cdr.decode("Receipt", data)
        except cdr.WireError:
            self.health.ignored += 1
            return
        self.heard("receipts", receipt["incarnation"])
        if (receipt["run_id"], receipt["sweep_id"]) != self._run:
            return
        kinds = receipt["kind"].tolist()
        blocks, chunks = receipt["block"].tolist(), receipt["chunk"].tolist()
        if not len(blocks) == len(chunks) == len(kinds):
            self.health.ignored += 1
            return
        now = time.monotonic()
        with self._lock:
            for block, chunk, kind in zip(blocks, chunks, kinds, strict=True):
                if kind != ReceiptKind.BLOCK:
                    judged = kind == ReceiptKind.VERDICTS
                    self._window.answered((block, chunk), now, receipted=not judged, judged=judged)
            self._lock.notify_all()

    # ---- blocks

    def _on_block(self, data: bytes) -> None:
        try:
            message = cdr.decode("Block", data)
        except cdr.WireError:
            self.health.ignored += 1
            return
        self.heard("blocks", message["coordinator"])
        if message["simulator"] != self.incarnation:
            return
        if not self.works_for(message["coordinator"], message["run_id"]):  # out of a bag, say; a lost one comes again
            self.health.ignored += 1
            return
        try:
            job = self._accept(message)
        except (ParameterError, ValueError) as error:
            self.get_logger().warning(
                f"block {message['block']}, attempt {message['attempt']} refused: {error}", throttle_duration_sec=5.0
            )
            self._refused.append((message["block"], message["attempt"]))
            self.health.detail = f"refuses blocks: {error}"
        else:
            with self._lock:
                self._enter(message["epoch"])
                self._held.append(job)
            self._jobs.put(job)
        self._say_what_is_held()

    def _accept(self, message: Mapping[str, Any]) -> Job:
        """Return a block ready to compute.

        Raises
        ------
        ValueError
            Where it cannot be taken; says why.
        """
        if self.health.state not in (Health.READY, Health.BUSY):
            raise ValueError(f"not ready: {self.health.detail}")
        if (message["run_id"], message["sweep_id"]) != self._run:
            raise ValueError(
                f"run {message['run_id']!r}, sweep {message['sweep_id']!r} is not the open one, {self._run}"
            )
        if message["epoch"] < self._epoch:
            raise ValueError(f"epoch {message['epoch']} is over, this is epoch {self._epoch}")
        if message["fingerprint"] != self._fingerprint:
            raise ValueError(
                f"kernel {message['fingerprint']} was asked for, this one is {self._fingerprint}: results could differ"
            )
        with self._lock:  # those of older epochs are void, and gone in a moment
            held = sum(job.message["epoch"] >= message["epoch"] for job in self._held)
        if held >= IN_HAND:
            raise ValueError(f"already holds {held} blocks")
        lengths = {name: len(message[name]) for name in ("cells", "x", "y")}
        if len(set(lengths.values())) != 1 or not lengths["cells"]:
            raise ValueError(f"array lengths {lengths} should be equal and above 0")
        return Job(message, prepare(message))

    def _say_what_is_held(self) -> None:
        """Publish which blocks are held and which were refused: the coordinator goes by that."""
        with self._lock:
            held, self._changed = [job.key for job in self._held], False
        health = self.health
        health.held_blocks, health.held_attempts = ([key[part] for key in held] for part in (0, 1))
        health.refused_blocks, health.refused_attempts = ([key[part] for key in self._refused] for part in (0, 1))
        if health.state in (Health.READY, Health.BUSY):
            health.state = Health.BUSY if held else Health.READY
        self.beat()

    # ---- the worker

    def _work(self) -> None:
        while not self._leaving.is_set():
            try:
                job = self._jobs.get(timeout=FIRST_HELLO_S)
            except queue.Empty:
                if len(self._window):
                    self._send_again()
                else:
                    self._say_hello()
                continue
            complete = False
            try:
                complete = self._compute(job)
            except Exception as error:
                if self._leaving.is_set():
                    return
                self.get_logger().error(f"block {job.key[0]}: {error!r}")
            with self._lock:
                self._held.remove(job)
                if not complete:
                    self._refused.append(job.key)
                self._changed = True
            if self.executor is not None:  # in its thread, at once
                self.executor.create_task(self._say_what_is_held)

    def _void(self, job: Job) -> bool:
        message = job.message
        return (
            self._leaving.is_set()
            or message["epoch"] < self._epoch
            or message["run_id"] != self._run[0]
            or message["block"] in self._settled
        )

    def _compute(self, job: Job) -> bool:
        """Compute and publish one block; return whether it is complete."""
        message, block = job.message, job.block
        cells = np.array(message["cells"], dtype=np.uint32)
        common = {name: message[name] for name in ("run_id", "sweep_id", "block", "attempt")}
        common |= {"incarnation": self.incarnation, "cells": cells, "checksum": 0}
        shown = np.flatnonzero(np.isin(cells, self._inspected or ()))
        for chunk in range(block.parameters.chunks):
            output = block.advance()
            values = common | {"chunk": chunk, "samples": output.bridge_force.shape[1]}
            values["first_sample"] = chunk * values["samples"]
            messages = (
                cdr.encode("BridgeForce", values | {"data": output.bridge_force}),
                cdr.encode("StickSlip", values | {n: getattr(output, n) for n in cdr.INTERVAL_FIELDS}),
            )
            self._await_credit(job)
            if self._void(job):
                return False
            with self._lock:
                self._window.sent((message["block"], chunk), messages, time.monotonic())
            self._publish(messages)
            if shown.size:
                self._show(values, output, shown)
        return True

    def _await_credit(self, job: Job) -> None:
        while True:
            with self._lock:
                if not self._window.full or self._void(job):
                    return
                self._lock.wait(0.2)
            self._send_again()

    def _send_again(self) -> None:
        """Publish what stays unanswered although both consumers are alive."""
        now = self.awake.now()
        if not all(self.neighbours.of_role(role, now, self._run[0]) for role in CONSUMERS):
            return
        with self._lock:
            overdue = self._window.overdue(time.monotonic())
        for messages in overdue:
            self.health.duplicates += 1
            self._publish(messages)

    def _publish(self, messages: Sequence[bytes]) -> None:
        try:
            with self._sending:
                for publisher, message in zip(self._streams, messages, strict=True):
                    publisher.publish(message)
                    self.health.bytes += len(message)
        except RCLError as error:  # a subscriber hangs or is just leaving: what stays unanswered is sent again
            self._fails = True
            self.get_logger().warning(f"a chunk did not go out: {error}", throttle_duration_sec=5.0)
        self.health.messages += len(messages)

    def _show(self, values: Mapping[str, Any], output: ChunkResult, rows: NDArray[np.intp]) -> None:
        """Publish the bridge force of some cells of a chunk, by their rows, for people to look at."""
        shown = {"cells": values["cells"][rows], "data": output.bridge_force[rows]}
        with contextlib.suppress(RCLError):  # for people to look at: a lost one is no loss
            self._inspect.publish(cdr.encode("BridgeForce", {**values, **shown}))

    def close(self) -> None:
        """Stop the worker; what it has not finished the coordinator gives to another."""
        self._leaving.set()
        with self._lock:
            self._lock.notify_all()
        self._worker.join(5.0)


def main() -> int:
    """Entry point of ``ros2 run bow simulator``."""
    return live(SimulatorNode, description=HELP)


if __name__ == "__main__":
    raise SystemExit(main())
