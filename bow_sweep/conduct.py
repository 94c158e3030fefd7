"""`bow sweep`: a graph on this machine, from its first process to the finished run directory."""

from __future__ import annotations

import signal
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from bow_msgs.msg import BasinMap, Health
from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions

from bow_classifier.thresholds import REGIMES
from bow_classifier.warm import warm as warm_classifier
from bow_sim import wire
from bow_sim.kernel import Block
from bow_sim.ros import LATCHED, BowNode, use_local_defaults

from .display import Display, Progress
from .plan import Sweep
from .supervisor import Death, GraphError, Supervisor, tail

LOGS = "log"
INSPECTED = 6
"""Cells whose waveforms the dashboard shows unless told else."""


class Interrupted(Exception):
    """The user asked for the end."""


class SupervisorNode(BowNode):
    """Tells the graph which of its processes have ended, and listens to how the sweep goes on."""

    def __init__(self) -> None:
        super().__init__("supervisor")
        self.progress: Progress | None = None
        self.failed = ""
        self.details: dict[str, str] = {}
        self.news: dict[str, bool] = {}  # for people; True = not yet said
        self.create_subscription(BasinMap, "basin_map", self._on_map, LATCHED, raw=True)
        self.create_subscription(Health, "health", self._on_health, LATCHED)
        self.become(Health.READY)

    def _on_map(self, data: bytes) -> None:
        values = wire.decode("BasinMap", data)
        counts = np.bincount(values["regime"], minlength=256)
        self.progress = Progress(
            done=values["cells_done"],
            quarantined=values["cells_quarantined"],
            planned=len(values["regime"]),
            regimes={name: int(count) for name, count in zip(REGIMES, counts, strict=False)},
        )

    def _on_health(self, message: Health) -> None:
        self.details[message.role] = message.detail
        if message.state == Health.FAILED and message.role in ("recorder", "classifier"):
            self.failed = f"{message.role}: {message.detail}"
        elif message.state == Health.FAILED or message.detail.startswith("rejects blocks"):
            self.news.setdefault(f"{message.node}: {message.detail}", True)
        _, found, command = message.detail.partition("; watch with: ")
        if found:
            self.news.setdefault(f"watch the map grow with: {command}", True)

    def bury(self, death: Death) -> None:
        """Tell the graph that a process has ended."""
        message = Health(
            role=death.child.role,
            node=f"{self.get_namespace()}/{death.child.name}",
            pid=death.child.process.pid,
            host=self.health.host,
            state=Health.DEAD,
            detail=death.cause,
        )
        message.stamp = self.get_clock().now().to_msg()
        self._health_publisher.publish(message)


def inspected_cells(sweep: Sweep) -> list[int]:
    """Return cells spread over the plane, for their waveforms to be shown."""
    columns = np.unique(np.linspace(0, sweep.x.count - 1, INSPECTED // 2 + 2).astype(int)[1:-1])
    rows = np.unique(np.linspace(0, sweep.y.count - 1, 4).astype(int)[1:-1])
    return [int(iy * sweep.x.count + ix) for iy in rows for ix in columns]


def conduct(
    directory: Path,
    run_id: str,
    sweep: Sweep,
    *,
    resume: bool,
    simulators: int,
    dashboard: dict[str, Any] | None,
    display: Display,
) -> None:
    """Run the graph until the run in `directory` is finished.

    Parameters
    ----------
    directory
        Run directory; exists.
    resume
        Go on with the run that is there.
    simulators
        Processes in the pool.
    dashboard
        ROS parameters of the dashboard, None for none.

    Raises
    ------
    GraphError
        Where the graph cannot go on; the run can be resumed once the cause is mended.
    Interrupted
        After Ctrl-C or SIGTERM; everything has been stopped in order.
    """
    use_local_defaults()
    coordinator: dict[str, object] = {"once": True}
    if resume:
        coordinator["resume"] = str(directory)
    else:
        spec = {"preset": sweep.preset, "settings": list(sweep.settings())}
        coordinator |= {"run_dir": str(directory), "run_id": run_id, **spec}
    parameters: dict[str, dict[str, object]] = {
        "coordinator": coordinator,
        "recorder": {"run_dir": str(directory)},
        "dashboard": {"run_dir": str(directory), **(dashboard or {})},
        "simulator": {"inspect": inspected_cells(sweep)},
    }
    supervisor = Supervisor(f"/bow/{run_id}", directory / LOGS, parameters)
    handlers = {number: signal.signal(number, _interrupt) for number in (signal.SIGINT, signal.SIGTERM)}
    words = ["bow", "--ros-args", "-r", f"__ns:={supervisor.namespace}"]
    rclpy.init(args=words, signal_handler_options=SignalHandlerOptions.NO)
    node, executor, finished = None, EventsExecutor(), False
    try:
        for role in ["coordinator", "recorder", *(["dashboard"] if dashboard is not None else [])]:
            supervisor.start(role)
        Block(sweep.parameters, sweep.lanes(sweep.block(0))).advance()  # from here on the compiler's cache has it
        warm_classifier()
        for role in ["classifier"] + ["simulator"] * simulators:
            supervisor.start(role)
        node = SupervisorNode()
        executor.add_node(node)
        _watch(supervisor, node, executor, display)
        finished = True
    finally:
        for number in handlers:
            signal.signal(number, _second_interrupt)
        display.stop()
        killed = supervisor.stop(idle=finished)
        if killed:
            display.say(f"had to kill {', '.join(child.name for child in killed)}: no answer to SIGINT")
        executor.shutdown()
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
        for number, handler in handlers.items():
            signal.signal(number, handler)


def _interrupt(*_: object) -> None:
    raise Interrupted


def _second_interrupt(*_: object) -> None:
    print("\nstopping the processes; a few seconds", file=sys.stderr)


def _watch(supervisor: Supervisor, node: SupervisorNode, executor: Executor, display: Display) -> None:
    """Spin until the coordinator has finished; start again what dies."""
    while True:
        executor.spin_once(timeout_sec=0.05)
        for death in supervisor.buried():
            if death.child.role == "coordinator":
                if death.status == 0:
                    return
                raise GraphError(f"the coordinator ended ({death.cause}):\n{tail(death.child.log)}")
            display.say(f"{death.child.name} ended ({death.cause}), starting it again; see {death.child.log}")
            node.bury(death)
            supervisor.revive(death)
        if node.failed:
            raise GraphError(node.failed)
        for line in [text for text, new in node.news.items() if new]:
            node.news[line] = False
            display.say(line)
        display.show(node.progress, node.details.get("coordinator", ""), time.monotonic())
