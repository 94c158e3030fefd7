"""The classifier as a real process on a real graph: streams over DDS in, verdicts out."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from functools import partial

import numpy as np
import pytest
import rclpy
from bow_msgs.msg import BridgeForce, Health, Plan, StickSlip, SweepSpec, Verdicts
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import deserialize_message

from bow_classifier.block_classifier import BlockClassifier, Geometry
from bow_classifier.features.slips import Intervals
from bow_classifier.node import ClassifierNode
from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.graph.node_base import LATCHED, STREAM, STREAM_WRITER, BowNode, RCLError
from bow_sim.kernel.block import Block
from bow_sim.physics.parameters import Parameters
from bow_sim.protocol import cdr

RUN, SWEEP, NAMESPACE = "0123456789abcdef", "fedcba9876543210", "/bow/test"
PARAMETERS = Parameters(v_mid=0.2, periods=30)
LANES = {"f_asym": np.linspace(1, 8, 6), "f_init_ratio": np.ones(6)}
SETTINGS = [
    *("x.name=f_asym", "x.scale=linear", "x.first=1", "x.last=8", "x.count=6"),
    *("y.name=f_init_ratio", "y.scale=linear", "y.first=1", "y.last=1", "y.count=1"),
    *("block_cells=6", "classifier.correlation=0.9"),
    *(line for line in PARAMETERS.settings() if not line.startswith("f_")),
]
THRESHOLDS = Thresholds(correlation=0.9)


class Graph:
    """What coordinator, simulator and recorder would be to the classifier."""

    def __init__(self, context: Context | None) -> None:
        self.context = context
        rclpy.init(context=self.context)
        self.node = BowNode("coordinator", namespace=NAMESPACE, context=self.context)
        self.recorder = BowNode("recorder", namespace=NAMESPACE, context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        for node in (self.node, self.recorder):
            node.set_state(Health.BUSY, "", RUN)
            self.executor.add_node(node)
        self.recorder.create_subscription(Verdicts, "verdicts", partial(self.take, self.recorder), STREAM, raw=True)
        self.verdicts: list[bytes] = []
        self.health: dict[str, Health] = {}
        self.plan = self.node.create_publisher(Plan, "plan", LATCHED)
        self.streams = {
            "BridgeForce": self.node.create_publisher(BridgeForce, "bridge_force", STREAM_WRITER),
            "StickSlip": self.node.create_publisher(StickSlip, "stick_slip", STREAM_WRITER),
        }
        self.node.create_subscription(Verdicts, "verdicts", partial(self.take, self.node), STREAM, raw=True)
        self.node.create_subscription(Health, "health", lambda m: self.health.update({m.role: m}), LATCHED)

    def take(self, node, data):
        node.heard("verdicts", cdr.decode_head("Verdicts", data)["incarnation"])
        if node is self.node and not cdr.hello_from("Verdicts", data):
            self.verdicts.append(data)

    def until(self, what, seconds=60.0):
        """Let the graph go on until `what` holds."""
        end = time.monotonic() + seconds
        while not what():
            assert time.monotonic() < end, f"{self.health}, {len(self.verdicts)} verdicts"
            self.executor.spin_once(timeout_sec=0.05)

    def announce(self, **changes):
        message = Plan(run_id=RUN, sweep_id=SWEEP, epoch=1, state=Plan.OPEN, spec=SweepSpec(settings=SETTINGS))
        message.incarnation = self.node.incarnation
        message.classifier, message.block_states = THRESHOLDS.hash, b"\x00"
        for name, value in changes.items():
            setattr(message, name, value)
        self.plan.publish(message)

    def send(self, simulated, chunk, attempt=1):
        for name, publisher in self.streams.items():
            publisher.publish(encode(simulated, name, chunk, attempt))

    def close(self):
        self.executor.shutdown()
        self.node.destroy_node()
        self.recorder.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture(scope="module")
def simulated():
    block = Block(PARAMETERS, LANES)
    return [block.advance() for _ in range(PARAMETERS.chunks)]


def encode(simulated, name, chunk, attempt=1):
    values = {"run_id": RUN, "sweep_id": SWEEP, "block": 0, "chunk": chunk, "attempt": attempt, "incarnation": "s"}
    values |= {"cells": np.arange(6), "first_sample": 695 * chunk, "samples": 695}
    values |= {"data": simulated[chunk].bridge_force, **simulated[chunk]._asdict()}
    return cdr.encode(name, values)


@pytest.fixture
def classifier(ros_domain):
    """The node's process."""
    command = [sys.executable, "-m", "bow_classifier.node", "--ros-args", "-r", f"__ns:={NAMESPACE}"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    yield process
    if process.poll() is None:
        process.kill()
        process.communicate()


@pytest.fixture
def graph(ros_domain):
    graph = Graph(Context())
    yield graph
    graph.close()


def stop(process, number=signal.SIGINT):
    process.send_signal(number)
    output, _ = process.communicate(timeout=60)
    return process.returncode, output.decode()


def test_a_sweep_is_judged_duplicates_answered_and_the_rest_ignored(graph, classifier, simulated):
    graph.until(lambda: "classifier" in graph.health)
    assert graph.health["classifier"].state == Health.STARTING
    graph.announce()
    graph.until(lambda: graph.health["classifier"].state == Health.READY)
    assert graph.health["classifier"].run_id == RUN
    streams = graph.streams.values()
    graph.until(lambda: all(p.get_subscription_count() for p in streams))
    graph.until(lambda: graph.node.count_publishers(f"{NAMESPACE}/verdicts"))

    graph.send(simulated, 2)  # too early
    graph.streams["StickSlip"].publish(encode(simulated, "StickSlip", 0)[:100])  # rubbish
    graph.streams["BridgeForce"].publish(encode(simulated, "BridgeForce", 0).replace(RUN.encode(), b"f" * 16))
    for chunk in range(PARAMETERS.chunks):
        graph.send(simulated, chunk)
    graph.until(lambda: len(graph.verdicts) == PARAMETERS.chunks)
    graph.send(simulated, 3, attempt=2)
    graph.until(lambda: len(graph.verdicts) == PARAMETERS.chunks + 1)
    graph.until(lambda: graph.health["classifier"].messages == 2 * PARAMETERS.chunks + 6)

    block = BlockClassifier(Geometry.of(PARAMETERS), THRESHOLDS, 6)
    for chunk, data in enumerate(graph.verdicts[:-1]):
        verdict = cdr.unseal("Verdicts", data)
        assert cdr.identity(verdict) == (RUN, SWEEP, 0, chunk, 1)
        assert verdict["classifier"] == THRESHOLDS.hash
        assert verdict["incarnation"] == graph.health["classifier"].incarnation
        expected = block.classify(
            simulated[chunk].bridge_force, Intervals(*(getattr(simulated[chunk], n) for n in Intervals._fields))
        )
        for name, values in expected._asdict().items():
            assert verdict[name].tobytes() == values.tobytes()
        assert deserialize_message(data, Verdicts).corners.tolist() == expected.corners.tolist()
    again = cdr.unseal("Verdicts", graph.verdicts[-1])
    assert cdr.identity(again) == (RUN, SWEEP, 0, 3, 2)
    assert again["checksum"] == cdr.unseal("Verdicts", graph.verdicts[3])["checksum"]
    health = graph.health["classifier"]
    assert (health.duplicates, health.ignored) == (2, 4)

    graph.announce(state=Plan.CLOSED)
    graph.until(lambda: graph.health["classifier"].state == Health.STARTING)
    status, output = stop(classifier)
    assert status == 0, output
    assert "chunk 0 comes first" in output
    assert "Traceback" not in output


def test_a_sweep_it_cannot_judge_is_refused_aloud(graph, classifier):
    graph.announce(classifier="0" * 16)
    graph.until(lambda: "classifier" in graph.health and graph.health["classifier"].state == Health.FAILED)
    assert THRESHOLDS.hash in graph.health["classifier"].detail
    status, output = stop(classifier, signal.SIGTERM)
    assert status == 0, output
    assert "cannot judge this sweep" in output


def test_a_verdict_that_cannot_go_out_is_kept_and_the_subscribers_named(ros_domain, monkeypatch):
    graph = Graph(None)  # the classifier's context: one participant in one process
    classifier = ClassifierNode()
    try:
        said, sent, hangs = [], [], True

        class Hanging:
            topic_name = f"{NAMESPACE}/verdicts"

            def publish(self, data):
                if hangs:
                    raise RCLError("cannot publish data")
                sent.append(data)

        class Log:
            def warning(self, text, **_):
                said.append(text)

        listeners = lambda: classifier.get_subscriptions_info_by_topic(Hanging.topic_name)
        graph.until(lambda: {listener.node_name for listener in listeners()} == {"coordinator", "recorder"})
        outbox = classifier._outbox
        monkeypatch.setattr(outbox, "_publisher", Hanging())
        monkeypatch.setattr(classifier, "get_logger", Log)
        outbox.send([b"first"])
        outbox.send([b"second", b"third"])
        assert sent == []
        assert "(coordinator, recorder)" in said[0]
        assert "cannot publish data" in said[0]
        assert len(said) == 1  # the timer tries again; each message does not
        outbox.flush()
        assert len(said) == 2
        hangs = False
        outbox.flush()
        outbox.send([b"fourth"])
        assert sent == [b"first", b"second", b"third", b"fourth"]
    finally:
        classifier.destroy_node()
        graph.close()


def test_its_help_teaches():
    output = subprocess.run(
        [sys.executable, "-m", "bow_classifier.node", "--help"], capture_output=True, text=True, check=True
    ).stdout
    for word in ("usage: ros2 run bow classifier", "verdicts", "bridge_force", "bow replay", "Ctrl-C"):
        assert word in output
