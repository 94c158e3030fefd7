"""The graph as ROS users start it: nodes one by one, a goal from a client, random bytes on the topics."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import rclpy
import yaml
from action_msgs.msg import GoalStatus
from bow_msgs.action import RunSweep
from bow_msgs.msg import BasinMap, BridgeForce, Health, InspectedCell, Plan, Receipt, StickSlip, SweepSpec, Verdicts
from graph import PATIENCE_S, assert_same_map, gated, sweeping, verified
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from bow_sim.graph.node_base import INSPECT, LATCHED, STREAM, STREAM_WRITER
from bow_sim.protocol import cdr

ROOT = Path(__file__).resolve().parents[2]
SETTINGS = ["x.count=16", "y.count=8", "block_cells=8"]

pytestmark = pytest.mark.usefixtures("ros_domain")


class Client:
    """An action client with a context of its own."""

    def __init__(self) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.node: Node = rclpy.create_node("client", namespace="/bow", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.action = ActionClient(self.node, RunSweep, "run_sweep")

    def until(self, future: rclpy.Future) -> object:
        self.executor.spin_until_future_complete(future, PATIENCE_S)
        assert future.done()
        return future.result()

    def close(self) -> None:
        self.executor.shutdown()
        self.action.destroy()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def client(ros_domain: int) -> Iterator[Client]:
    made = Client()
    yield made
    made.close()


@pytest.fixture
def gate(tmp_path: Path) -> Path:
    """The file that says how many chunks the simulator may publish; without it, all of them."""
    return tmp_path / "gate"


@pytest.fixture
def nodes(ros_domain: int, tmp_path: Path, gate: Path) -> Iterator[Path]:
    """The nodes of a graph without a supervisor, as `ros2 run` starts them, its simulator gated; yields runs_dir."""
    runs = tmp_path / "runs"
    defaults = ["--ros-args", "--params-file", str(ROOT / "config" / "nodes.yaml")]
    places = {role: ["-p", f"runs_dir:={runs}"] for role in ("coordinator", "recorder", "dashboard")}
    processes = [
        subprocess.Popen([sys.executable, "-m", "bow_sweep", role, *defaults, *places.get(role, [])])
        for role in ("coordinator", "recorder", "dashboard", "classifier")
    ]
    with gated(gate):
        processes.append(subprocess.Popen([sys.executable, "-m", "gated_simulator", *defaults]))
    yield runs
    for process in processes:
        process.terminate()
    assert [process.wait(30) for process in processes] == [0] * len(processes)


def send(client: Client, spec: SweepSpec, feedback: list | None = None) -> object:
    assert client.action.wait_for_server(PATIENCE_S)
    seen = feedback if feedback is not None else []
    return client.until(client.action.send_goal_async(RunSweep.Goal(spec=spec), feedback_callback=seen.append))


def test_a_goal_runs_a_sweep_while_another_node_publishes_rubbish(
    nodes: Path, client: Client, undisturbed: Path
) -> None:
    for preset, settings, reason in (
        ("nope", [], "preset 'nope'"),
        ("fig11d", ["f_asym=-1"], "f_asym"),
        ("fig11d", ["x.count=0"], "x.count = 0"),
    ):
        refused = send(client, SweepSpec(preset=preset, settings=settings))
        ended = client.until(refused.get_result_async())  # type: ignore[attr-defined]
        assert ended.status == GoalStatus.STATUS_ABORTED
        assert reason in ended.result.message, "the client gets the reason"
        assert ended.result.run_id == ""

    feedback: list = []
    goal = send(client, SweepSpec(preset="fig11d", settings=SETTINGS), feedback)
    assert goal.accepted  # type: ignore[attr-defined]
    stop = threading.Event()
    publisher = threading.Thread(target=publish_rubbish, args=(client.node, stop))
    publisher.start()
    answer = client.until(goal.get_result_async())  # type: ignore[attr-defined]
    stop.set()
    publisher.join()
    result = answer.result  # type: ignore[attr-defined]
    assert (result.cells_planned, result.cells_done, result.cells_quarantined) == (128, 128, 0), result.message
    run = Path(result.directory)
    assert run.is_absolute()
    assert run == nodes / result.run_id
    verified(run)
    assert_same_map(undisturbed, run)
    for message in feedback:
        f = message.feedback
        assert f.cells_planned == f.cells_done + f.cells_quarantined + f.cells_outstanding == 128


def test_a_cancelled_sweep_closes_its_bag_and_can_be_resumed(nodes: Path, client: Client, gate: Path) -> None:
    gate.write_text("50")  # two and a half blocks
    goal = send(client, SweepSpec(preset="fig11d", settings=["x.count=32", "y.count=24", "block_cells=16"]))
    ledgers: list[Path] = []
    while not ledgers or b'"done"' not in ledgers[0].read_bytes():
        ledgers = list(nodes.glob("*/ledger.jsonl"))
        client.executor.spin_once(0.1)
    client.until(goal.cancel_goal_async())  # type: ignore[attr-defined]
    answer = client.until(goal.get_result_async())  # type: ignore[attr-defined]
    assert answer.status == GoalStatus.STATUS_CANCELED  # type: ignore[attr-defined]
    run = ledgers[0].parent
    assert ledgers[0].read_bytes().count(b'"done"') <= 2, "the simulator has waited"
    assert (run / "bag" / "metadata.yaml").exists()
    with sweeping(run, "--resume", str(run)) as sweep:
        assert sweep.wait() == 0, sweep.text
    assert verified(run)["cells"] == 768


def publish_rubbish(node: Node, stop: threading.Event) -> None:
    """Publish random bytes, messages of an unknown run, and messages whose arrays do not fit each other."""
    kinds = {"bridge_force": BridgeForce, "stick_slip": StickSlip, "verdicts": Verdicts, "receipts": Receipt}
    latched = {"plan": Plan, "health": Health, "basin_map": BasinMap}
    publishers = [
        node.create_publisher(kind, topic, STREAM_WRITER if kind is BridgeForce else STREAM)
        for topic, kind in kinds.items()
    ]
    latched_ones = [node.create_publisher(kind, topic, LATCHED) for topic, kind in latched.items()]
    latched_ones.append(node.create_publisher(InspectedCell, "inspect", INSPECT))
    rng = np.random.default_rng(1)
    common = {"run_id": "x", "sweep_id": "y", "block": 2**32 - 1, "chunk": 0, "attempt": 1, "incarnation": "z"}
    odd = {**common, "cells": np.arange(3), "first_sample": 0, "samples": 9, "data": np.full(5, np.nan)}
    messages = [
        cdr.ENCAPSULATION + rng.bytes(400),
        cdr.ENCAPSULATION,
        cdr.encode("BridgeForce", odd),
        cdr.encode("BridgeForce", {**odd, "samples": 2**32 - 1}),
    ]
    while not stop.wait(0.01):
        for publisher in publishers:
            for message in messages:
                publisher.publish(message)
        for publisher in latched_ones:
            publisher.publish(cdr.ENCAPSULATION + rng.bytes(int(rng.integers(200))))
            publisher.publish(cdr.ENCAPSULATION + b"\xff\xff\xff\x7f" * 20)


def test_the_parameter_file_names_what_the_nodes_declare() -> None:
    packages = ("bow_sim", "bow_classifier", "bow_sweep")
    text = {path: path.read_text() for room in packages for path in (ROOT / room).rglob("*.py")}
    declaring = "".join(content for content in text.values() if "(BowNode)" in content)
    for node in yaml.safe_load((ROOT / "config" / "nodes.yaml").read_text()).values():
        for name in node["ros__parameters"]:
            assert f'"{name}"' in declaring, name


def test_a_simulator_alone_is_not_ready(client: Client) -> None:
    process = subprocess.Popen([sys.executable, "-m", "bow_sweep", "simulator"])
    states: list = []
    client.node.create_subscription(Health, "health", lambda m: states.append((m.role, m.state)), 10)
    deadline = time.monotonic() + 60
    while len(states) < 3 and time.monotonic() < deadline:
        client.executor.spin_once(0.1)
    process.terminate()
    assert process.wait(30) == 0
    assert states
    assert set(states) <= {("simulator", Health.STARTING), ("simulator", Health.CLOSED)}
