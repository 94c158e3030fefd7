"""The simulators that a coordinator knows: their action clients, their health, and the goals in their hands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from bow_msgs.action import Simulate
from bow_msgs.msg import Health, SweepSpec
from rclpy.action import ActionClient, get_action_names_and_types
from rclpy.node import Node

from .ledger import Event, Finished, Refused, SimulatorLost, SimulatorReady

SILENT_S = 6.0
"""A simulator unheard of for this long is taken for dead; heartbeats come every second."""

ACTION = "/simulate"
ACTION_TYPE = "bow_msgs/action/Simulate"
STRANGERS = 256
"""Simulators at most whose word is kept until they are found: anybody may speak on a topic."""

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 8.0


@dataclass
class _Simulator:
    client: ActionClient  # kept for ever: rclpy 7.1.6's EventsExecutor crashes where a callback destroys one
    incarnation: str = ""
    gone: str = ""  # the incarnation that has left
    heard: float = 0.0
    ready: bool = False
    listed: bool = False
    pause: float = 0.0
    resume_at: float = 0.0


class Pool:
    """Finds simulators by their action servers and turns what becomes of them into ledger events.

    Parameters
    ----------
    node
        The coordinator.
    emit
        Takes each event; called in the executor's thread.
    """

    def __init__(self, node: Node, emit: Callable[[Event], None]) -> None:
        self._node, self._emit = node, emit
        self._simulators: dict[str, _Simulator] = {}
        self._strangers: dict[str, Health] = {}  # heard of before their action servers were found

    def __len__(self) -> int:
        return sum(simulator.listed for simulator in self._simulators.values())

    def begin(self) -> None:
        """Begin a run: nobody is in its ledger yet, and what was heard before says nothing of it."""
        for simulator in self._simulators.values():
            simulator.ready = simulator.listed = False

    def on_health(self, message: Health, run_id: str, now: float) -> None:
        """Take in a simulator's heartbeat, or its supervisor's word that it is gone."""
        known = self._simulators.get(message.node)
        if message.state in (Health.DEAD, Health.CLOSED):
            self._strangers.pop(message.node, None)
            if (known and known.incarnation in ("", message.incarnation)) or (known and not message.incarnation):
                self._lose(message.node, message.detail or "left", blame=message.state == Health.DEAD)
                self._drop(message.node)
            return
        if known is None:
            if len(self._strangers) < STRANGERS:
                self._strangers[message.node] = message
            return
        if message.incarnation == known.gone:
            return
        if known.incarnation not in ("", message.incarnation):
            self._lose(message.node, "restarted", blame=True)
        known.incarnation, known.heard = message.incarnation, now
        known.ready = message.run_id == run_id and message.state in (Health.READY, Health.BUSY)
        if not known.ready:
            self._lose(message.node, message.detail, blame=False)

    def look(self, run_id: str, now: float) -> None:
        """Find new simulators, miss silent ones, and offer those that are ready; call a few times a second."""
        namespace = self._node.get_namespace().rstrip("/") + "/"
        for action, types in get_action_names_and_types(self._node):
            name = action.removesuffix(ACTION)
            if ACTION_TYPE in types and name != action and name.startswith(namespace) and name not in self._simulators:
                self._simulators[name] = _Simulator(ActionClient(self._node, Simulate, action), heard=now)
                if (message := self._strangers.pop(name, None)) is not None:
                    self.on_health(message, run_id, now)
        for name, simulator in list(self._simulators.items()):
            if now - simulator.heard > SILENT_S:
                self._lose(name, f"silent for {SILENT_S:g} s", blame=True)
                simulator.ready = False
            elif self._can_join(simulator, now):
                simulator.listed = True
                self._emit(SimulatorReady(name))

    @staticmethod
    def _can_join(simulator: _Simulator, now: float) -> bool:
        waits = simulator.ready and not simulator.listed and now >= simulator.resume_at
        return waits and simulator.client.server_is_ready()

    def slept(self, seconds: float) -> None:
        """Make up for a time in which this process did not run: nobody was silent, we were deaf."""
        for simulator in self._simulators.values():
            simulator.heard += seconds

    def send(self, name: str, goal: Simulate.Goal, spec: SweepSpec) -> None:
        """Send a block; its end comes back as an event."""
        goal.spec = spec
        simulator = self._simulators.get(name)
        if simulator is None:
            self._emit(Refused(name, goal.block, goal.attempt, "gone"))
            return
        simulator.client.send_goal_async(goal).add_done_callback(lambda f: self._answered(name, goal, f))

    def _answered(self, name: str, goal: Simulate.Goal, future: Any) -> None:
        handle = future.result()
        if handle is not None and handle.accepted:
            handle.get_result_async().add_done_callback(lambda f: self._ended(name, goal, f))
            return
        simulator = self._simulators.get(name)
        if simulator is not None:
            simulator.pause = min(max(2 * simulator.pause, FIRST_PAUSE_S), LONGEST_PAUSE_S)
            simulator.resume_at = simulator.heard + simulator.pause
            self._node.get_logger().warning(f"{name} rejects block {goal.block}; its log says why")
        self._emit(Refused(name, goal.block, goal.attempt, "rejected"))
        self._lose(name, "rejects blocks", blame=False)

    def _ended(self, name: str, goal: Simulate.Goal, future: Any) -> None:
        answer = future.result()
        if answer is not None and answer.status == 4:  # action_msgs/GoalStatus SUCCEEDED
            if name in self._simulators:
                self._simulators[name].pause = 0.0
            self._emit(Finished(name, goal.block, goal.attempt))
        else:
            self._emit(Refused(name, goal.block, goal.attempt, "given up by its simulator"))

    def _lose(self, name: str, why: str, *, blame: bool) -> None:
        simulator = self._simulators.get(name)
        if simulator is not None and simulator.listed:
            simulator.listed = False
            self._emit(SimulatorLost(name, why, blame))

    def _drop(self, name: str) -> None:
        simulator = self._simulators.get(name)
        if simulator is not None:
            simulator.gone, simulator.incarnation, simulator.ready = simulator.incarnation, "", False
