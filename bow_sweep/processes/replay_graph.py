"""Judges a bag through DDS: the recorded plan and streams go to a classifier node of its own process, verdicts return.

The graph lives in a namespace of its own, ``/bow/replay_<run_id>_<random>``, on this machine. It has the parts of a
live one as the classifier sees them: who says the plan is the coordinator, and coordinator and recorder listen to
verdicts. No more chunks are under way than a simulator's credit allows, so memory stays bounded as in a live run.
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
from bow_sim.graph.node_base import HEARD, LATCHED, STREAM, WAVES, BowNode
from bow_sim.protocol import cdr
from bow_sim.protocol.flow_control import LIMIT, LIMIT_BYTES
from bow_sim.protocol.identity import random_id
from bow_sim.protocol.neighbours import FIRST_HELLO_S
from bow_sweep.processes.interrupts import Ending
from bow_sweep.processes.supervisor import GraphError, Supervisor, tail
from bow_sweep.record.bag_contents import Chunks, Key, Survey
from bow_sweep.record.expected import DONE

CLASSIFIER = "classifier"
LISTENERS = ("coordinator", "recorder")
"""Who has to hear verdicts before the classifier takes itself for ready."""

KINDS = {"bridge_force": BridgeForce, "stick_slip": StickSlip}

PATIENCE_S = 60.0
"""Nothing takes so long: neither the classifier's start nor one chunk."""


def judge_in_graph(survey: Survey, task: Task) -> Iterator[tuple[Key, dict[str, Any]]]:
    """Yield (chunk, fields of Verdicts) as they come, for all chunks that the bag has in order.

    Raises
    ------
    GraphError
        Where the classifier process ends, does not take the plan, or does not answer.
    BagError
        Where a stored message cannot be read again.
    KeyboardInterrupt
        Where the end is asked for by Ctrl-C or SIGTERM.
    """
    apply_defaults()
    with (
        Ending("stopping the classifier; a few seconds") as ending,
        tempfile.TemporaryDirectory(prefix="bow-replay-") as logs,
        Chunks() as chunks,
    ):
        graph = _Graph(survey, task, chunks, Path(logs), ending)
        try:
            graph.open()
            yield from graph.verdicts()
        finally:
            graph.close()


def chunks_in_order(survey: Survey, task: Task) -> Iterator[Key]:
    """Yield the chunks whose two messages are stored; of each block up to the first that is not whole."""
    force, slip = (survey.places[topic] for topic in ("bridge_force", "stick_slip"))
    for block in range(task.blocks):
        for chunk in range(task.chunks):
            if (block, chunk) not in force or (block, chunk) not in slip:
                break
            yield block, chunk


class _Graph:
    """The classifier's process, and the nodes of this one that talk to it."""

    def __init__(self, survey: Survey, task: Task, chunks: Chunks, logs: Path, ending: Ending) -> None:
        self.survey, self.task, self.chunks, self.ending = survey, task, chunks, ending
        self.namespace = f"/bow/replay_{task.run_id}_{random_id()[:8]}"
        self.supervisor = Supervisor(self.namespace, logs, {})
        self.context = rclpy.Context()
        rclpy.init(context=self.context, signal_handler_options=SignalHandlerOptions.NO)
        self.executor: Executor = EventsExecutor(context=self.context)
        self.nodes = [self._node(role) for role in LISTENERS]
        self.health = Health()
        self._said = 0.0
        self.answers: deque[bytes] = deque()
        self.states = np.zeros(task.blocks, np.uint8)
        node = self.nodes[0]
        self.plan = node.create_publisher(Plan, "plan", LATCHED)
        self.streams = {name: node.create_publisher(kind, name, WAVES) for name, kind in KINDS.items()}
        node.create_subscription(Health, "health", self._on_health, HEARD)
        for each in self.nodes:
            each.create_subscription(Verdicts, "verdicts", partial(self._on_verdicts, each), STREAM, raw=True)

    def _node(self, role: str) -> BowNode:
        node = BowNode(role, namespace=self.namespace, context=self.context)
        node.become(Health.READY, "replays a bag", self.task.run_id)
        self.executor.add_node(node)
        return node

    def _on_health(self, message: Health) -> None:
        if message.role == CLASSIFIER:
            self.health = message

    def _on_verdicts(self, node: BowNode, data: bytes) -> None:
        node.heard("verdicts", self.health.incarnation)
        if node is self.nodes[0] and not cdr.hello_from("Verdicts", data):
            self.answers.append(data)

    def say_hello(self) -> None:
        """Show the classifier our streams until it says that it hears them."""
        now = time.monotonic()
        if now - self._said >= FIRST_HELLO_S and not self._streams_are_heard():
            self._said = now
            for topic, kind in KINDS.items():
                self.streams[topic].publish(cdr.hello(kind.__name__, self.nodes[0].incarnation))

    def open(self) -> None:
        """Start the classifier; return when it has the plan and everybody hears everybody."""
        self.supervisor.start(CLASSIFIER)
        self.say_plan()
        deadline = time.monotonic() + PATIENCE_S
        while not (self.health.state == Health.READY and self._streams_are_heard()):
            self.spin(deadline, "the classifier is ready")
            if self.health.state == Health.FAILED:
                raise GraphError(f"the classifier does not take the plan: {self.health.detail}")

    def _streams_are_heard(self) -> bool:
        known = self.nodes[0].neighbours.get(self.health.incarnation)
        return known is not None and set(KINDS) <= known.hears

    def say_plan(self) -> None:
        """Publish the plan of the bag as one in progress, with the thresholds and settled blocks of the replay."""
        others = [line for line in self.survey.plan["spec.settings"] if not line.startswith("classifier.")]
        mine = [f"classifier.{line}" for line in self.task.thresholds.settings()]
        changed = {
            "epoch": 1,
            "state": Plan.OPEN,
            "spec.settings": sorted(others + mine),
            "classifier": self.task.thresholds.hash,
            "block_states": self.states,
            "incarnation": self.nodes[0].incarnation,
        }
        self.plan.publish(cdr.encode("Plan", {**self.survey.plan, **changed}))

    def spin(self, deadline: float, until: str) -> None:
        """Take in what comes; raise where the classifier is gone or `deadline` has passed."""
        self.say_hello()
        self.executor.spin_once(timeout_sec=0.1)
        self.ending.check()
        for death in self.supervisor.buried():
            raise GraphError(f"the classifier ended ({death.cause}):\n{tail(death.child.log)}")
        if time.monotonic() > deadline:
            logs = "\n".join(tail(child.log) for child in self.supervisor.children)
            raise GraphError(f"waited {PATIENCE_S:g} s until {until}:\n{logs}")

    def verdicts(self) -> Iterator[tuple[Key, dict[str, Any]]]:
        """Yield what the classifier says of each chunk."""
        todo = chunks_in_order(self.survey, self.task)
        left = np.zeros(self.task.blocks, int)
        for block, _ in chunks_in_order(self.survey, self.task):
            left[block] += 1
        waiting: dict[Key, int] = {}  # with their bytes
        while True:
            while (
                len(waiting) < LIMIT and sum(waiting.values()) < LIMIT_BYTES and (key := next(todo, None)) is not None
            ):
                waiting[key] = self._send(key)
            if not waiting:
                return
            deadline = time.monotonic() + PATIENCE_S
            while not self.answers:
                self.spin(deadline, f"block {min(waiting)[0]}, chunk {min(waiting)[1]} is judged")
            while self.answers:
                values = cdr.unseal("Verdicts", self.answers.popleft())
                key = (values["block"], values["chunk"])
                if key not in waiting:
                    continue
                del waiting[key]
                yield key, values
                left[key[0]] -= 1
                if not left[key[0]]:  # as a live coordinator does: the classifier then forgets the block
                    self.states[key[0]] = DONE
                    self.say_plan()

    def _send(self, key: Key) -> int:
        """Publish a chunk's messages; return their bytes."""
        size = 0
        for topic, publisher in self.streams.items():
            message = self.chunks.read(self.survey.places[topic][key])
            publisher.publish(message)
            size += len(message)
        return size

    def close(self) -> None:
        """Stop the classifier and leave the graph."""
        self.supervisor.stop(idle=True)
        self.executor.shutdown()
        for node in self.nodes:
            node.destroy_node()
        rclpy.try_shutdown(context=self.context)
