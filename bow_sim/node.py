"""The simulator node: takes blocks as goals, runs the kernel, publishes bridge force and stick/slip at full rate.

It takes goals only once its streams have met this run's recorder and classifier, keeps at most 16 chunks under way
that are not both receipted and judged, and sends again what stays unanswered.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from bow_msgs.action import Simulate
from bow_msgs.msg import BridgeForce, Health, Plan, Receipt, StickSlip
from numpy.typing import NDArray
from rcl_interfaces.msg import IntegerRange, ParameterDescriptor
from rclpy.action import ActionServer, CancelResponse, GoalResponse

from . import wire
from .credit import LIMIT, Window
from .identity import fingerprint, random_id
from .kernel import Block, ChunkResult
from .limits import check_block
from .model import ParameterError
from .ros import CONSUMERS, HEARD, INSPECT, STREAM, WAVES, BowNode, live, publishes
from .spec import split

HELP = """
usage: ros2 run bow simulator [--ros-args -r __node:=NAME -r __ns:=/bow/RUN -p credit:=8 -p inspect:=[0,77]]

Simulates blocks of bowed strings for a sweep. Start as many as there are cores, here or on other machines; each joins
the pool of the coordinator in its namespace (default /bow) by its action server <node>/simulate.
It takes work once a recorder and a classifier of that namespace listen to its streams.
"""

IN_HAND = 2
"""Goals held at most: one being computed, one waiting."""


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
            ),
        ).value
        self.declare_parameter(
            "inspect",
            [0],
            ParameterDescriptor(description="cells whose bridge force also goes out on `inspect`, for the dashboard"),
        )
        self._lock = threading.Condition()
        self._window = Window(credit)
        self._goals: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._held = 0
        self._prepared: dict[tuple[int, int, int], Block] = {}
        self._run: tuple[str, str] = ("", "")
        self._epoch = 0
        self._settled: set[int] = set()
        self._consumers: dict[str, tuple[str, float]] = {}
        self._met: dict[str, set[bytes]] = {}
        self._waiting_for: dict[str, set[bytes]] = {role: set() for role in CONSUMERS}
        self._leaving = threading.Event()

        self._force = self.create_publisher(BridgeForce, "bridge_force", WAVES)
        self._slips = self.create_publisher(StickSlip, "stick_slip", WAVES)
        self._inspect = self.create_publisher(BridgeForce, "inspect", INSPECT)
        self.create_subscription(Plan, "plan", self._on_plan, HEARD)
        self.create_subscription(Health, "health", self._on_health, HEARD)
        self.create_subscription(Receipt, "receipts", self._on_receipts, STREAM, raw=True)
        self._server = ActionServer(
            self,
            Simulate,
            "~/simulate",
            execute_callback=self._conclude,
            goal_callback=self._on_goal,
            handle_accepted_callback=self._goals.put,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            result_timeout=1,
        )
        self._fingerprint = fingerprint()
        self.create_timer(0.1, self._look)
        self._worker = threading.Thread(target=self._work, name="kernel", daemon=True)
        self._worker.start()

    # ---- who listens

    def _listeners(self) -> dict[str, set[bytes]]:
        """Return, by role, the endpoints that listen to both streams; none of a recorder that gives no receipts yet."""
        topics = [self.resolve_topic_name(name) for name in ("bridge_force", "stick_slip")]
        found: dict[str, list[set[bytes]]] = {role: [] for role in CONSUMERS}
        for topic, publisher in zip(topics, (self._force, self._slips), strict=True):
            infos = [i for i in self.get_subscriptions_info_by_topic(topic) if i.node_namespace == self.get_namespace()]
            matched = publisher.get_subscription_count() >= len(infos)
            for role in CONSUMERS:
                found[role].append({bytes(i.endpoint_gid) for i in infos if matched and i.node_name == role})
        if not publishes(self, "recorder", "receipts"):
            found["recorder"] = [set()]
        return {role: set().union(*sets) if all(sets) else set() for role, sets in found.items()}

    def _look(self) -> None:
        """Become ready once both consumers listen; after a consumer's restart its old endpoints do not count."""
        if self.health.state != Health.STARTING or not self._run[0]:
            return
        listeners = self._listeners()
        missing = [role for role in CONSUMERS if not listeners[role] - self._waiting_for[role]]
        if missing:
            self.become(Health.STARTING, f"waiting for {' and '.join(missing)} of {self.get_namespace()}")
            return
        self._met = listeners
        self.become(Health.BUSY if self._held else Health.READY)

    def _on_health(self, message: Health) -> None:
        if message.role not in CONSUMERS or message.state == Health.DEAD:
            return
        known = self._consumers.get(message.role, (message.incarnation, 0.0))[0]
        self._consumers[message.role] = (message.incarnation, time.monotonic())
        if known != message.incarnation:
            self._waiting_for[message.role] = self._met.get(message.role, set())
            self.become(Health.STARTING, f"{message.role} restarted")

    def _on_plan(self, message: Plan) -> None:
        with self._lock:
            run = (message.run_id, message.sweep_id)
            if run != self._run:
                self._run, self._epoch = run, 0
            self._enter(message.epoch)
            states = np.asarray(message.block_states)
            self._settled = set(np.flatnonzero(states != Plan.OUTSTANDING).tolist())
            self._window.drop(self._settled)
            self._lock.notify_all()
        if message.state == Plan.CLOSED:
            self.become(Health.STARTING, "no sweep is open", "")
            self._run = ("", "")
        elif self.health.run_id != message.run_id:
            self.become(Health.STARTING, "a sweep opens", message.run_id)

    def _enter(self, epoch: int) -> None:
        """Begin a newer epoch, told by a plan or a goal: nobody waits for what was sent in older ones."""
        if epoch > self._epoch:
            self._epoch, self._held = epoch, 0
            self._window.drop()

    # ---- answers

    def _on_receipts(self, data: bytes) -> None:
        """Take the recorder's answers, for chunks and for the verdicts on them: one message for many."""
        try:
            receipt = wire.decode("Receipt", data)
        except wire.WireError:
            self.health.ignored += 1
            return
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
                if kind != wire.RECEIPT_BLOCK:
                    judged = kind == wire.RECEIPT_VERDICTS
                    self._window.answered((block, chunk), now, receipted=not judged, judged=judged)
            self._lock.notify_all()

    # ---- goals

    def _on_goal(self, goal: Simulate.Goal) -> GoalResponse:
        why = self._objection(goal)
        if why:
            self.get_logger().warning(f"block {goal.block}, attempt {goal.attempt} rejected: {why}")
            self.become(self.health.state, f"rejects blocks: {why}")
            return GoalResponse.REJECT
        with self._lock:
            self._enter(goal.epoch)
        self._held += 1
        return GoalResponse.ACCEPT

    def _objection(self, goal: Simulate.Goal) -> str:
        """Return why a goal cannot be taken, or ""."""
        if self.health.state not in (Health.READY, Health.BUSY):
            return f"not ready: {self.health.detail}"
        if (goal.run_id, goal.sweep_id) != self._run:
            return f"run {goal.run_id!r}, sweep {goal.sweep_id!r} is not the open one, {self._run}"
        if goal.epoch < self._epoch:
            return f"epoch {goal.epoch} is over, this is epoch {self._epoch}"
        if goal.fingerprint != self._fingerprint:
            return f"kernel {goal.fingerprint} was asked for, this one is {self._fingerprint}: results could differ"
        if self._held >= IN_HAND and goal.epoch == self._epoch:
            return f"already holds {self._held} blocks"
        lengths = {name: len(getattr(goal, name)) for name in ("cells", "x", "y")}
        if len(set(lengths.values())) != 1 or not lengths["cells"]:
            return f"array lengths {lengths} should be equal and above 0"
        try:
            self._prepared[_key(goal)] = self._prepare(goal)
        except (ParameterError, ValueError) as error:
            return str(error)
        return ""

    def _prepare(self, goal: Simulate.Goal) -> Block:
        spec = split(goal.spec.settings)
        parameters = spec.parameters()
        planned = spec.number("x", "count") * spec.number("y", "count")
        check_block(len(goal.cells), parameters)
        cells = np.asarray(goal.cells, dtype=np.int64)
        if cells.max() >= planned or len(np.unique(cells)) != len(cells):
            raise ParameterError(f"cells: should be different ones out of 0 ... {planned - 1}")
        lanes = {str(spec.x.get("name")): np.asarray(goal.x), str(spec.y.get("name")): np.asarray(goal.y)}
        return Block(parameters, lanes)

    def _conclude(self, goal_handle: Any) -> Simulate.Result:
        """Give the result that the worker left on the handle; runs in the executor."""
        result, fine = goal_handle.bow_outcome
        if goal_handle.is_cancel_requested:
            goal_handle.canceled()
        elif fine:
            goal_handle.succeed()
        else:
            goal_handle.abort()
        self._held -= goal_handle.request.epoch == self._epoch
        if not self._held and self.health.state == Health.BUSY:
            self.become(Health.READY)
        return result

    # ---- the worker

    def _work(self) -> None:
        while not self._leaving.is_set():
            try:
                goal_handle = self._goals.get(timeout=0.5)
            except queue.Empty:
                self._send_again()
                continue
            try:
                goal_handle.bow_outcome = self._compute(goal_handle)
            except Exception as error:
                if self._leaving.is_set():
                    return
                self.get_logger().error(f"block {goal_handle.request.block}: {error!r}")
                goal_handle.bow_outcome = (Simulate.Result(), False)
            goal_handle.execute()

    def _void(self, goal_handle: Any) -> bool:
        goal = goal_handle.request
        return (
            self._leaving.is_set()
            or goal_handle.is_cancel_requested
            or goal.epoch < self._epoch
            or goal.run_id != self._run[0]
            or goal.block in self._settled
        )

    def _compute(self, goal_handle: Any) -> tuple[Simulate.Result, bool]:
        """Compute and publish one block; return its result, and whether it is complete."""
        goal = goal_handle.request
        result = Simulate.Result()
        if self.health.state == Health.READY:
            self.become(Health.BUSY)
        goal_handle.publish_feedback(Simulate.Feedback(chunk=0))
        block = self._prepared.pop(_key(goal))
        cells = np.asarray(goal.cells, dtype=np.uint32)
        common = {name: getattr(goal, name) for name in ("run_id", "sweep_id", "block", "attempt")}
        common |= {"incarnation": self.incarnation, "cells": cells, "checksum": 0}
        shown = np.flatnonzero(np.isin(cells, self.get_parameter("inspect").value or ()))
        for chunk in range(block.parameters.chunks):
            began = time.perf_counter()
            output = block.advance()
            result.compute_seconds += time.perf_counter() - began
            values = common | {"chunk": chunk, "samples": output.bridge_force.shape[1]}
            values["first_sample"] = chunk * values["samples"]
            messages = (
                wire.encode("BridgeForce", values | {"data": output.bridge_force}),
                wire.encode("StickSlip", values | {n: getattr(output, n) for n in wire.INTERVAL_FIELDS}),
            )
            result.wait_seconds += self._await_credit(goal_handle)
            if self._void(goal_handle):
                return result, False
            with self._lock:
                self._window.sent((goal.block, chunk), messages, time.monotonic())
            self._publish(messages)
            if shown.size:
                self._show(values, output, shown)
            result.chunks += 1
        return result, True

    def _await_credit(self, goal_handle: Any) -> float:
        began = time.monotonic()
        while True:
            with self._lock:
                if not self._window.full or self._void(goal_handle):
                    return time.monotonic() - began
                self._lock.wait(0.2)
            self._send_again()

    def _send_again(self) -> None:
        """Publish what stays unanswered although both consumers are alive."""
        now = time.monotonic()
        if any(now - self._consumers.get(role, ("", 0.0))[1] > 2.5 for role in CONSUMERS):
            return
        with self._lock:
            overdue = self._window.overdue(now)
        for messages in overdue:
            self.health.duplicates += 1
            self._publish(messages)

    def _publish(self, messages: Sequence[bytes]) -> None:
        for publisher, message in zip((self._force, self._slips), messages, strict=True):
            publisher.publish(message)
            self.health.bytes += len(message)
        self.health.messages += len(messages)

    def _show(self, values: Mapping[str, Any], output: ChunkResult, rows: NDArray[np.intp]) -> None:
        """Publish the bridge force of some cells of a chunk, by their rows, for people to look at."""
        shown = {"cells": values["cells"][rows], "data": output.bridge_force[rows]}
        self._inspect.publish(wire.encode("BridgeForce", {**values, **shown}))

    def close(self) -> None:
        """Stop the worker; what it has not finished the coordinator gives to another."""
        self._leaving.set()
        with self._lock:
            self._lock.notify_all()
        self._worker.join(5.0)


def _key(goal: Simulate.Goal) -> tuple[int, int, int]:
    return goal.epoch, goal.block, goal.attempt


def main() -> int:
    """Entry point of ``ros2 run bow simulator``."""
    return live(SimulatorNode, description=HELP)


if __name__ == "__main__":
    raise SystemExit(main())
