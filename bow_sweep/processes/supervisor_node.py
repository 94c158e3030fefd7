"""The node beside the processes of `bow sweep`: tells the graph which have ended, and people how the sweep goes on."""

from __future__ import annotations

import contextlib
import gc
import os
import time
from collections import Counter

import numpy as np
import rclpy
from bow_msgs.msg import BasinMap, Health, Plan
from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions

from bow_classifier.verdict.regimes import REGIMES
from bow_sim.graph.diagnosis import network_hints
from bow_sim.graph.discovery import apply_defaults
from bow_sim.graph.node_base import HEARD, LATCHED, LEAVE_S, BowNode, end_after, leave
from bow_sim.protocol import cdr
from bow_sim.protocol.neighbours import CONSUMERS, Neighbour
from bow_sweep.processes.interrupts import Ending
from bow_sweep.processes.progress import Display, Progress
from bow_sweep.processes.supervisor import SPECTATORS, Death, GraphError, Supervisor, tail
from bow_sweep.processes.waiting import RESTARTS, STALL_S, UNHEARD_S, Waiting, usage
from bow_sweep.view.wanted import NOTE

STOP_S = 5.0
"""So long this process was stopped in all, that DDS may have lost others."""

SAY_S = 5.0
"""What the coordinator waits for in the middle of a sweep is said when it lasts so long."""

NEWS = ("refuses blocks", "not drawn: ", "waiting for the dashboard")
"""Beginnings of what nodes say of themselves that people should read."""


class SupervisorNode(BowNode):
    """Tells the graph which of its processes have ended, and listens to how the sweep goes on."""

    def __init__(self) -> None:
        super().__init__("supervisor")
        self.progress: Progress | None = None
        self.failed = ""
        self.details: dict[str, str] = {}
        self.news: dict[str, bool] = {}  # for people; True = not yet said
        self.ours: set[int] = set()  # the processes of this supervisor
        self.waiting = Waiting(self.get_namespace().rpartition("/")[2])
        self.closed = False  # the plan is: nothing more will be simulated
        self._waits: tuple[str, float] = ("", 0.0)  # what the coordinator waits for, and since when
        self._deaths = self.create_publisher(Health, "health", HEARD)  # so that none is lost behind the next
        self.create_subscription(BasinMap, "basin_map", self._on_map, LATCHED, raw=True)
        self.create_subscription(Plan, "plan", self._on_plan, HEARD, raw=True)
        self.become(Health.READY)

    def _on_map(self, data: bytes) -> None:
        try:
            values = cdr.decode("BasinMap", data)
        except cdr.WireError:
            return
        self.waiting.advance(int(values["tests"].sum(dtype=np.int64)), self.awake.now())
        counts = np.bincount(values["regime"], minlength=256)
        self.progress = Progress(
            done=values["cells_done"],
            quarantined=values["cells_quarantined"],
            planned=sum(values[f"cells_{name}"] for name in ("done", "quarantined", "outstanding")),
            regimes={name: int(count) for name, count in zip(REGIMES, counts, strict=False)},
        )

    def _on_plan(self, data: bytes) -> None:
        with contextlib.suppress(cdr.WireError):
            plan = cdr.decode("Plan", data)
            self.closed |= plan["state"] == Plan.CLOSED and self.get_namespace() == f"/bow/{plan['run_id']}"

    def on_health(self, message: Health, neighbour: Neighbour | None) -> None:
        """Note what people should know of our processes; what others start in this namespace does not count."""
        if message.host != self.health.host or message.pid not in self.ours:
            return
        now = self.awake.now()
        self.details[message.role] = message.detail
        if message.state != Health.DEAD:
            self.waiting.hear(message.pid, message.role, message.state, message.run_id, now)
        if message.role == "coordinator":
            self._note_waiting(message.detail if message.state == Health.STARTING else "", now)
        if message.state == Health.FAILED and message.role in CONSUMERS:
            self.failed = f"{message.role}: {message.detail}"
        elif message.state == Health.FAILED or message.detail.startswith(NEWS):
            self.news.setdefault(f"{message.node}: {message.detail}", True)
        for note in message.detail.split(NOTE)[1:]:
            self.news.setdefault(note, True)

    def _note_waiting(self, what: str, now: float) -> None:
        """Say what the coordinator waits for, where it was at work already; before, the display shows it."""
        if what != self._waits[0]:
            self._waits = (what, now)
            self.news.pop(what, None)
        elif what and self.progress is not None and now - self._waits[1] > SAY_S:
            self.news.setdefault(what, True)

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
        message.stamp = self.wall_time()
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
    words = ["bow", "--ros-args", "-r", f"__ns:={supervisor.namespace}", "--log-file-name", "supervisor"]
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
    """Spin until the coordinator has finished; start again what dies or is not heard."""
    restarts: Counter[str] = Counter()
    while True:
        executor.spin_once(timeout_sec=0.05)
        ending.check()
        for death in supervisor.buried():
            if death.child.role == "coordinator":
                if death.status == 0:
                    return
                raise GraphError(f"the coordinator ended ({death.cause}):\n{tail(death.child.log)}")
            node.bury(death)
            death.child.worked = death.child.process.pid in node.waiting.worked
            if why := supervisor.leaves_out(death):
                display.say(f"the sweep goes on without {death.child.name} ({why}); see {death.child.log}")
                continue
            display.say(f"{death.child.name} ended ({death.cause}), starting it again; see {death.child.log}")
            supervisor.revive(death)
        node.ours = {child.process.pid for child in supervisor.children}
        _look_after(supervisor, node, display, restarts)
        if node.closed:  # recorder and dashboard have last words: what nobody has read goes with its sender
            supervisor.release(("simulator", "classifier"))
        if node.failed:
            raise GraphError(node.failed)
        for line in [text for text, new in node.news.items() if new]:
            node.news[line] = False
            display.say(line)
        display.show(node.progress, node.details.get("coordinator", ""), time.monotonic())


def _look_after(supervisor: Supervisor, node: SupervisorNode, display: Display, restarts: Counter[str]) -> None:
    """Kill the processes that the others do not hear, which are then started again; give up where that is no use.

    Raises
    ------
    GraphError
        Naming who is not heard, and what to look at.
    """
    now, waiting = node.awake.now(), node.waiting
    children = {child.process.pid: child for child in supervisor.children}
    needed = {pid: child for pid, child in children.items() if child.role not in SPECTATORS}
    if node.awake.slept > STOP_S:
        waiting.note_stop()
    stopped = waiting.hold(needed, now)
    if stopped:
        names = ", ".join(sorted(children[pid].name for pid in stopped))
        node.news.setdefault(f"stopped by somebody (SIGSTOP): {names}; the sweep waits until they go on", True)
        return
    unheard = waiting.unheard(children, now)
    unheard -= {pid for pid in unheard - needed.keys() if usage(pid).stopped}  # nobody misses them
    if needed and unheard >= needed.keys():
        names = ", ".join(child.name for child in needed.values())
        raise GraphError(f"nothing is heard of {names} for {UNHEARD_S:g} s. Look at: {_hints()}")
    for pid in (unheard | waiting.stuck(now)) & children.keys():
        child = children[pid]
        restarts[child.role] += 1
        why = f"{child.name} is not heard" if pid in unheard else f"{child.name} and the others do not hear each other"
        too_often = restarts[child.role] > RESTARTS * max(1, len(children) // 4) and pid in needed
        if child.role == "coordinator" or too_often:
            raise GraphError(f"{why}:\n{tail(child.log)}\nLook at: {_hints()}")
        display.say(f"{why}: it is started again; see {child.log}")
        child.process.kill()
    if waiting.is_stalled(now) and not node.closed:
        raise GraphError(f"no progress for {STALL_S:g} s; {node.details.get('coordinator') or 'nothing is missing'}")


def _hints() -> str:
    return "; ".join(network_hints(os.environ))
