"""The node beside the processes of `bow sweep`: tells the graph which have ended, and people how the sweep goes on."""

from __future__ import annotations

import contextlib
import gc
import time

import numpy as np
import rclpy
from bow_msgs.msg import BasinMap, Health, Plan
from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions

from bow_classifier.regimes import REGIMES
from bow_sim import wire
from bow_sim.reach import apply_defaults
from bow_sim.ros import CONSUMERS, HEARD, LATCHED, LEAVE_S, BowNode, end_after, leave

from .display import Display, Progress
from .ending import Ending
from .supervisor import Death, GraphError, Supervisor, tail

STUCK_S = 12.0
"""A process that knows of the run and has not met the others for so long is started again: where one was killed, Fast
DDS sometimes does not connect its successor."""

NOTE = "; note: "
"""In what a node says of itself, before each thing that people should read; below, beginnings of such."""

NEWS = ("rejects blocks", "not drawn: ", "waiting for the dashboard")


class SupervisorNode(BowNode):
    """Tells the graph which of its processes have ended, and listens to how the sweep goes on."""

    def __init__(self) -> None:
        super().__init__("supervisor")
        self.progress: Progress | None = None
        self.failed = ""
        self.details: dict[str, str] = {}
        self.news: dict[str, bool] = {}  # for people; True = not yet said
        self.worked: set[int] = set()  # processes that were ready once
        self.closed = False  # the plan is: nothing more will be simulated
        self._starting: dict[int, tuple[str, float]] = {}  # pid -> role, and since when it looks for the others
        self._deaths = self.create_publisher(Health, "health", HEARD)  # so that none is lost behind the next
        self.create_subscription(BasinMap, "basin_map", self._on_map, LATCHED, raw=True)
        self.create_subscription(Health, "health", self._on_health, HEARD)
        self.create_subscription(Plan, "plan", self._on_plan, HEARD, raw=True)
        self.become(Health.READY)

    def _on_map(self, data: bytes) -> None:
        try:
            values = wire.decode("BasinMap", data)
        except wire.WireError:
            return
        counts = np.bincount(values["regime"], minlength=256)
        self.progress = Progress(
            done=values["cells_done"],
            quarantined=values["cells_quarantined"],
            planned=sum(values[f"cells_{name}"] for name in ("done", "quarantined", "outstanding")),
            regimes={name: int(count) for name, count in zip(REGIMES, counts, strict=False)},
        )

    def _on_plan(self, data: bytes) -> None:
        with contextlib.suppress(wire.WireError):
            plan = wire.decode("Plan", data)
            self.closed |= plan["state"] == Plan.CLOSED and self.get_namespace() == f"/bow/{plan['run_id']}"

    def _on_health(self, message: Health) -> None:
        self.details[message.role] = message.detail
        if message.host == self.health.host:
            self._note_start(message, time.monotonic())
        if message.state == Health.FAILED and message.role in CONSUMERS:
            self.failed = f"{message.role}: {message.detail}"
        elif message.state == Health.FAILED or message.detail.startswith(NEWS):
            self.news.setdefault(f"{message.node}: {message.detail}", True)
        for note in message.detail.split(NOTE)[1:]:
            self.news.setdefault(note, True)

    def _note_start(self, message: Health, now: float) -> None:
        if message.state in (Health.READY, Health.BUSY):
            self.worked.add(message.pid)
        if message.state == Health.STARTING and message.run_id:
            self._starting.setdefault(message.pid, (message.role, now))
        else:
            self._starting.pop(message.pid, None)

    def stuck(self, now: float) -> set[int]:
        """Return the processes that do not find the others; all others have as long again to find their successors.

        Simulators are blamed only where the consumers, for which they wait, have found everybody.
        """
        waits = any(role in CONSUMERS for role, _ in self._starting.values())
        blamed = CONSUMERS if waits else ("simulator",)
        stuck = {pid for pid, (role, since) in self._starting.items() if role in blamed and now - since > STUCK_S}
        if stuck:
            self._starting = {pid: (role, now) for pid, (role, _) in self._starting.items() if pid not in stuck}
        return stuck

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
        self._deaths.publish(message)


def watch(supervisor: Supervisor, display: Display, ending: Ending) -> None:
    """Watch over a graph and show its progress until the coordinator has finished; start again what dies.

    Raises
    ------
    GraphError
        Where the graph cannot go on.
    KeyboardInterrupt
        Where the end is asked for.
    """
    apply_defaults()
    gc.freeze()  # what is loaded stays: what comes now is to go, to the last reference
    try:
        _live(supervisor, display, ending)
    finally:
        leave()
        end_after(0)


def _live(supervisor: Supervisor, display: Display, ending: Ending) -> None:
    """Be a node of the graph while it is watched."""
    words = ["bow", "--ros-args", "-r", f"__ns:={supervisor.namespace}"]
    rclpy.init(args=words, signal_handler_options=SignalHandlerOptions.NO)
    executor = EventsExecutor()
    node = None
    try:
        node = SupervisorNode()
        executor.add_node(node)
        _watch(supervisor, node, executor, display, ending)
    finally:
        end_after(LEAVE_S)
        executor.shutdown()
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()


def _watch(supervisor: Supervisor, node: SupervisorNode, executor: Executor, display: Display, ending: Ending) -> None:
    """Spin until the coordinator has finished; start again what dies."""
    while True:
        executor.spin_once(timeout_sec=0.05)
        ending.check()
        for death in supervisor.buried():
            if death.child.role == "coordinator":
                if death.status == 0:
                    return
                raise GraphError(f"the coordinator ended ({death.cause}):\n{tail(death.child.log)}")
            node.bury(death)
            death.child.worked = death.child.process.pid in node.worked
            if why := supervisor.leaves_out(death):
                display.say(f"the sweep goes on without {death.child.name} ({why}); see {death.child.log}")
                continue
            display.say(f"{death.child.name} ended ({death.cause}), starting it again; see {death.child.log}")
            supervisor.revive(death)
        stuck = node.stuck(time.monotonic())
        for child in supervisor.children:
            if child.process.pid in stuck:
                display.say(f"{child.name} does not find the others: it is started again; see {child.log}")
                child.process.kill()
        if node.closed:  # recorder and dashboard have last words: what nobody has read goes with its sender
            supervisor.release(("simulator", "classifier"))
        if node.failed:
            raise GraphError(node.failed)
        for line in [text for text, new in node.news.items() if new]:
            node.news[line] = False
            display.say(line)
        display.show(node.progress, node.details.get("coordinator", ""), time.monotonic())
