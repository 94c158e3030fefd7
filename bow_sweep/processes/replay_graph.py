"""Classifies a bag through DDS: the recorded plan and streams go to a classifier process, which returns verdicts.

The graph has a namespace of its own, ``/bow/replay_<run_id>_<random>``, on this machine. To the classifier it looks
like a live one: two nodes of this process take the names of coordinator and recorder, one publishes the plan and the
streams, and both subscribe to verdicts. No more chunks are under way than the credit of one simulator, so memory is
bounded as in a live run.
"""

from __future__ import annotations

import tempfile
import time
from collections import deque
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from bow_msgs.msg import BridgeForce, Health, Plan, StickSlip, Verdicts
from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions

from bow_classifier.task import Task
from bow_sim.graph.discovery import apply_defaults
from bow_sim.graph.leaving import at_end
from bow_sim.graph.node_base import LATCHED, LATCHED_DEEP, STREAM, STREAM_WRITER, BowNode
from bow_sim.protocol import cdr
from bow_sim.protocol.flow_control import LIMIT, LIMIT_BYTES
from bow_sim.protocol.identity import random_id
from bow_sim.protocol.neighbours import FIRST_HELLO_S
from bow_sim.protocol.states import BlockState
from bow_sweep.processes.interrupts import Interrupts
from bow_sweep.processes.supervisor import GraphError, Supervisor, tail
from bow_sweep.record.bag_contents import Chunks, Key, Survey

CLASSIFIER = "classifier"
LISTENERS = ("coordinator", "recorder")
"""Roles that must receive verdicts before the classifier reports that it is ready."""

KINDS = {"bridge_force": BridgeForce, "stick_slip": StickSlip}

PATIENCE_S = 60.0
"""Limit for the classifier's start and for one chunk; both take much less."""


def classify_in_graph(survey: Survey, task: Task) -> Iterator[tuple[Key, dict[str, Any]]]:
    """Yield (chunk, fields of Verdicts) as they come, for all chunks that the bag has in order.

    Raises
    ------
    GraphError
        Where the classifier process ends, does not take the plan, or does not answer.
    BagError
        Where a stored message cannot be read again.
    KeyboardInterrupt
        After Ctrl-C or SIGTERM.
    """
    apply_defaults()
    with (
        Interrupts("stopping the classifier; a few seconds") as interrupts,
        tempfile.TemporaryDirectory(prefix="bow-replay-") as logs,
        Chunks() as chunks,
    ):
        graph = _Graph(survey, task, chunks, Path(logs), interrupts)
        try:
            graph.open()
            yield from graph.verdicts()
        finally:
            graph.close()


def chunks_in_order(survey: Survey, task: Task) -> Iterator[Key]:
    """Yield the chunks whose two messages are stored; of each block those before the first incomplete chunk."""
    force, slip = (survey.places[topic] for topic in ("bridge_force", "stick_slip"))
    for block in range(task.outline.blocks):
        for chunk in range(task.outline.chunks):
            if (block, chunk) not in force or (block, chunk) not in slip:
                break
            yield block, chunk


class _Graph:
    """The classifier process, and the nodes of this process that exchange messages with it."""

    def __init__(self, survey: Survey, task: Task, chunks: Chunks, logs: Path, interrupts: Interrupts) -> None:
        self.survey, self.task, self.chunks, self.interrupts = survey, task, chunks, interrupts
        self.namespace = f"/bow/replay_{task.outline.run_id}_{random_id()[:8]}"
        self.supervisor = Supervisor(self.namespace, logs, {})
        self.context = rclpy.Context()
        rclpy.init(context=self.context, signal_handler_options=SignalHandlerOptions.NO)
        self.executor: Executor = EventsExecutor(context=self.context)
        self.nodes = [self._node(role) for role in LISTENERS]
        self.health = Health()
        self._hello_at = 0.0
        self.answers: deque[bytes] = deque()
        self.states = np.zeros(task.outline.blocks, np.uint8)
        node = self.nodes[0]
        self.plan = node.create_publisher(Plan, "plan", LATCHED)
        self.streams = {name: node.create_publisher(kind, name, STREAM_WRITER) for name, kind in KINDS.items()}
        node.create_subscription(Health, "health", self._on_health, LATCHED_DEEP)
        for each in self.nodes:
            each.create_subscription(Verdicts, "verdicts", partial(self._on_verdicts, each), STREAM, raw=True)

    def _node(self, role: str) -> BowNode:
        node = BowNode(role, namespace=self.namespace, context=self.context)
        node.set_state(Health.READY, "replays a bag", self.task.outline.run_id)
        self.executor.add_node(node)
        return node

    def _on_health(self, message: Health) -> None:
        if message.role == CLASSIFIER:
            self.health = message

    def _on_verdicts(self, node: BowNode, data: bytes) -> None:
        node.heard("verdicts", self.health.incarnation)
        if node is self.nodes[0] and not cdr.hello_from("Verdicts", data):
            self.answers.append(data)

    def _say_hello(self) -> None:
        """Publish empty stream messages until the classifier reports that they arrive."""
        now = time.monotonic()
        if now - self._hello_at >= FIRST_HELLO_S and not self._streams_are_heard():
            self._hello_at = now
            for topic, kind in KINDS.items():
                self.streams[topic].publish(cdr.hello(kind.__name__, self.nodes[0].incarnation))

    def open(self) -> None:
        """Start the classifier; return when it has the plan and all subscriptions are connected."""
        self.supervisor.start(CLASSIFIER)
        self._publish_plan()
        deadline = time.monotonic() + PATIENCE_S
        while not (self.health.state == Health.READY and self._streams_are_heard()):
            self._spin(deadline, "the classifier is ready")
            if self.health.state == Health.FAILED:
                raise GraphError(f"the classifier does not take the plan: {self.health.detail}")

    def _streams_are_heard(self) -> bool:
        known = self.nodes[0].neighbours.get(self.health.incarnation)
        return known is not None and set(KINDS) <= known.hears

    def _publish_plan(self) -> None:
        """Publish the plan of the bag as an open one, with the thresholds of the replay and the state of its blocks."""
        recorded = [line for line in self.survey.plan["spec.settings"] if not line.startswith("classifier.")]
        thresholds = [f"classifier.{line}" for line in self.task.thresholds.settings()]
        changed = {
            "epoch": 1,
            "state": Plan.OPEN,
            "spec.settings": sorted(recorded + thresholds),
            "classifier": self.task.thresholds.hash,
            "block_states": self.states,
            "incarnation": self.nodes[0].incarnation,
        }
        self.plan.publish(cdr.encode("Plan", {**self.survey.plan, **changed}))

    def _spin(self, deadline: float, until: str) -> None:
        """Take in messages; raise GraphError where the classifier has exited or `deadline` has passed."""
        self._say_hello()
        self.executor.spin_once(timeout_sec=0.1)
        self.interrupts.check()
        for exit_ in self.supervisor.exited():
            raise GraphError(f"the classifier ended ({exit_.cause}):\n{tail(exit_.child.log)}")
        if time.monotonic() > deadline:
            logs = "\n".join(tail(child.log) for child in self.supervisor.children)
            raise GraphError(f"waited {PATIENCE_S:g} s until {until}:\n{logs}")

    def verdicts(self) -> Iterator[tuple[Key, dict[str, Any]]]:
        """Yield the fields of Verdicts of each chunk."""
        todo = chunks_in_order(self.survey, self.task)
        left = np.zeros(self.task.outline.blocks, int)
        for block, _ in chunks_in_order(self.survey, self.task):
            left[block] += 1
        under_way: dict[Key, int] = {}  # chunk -> bytes sent
        while True:
            while len(under_way) < LIMIT and sum(under_way.values()) < LIMIT_BYTES:
                key = next(todo, None)
                if key is None:
                    break
                under_way[key] = self._send(key)
            if not under_way:
                return
            deadline = time.monotonic() + PATIENCE_S
            while not self.answers:
                self._spin(deadline, f"block {min(under_way)[0]}, chunk {min(under_way)[1]} is classified")
            while self.answers:
                values = cdr.unseal("Verdicts", self.answers.popleft())
                key = (values["block"], values["chunk"])
                if key not in under_way:
                    continue
                del under_way[key]
                yield key, values
                left[key[0]] -= 1
                if not left[key[0]]:  # as in a live run: the classifier then drops what it keeps of the block
                    self.states[key[0]] = BlockState.DONE
                    self._publish_plan()

    def _send(self, key: Key) -> int:
        """Publish the messages of a chunk; return their size in bytes."""
        size = 0
        for topic, publisher in self.streams.items():
            message = self.chunks.read(self.survey.places[topic][key])
            publisher.publish(message)
            size += len(message)
        return size

    def close(self) -> None:
        """Stop the classifier and leave the graph."""
        at_end(self._leave)
        self.supervisor.stop(idle=True)

    def _leave(self) -> None:
        self.executor.shutdown()
        for node in self.nodes:
            node.destroy_node()
        rclpy.try_shutdown(context=self.context)
