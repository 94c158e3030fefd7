"""Nodes that somebody has started by hand, each in a terminal of its own, and a node of the test's among them."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from bow_msgs.action import RunSweep
from bow_msgs.msg import Health, SweepSpec
from graph import PATIENCE_S, gated
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

from bow_sim.graph.node_base import LATCHED_DEEP

SETTINGS = ["x.count=16", "y.count=8", "block_cells=8"]
"""The small sweep of `graph.SMALL`."""


class Desk:
    """Nodes that somebody has started, each in a terminal of its own, and a node of the test's."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.folder, self.arguments = folder, arguments
        self.gate = folder / "gate"
        """Says how many chunks of a run each simulator publishes; without it, all."""
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node("desk", namespace="/bow", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.action = ActionClient(self.node, RunSweep, "run_sweep")
        self.health: dict[int, Health] = {}
        self.node.create_subscription(Health, "health", lambda m: self.health.update({m.pid: m}), LATCHED_DEEP)

    def start(self, role: str, name: str = "", *arguments: str) -> subprocess.Popen[bytes]:
        """Start a node under a name of the test's."""
        words = ["-r", f"__node:={name}"] if name else []
        if role in ("coordinator", "recorder", "dashboard"):
            words += ["-p", f"runs_dir:={self.folder / 'runs'}"]
        label = name or role
        while label in self.processes:
            label += "+"
        program = ["gated_simulator"] if role == "simulator" else ["bow_sweep", role]
        command = [sys.executable, "-m", *program, "--ros-args", *words, *self.arguments, *arguments]
        with open(self.folder / f"{label}.log", "wb") as output, gated(self.gate):
            process = subprocess.Popen(command, stdout=output, stderr=output)
        self.processes[label] = process
        return process

    def start_all(self) -> None:
        for role in ("coordinator", "recorder", "classifier", "simulator"):
            self.start(role, "sim" if role == "simulator" else "")

    def incarnation(self, label: str) -> str:
        """Return the incarnation of a node, from its heartbeat; "" before the first."""
        found = self.health.get(self.processes[label].pid)
        return found.incarnation if found else ""

    def text(self, label: str) -> str:
        return (self.folder / f"{label}.log").read_text()

    def until(self, what: Callable[[], bool], said: str, seconds: float = 60.0) -> None:
        deadline = time.monotonic() + seconds
        while not what():
            if time.monotonic() > deadline:
                logs = "\n".join(f"--- {label}\n{self.text(label)[-2000:]}" for label in self.processes)
                pytest.fail(f"waited until {said}:\n{logs}")
            self.executor.spin_once(timeout_sec=0.05)

    def wait(self, future: Any) -> Any:
        self.until(future.done, "an answer comes", PATIENCE_S)
        return future.result()

    def call(self, client: Any, request: Any) -> Any:
        """Call a service; again every five seconds, as it cannot answer who it is not matched with yet."""
        asked: list[tuple[float, Any]] = []

        def answered() -> bool:
            if not asked or time.monotonic() - asked[-1][0] > 5:
                asked.append((time.monotonic(), client.call_async(request)))
            return any(answer.done() for _, answer in asked)

        self.until(answered, "a service answers", PATIENCE_S)
        return next(answer.result() for _, answer in asked if answer.done())

    def send(self, *settings: str, preset: str = "fig11d") -> Any:
        """Send a goal; return its handle."""
        assert self.action.wait_for_server(PATIENCE_S)
        spec = SweepSpec(preset=preset, settings=[*SETTINGS, *settings])
        handle = self.wait(self.action.send_goal_async(RunSweep.Goal(spec=spec)))
        assert handle.accepted
        return handle

    def sweep(self, *settings: str) -> Path:
        """Run a sweep to its end, which must be a good one; return its directory."""
        result = self.wait(self.send(*settings).get_result_async()).result
        assert result.cells_done == result.cells_planned > 0, result.message
        return Path(result.directory)

    def close(self) -> None:
        for process in self.processes.values():
            process.terminate()
        statuses = {label: process.wait(30) for label, process in self.processes.items()}
        self.executor.shutdown()
        self.action.destroy()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)
        assert not {label: status for label, status in statuses.items() if status not in (0, 1)}


@contextlib.contextmanager
def desk(folder: Path, *arguments: str) -> Iterator[Desk]:
    made = Desk(folder, *arguments)
    try:
        yield made
    finally:
        made.close()
