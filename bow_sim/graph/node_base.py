"""The base class of all nodes, and the quality of service of all topics."""

from __future__ import annotations

import os
import resource
import socket
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from bow_msgs.msg import Health, Plan
from builtin_interfaces.msg import Time
from rcl_interfaces.msg import IntegerRange, ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from bow_sim.graph.diagnosis import network_hints
from bow_sim.graph.run_log import RunLog
from bow_sim.protocol import cdr
from bow_sim.protocol.authority import Authority
from bow_sim.protocol.flow_control import LIMIT
from bow_sim.protocol.identity import random_id
from bow_sim.protocol.neighbours import HELLO_S, UNCONFIRMED_S, AwakeClock, Neighbour, Neighbours
from bow_sim.protocol.stations import (
    HEALTH,
    STATION_HEALTH,
    STATION_ROLES,
    STATION_TOPICS,
    StationError,
    run_namespace_of,
    station_of,
)

RCLError = rclpy_implementation.RCLError

NAMESPACE = "/bow"
"""Namespace of the nodes unless remapped (``-r __ns:=``); `bow sweep` gives each run its own namespace below it."""

STREAM = QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE)
"""verdicts, receipts, subscribers of the streams: nothing is dropped; flow control bounds how much is under way."""

STREAM_WRITER = QoSProfile(depth=LIMIT, reliability=ReliabilityPolicy.RELIABLE)
"""Publishers of the streams. They keep as many messages as flow control permits to be under way: neither consumer
misses one, and no other subscriber blocks them. Shared memory is reserved for as many messages of bridge_force."""

LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""plan, basin_map, health: a late subscriber gets the latest message of every publisher."""

LATCHED_DEEP = QoSProfile(
    depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
"""Subscribers of plan: history depth is shared by all publishers; 100 keeps one from evicting another's message."""

HEARTBEATS = QoSProfile(depth=4096, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Subscribers of health: as LATCHED_DEEP, for as many nodes as a coordinator knows. With less, a coordinator that has
no processor for a moment misses heartbeats of a thousand simulators, and takes those for dead that it misses for long.
"""

WORK = QoSProfile(depth=4096, reliability=ReliabilityPolicy.RELIABLE)
"""blocks: two for each of 1024 simulators, which are sent at once, twice over; a block that is lost is sent again."""

INSPECT = QoSProfile(depth=3, reliability=ReliabilityPolicy.BEST_EFFORT)
"""inspect: for display only, messages may be lost."""

HEALTH_PERIOD_S = 1.0
"""Between two heartbeats of a node that does not change."""


class StartupError(Exception):
    """A node cannot start: a parameter is wrong, or a directory cannot be used. The message is shown to the user."""


UNIQUE_ROLES = ("coordinator", "recorder", "classifier")
"""Roles that only one node of a namespace has, whatever its name; of other roles, names are unique."""

LOG_AGAIN_S = 5.0
"""Between two lines in the log about the same problem."""

CHECK_S = 0.05
"""Between two checks whether a heartbeat is due."""

LOG_AFTER_S, LOG_AGAIN_AFTER_S = 1.0, 20.0
"""A node that waits for others logs for which after this time, and again, with what to check, after this time."""


class BowNode(Node):
    """A node with a role, an incarnation and a heartbeat on ``health``. Its timers do not depend on any clock of ROS.

    Attributes
    ----------
    incarnation
        Random, new at every start: shows others that this node has lost its state.
    health
        The next heartbeat. Subclasses count messages, bytes, duplicates and ignored messages in its fields.
    station, run_namespace
        The station of this node, see :mod:`bow_sim.protocol.stations`, and the namespace of the run: that of the node
        unless the station has a name.
    neighbours
        The other nodes of the namespace.
    authority
        Decides whose plan is obeyed.
    awake
        Clock for everything that waits for other nodes: it stands still while this process is stopped.
    finished, status
        If a node sets `finished`, its process ends with exit status `status`.
    companions
        Other nodes of this process.
    """

    finished = False
    status = 0
    companions: tuple[BowNode, ...] = ()
    says_ends = True
    """Whether the log has the common lines when a run opens and closes; a subclass may have better ones."""

    def __init__(
        self, role: str, name: str | None = None, namespace: str = NAMESPACE, context: Context | None = None
    ) -> None:
        super().__init__(name or role, namespace=namespace, context=context)
        self.station, self.run_namespace = self._place(role)
        self.incarnation = random_id()
        self.health = Health(
            role=role,
            node=self.get_fully_qualified_name(),
            incarnation=self.incarnation,
            host=socket.gethostname(),
            pid=os.getpid(),
            state=Health.STARTING,
            started=self.wall_time(),
        )
        self.awake = AwakeClock()
        self.neighbours = Neighbours(self.incarnation, self.health.host, self.confirms)
        self.authority = Authority(self.works_for)
        self._health_at = self._log_at = 0.0
        self._logged = False
        self._said = ""
        self._run_log = RunLog(self.says_ends)
        self._health_publishers = self.publish_heartbeats(LATCHED)
        self.receive_health()
        self.every(CHECK_S, self._publish_health_when_due)
        self.publish_health()

    def _place(self, role: str) -> tuple[str, str]:
        """Return station and run namespace of this node; only nodes of some roles are in a station with a name."""
        if role not in (*STATION_ROLES, "supervisor"):
            return "", self.get_namespace()
        what = "station that this node belongs to; its namespace ends with this name then; empty = the one without one"
        station = self.read_parameter("station", "", what)
        try:
            return station, run_namespace_of(self.get_namespace(), station)
        except StationError as error:
            raise StartupError(str(error)) from None

    def topic(self, name: str) -> str:
        """Return the name of a topic for this node: a station has its own streams, and shares the others."""
        is_own = not self.station or name in STATION_TOPICS or name.startswith("/")
        return name if is_own else f"{self.run_namespace.rstrip('/')}/{name}"

    def concerns(self, role: str, node: str) -> bool:
        """Return whether this node works with another: nodes of other stations are the business of the run's nodes."""
        if not self.station and self.health.role not in STATION_ROLES:
            return True
        there = station_of(node, self.run_namespace) or ""
        return there == self.station or (not there and role not in STATION_ROLES)

    def every(self, seconds: float, do: Callable[[], None]) -> None:
        """Call `do` periodically, by the steady clock: with use_sim_time the clock of ROS may stand still."""
        self.create_timer(seconds, do, clock=Clock(clock_type=ClockType.STEADY_TIME))

    @staticmethod
    def wall_time() -> Time:
        """Return the system time as a stamp."""
        sec, nanosec = divmod(time.time_ns(), 10**9)
        return Time(sec=sec, nanosec=nanosec)

    def read_parameter(self, name: str, default: Any, what: str, between: tuple[int, int] | None = None) -> Any:
        """Declare a read-only parameter, described by `what`, and return its value."""
        descriptor = ParameterDescriptor(description=what, read_only=True)
        if between is not None:
            descriptor.integer_range = [IntegerRange(from_value=between[0], to_value=between[1], step=1)]
        return self.declare_parameter(name, default, descriptor).value

    def read_number(self, name: str, default: float, what: str) -> float:
        """Declare a read-only real parameter, which may be given as a whole number too, and return its value.

        Raises
        ------
        StartupError
            Where it is no number.
        """
        descriptor = ParameterDescriptor(description=what, read_only=True, dynamic_typing=True)
        value = self.declare_parameter(name, default, descriptor).value
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise StartupError(f"parameter {name} = {value!r}: should be a number")
        return float(value)

    # ---- what comes in

    def ignore(self, why: str) -> None:
        """Count a message that does not belong here, and log why."""
        self.health.ignored += 1
        self.get_logger().warning(f"ignored: {why}", throttle_duration_sec=LOG_AGAIN_S)

    def decode(self, name: str, data: bytes) -> dict[str, Any] | None:
        """Return the fields of a message that carries no checksum; None if the bytes are not such a message."""
        try:
            return cdr.decode(name, data)
        except cdr.WireError as error:
            self.ignore(str(error))
            return None

    def subscribe_plan(self, take: Callable[[dict[str, Any], bytes], None]) -> None:
        """Subscribe to `plan`; `take` gets each plan that is to be obeyed, decoded and as bytes."""

        def on_plan(data: bytes) -> None:
            plan = self.decode("Plan", data)
            if plan is None:
                return
            why = self.authority.objection(plan)
            if why:
                self.ignore(f"plan: {why}")
            else:
                take(plan, data)
                self.log_run(plan)

        self.create_subscription(Plan, self.topic("plan"), on_plan, LATCHED_DEEP, raw=True)

    # ---- the log

    def log_ready(self) -> None:
        """Log that this node is ready, and what it waits for."""
        self._said = self.health.detail
        what = self._said or ("works" if self.health.run_id else "waits for a plan")
        self.get_logger().info(f"ready in {self.get_namespace()}, process {self.health.pid}: {what}")

    def log_run(self, plan: Mapping[str, Any]) -> None:
        """Log that a run opens, each tenth of it, and that it closes, if it is the one that this node works on."""
        if plan["run_id"] in (self.health.run_id, self._run_log.run):
            for line in self._run_log.take(plan, self.run_note):
                self.get_logger().info(line)

    def log_end(self) -> None:
        """Log the end of a run that is still open for this node."""
        for line in self._run_log.leave(self.run_note):
            self.get_logger().info(line)

    def run_note(self) -> str:
        """Return what this node adds to its lines about a run."""
        return ""

    # ---- the heartbeat

    def publish_health(self) -> None:
        """Publish the state of this node now."""
        now = self.awake.now()
        self._health_at = now
        self.health.stamp = self.wall_time()
        self.health.number += 1
        self.health.rss = resident_bytes()
        self.health.hears = self.neighbours.hears(now)
        for publisher in self._health_publishers:
            publisher.publish(self.health)

    def _publish_health_when_due(self) -> None:
        now = self.awake.now()
        if self.neighbours.changed or now >= self._health_at + HEALTH_PERIOD_S:
            self.publish_health()
        self._log_what_is_awaited(now)

    def set_state(self, state: int, detail: str = "", run: str | None = None) -> None:
        """Change the published state; publish a heartbeat at once if anything changed."""
        run = self.health.run_id if run is None else run
        changed = (self.health.state, self.health.detail, self.health.run_id) != (state, detail, run)
        self.health.state, self.health.detail, self.health.run_id = state, detail, run
        if changed:
            self._log_at = self.awake.now() + LOG_AFTER_S
            self._logged = False
            self.publish_health()

    def _log_what_is_awaited(self, now: float) -> None:
        """Log for which nodes this node waits, if it takes long; later also what may be the cause."""
        if now < self._log_at:
            return
        again, self._logged, self._log_at = self._logged, True, now + LOG_AGAIN_AFTER_S
        if not again:
            if self.health.state == Health.STARTING and self.health.detail not in ("", self._said):
                self._said = self.health.detail
                self.get_logger().info(self._said)
        elif not self.neighbours.any_alive(now):
            hints = "; ".join(network_hints(os.environ))
            self.get_logger().warning(f"no other node is heard in {self.get_namespace()}; look at: {hints}")
        elif self.health.state == Health.STARTING and self.health.run_id:
            self.get_logger().warning(f"still {self.health.detail}")

    # ---- the other nodes

    def confirms(self, role: str, node: str) -> bool:
        """Whether this node reports in its heartbeats that those of another node arrive."""
        return True

    def heard(self, topic: str, incarnation: str) -> None:
        """Note that a message of another node has arrived on a topic."""
        self.neighbours.heard(topic, incarnation, self.awake.now())
        self.report_heard()

    def report_heard(self) -> None:
        """Publish what is heard for the first time, because others wait for it; `CHECK_S` after the last heartbeat."""
        if self.neighbours.changed and self.awake.now() >= self._health_at + CHECK_S:
            self.publish_health()

    def missing_readers(self, topics: Iterable[tuple[str, str]], run_id: str) -> list[str]:
        """Return what keeps the readers of our topics, pairs of topic and role, from receiving them; empty if nothing.

        They report it in their heartbeats: at first it must be reported just now, later within `UNCONFIRMED_S`.
        """
        patience = HELLO_S if self.health.state == Health.STARTING else UNCONFIRMED_S
        return self.neighbours.missing(topics, run_id, self.awake.now(), patience)

    def is_heard(self, topics: Iterable[tuple[str, str]], run_id: str) -> bool:
        """Return whether the readers of our topics receive them; if not, wait for them, in state STARTING."""
        missing = self.missing_readers(topics, run_id)
        if missing:
            self.set_state(Health.STARTING, f"waiting: {', '.join(missing)}")
        return not missing

    def works_for(self, incarnation: str, run_id: str) -> bool:
        """Return whether a coordinator is alive, receives our heartbeats, and works for a run."""
        known = self.neighbours.get(incarnation)
        alive = self.neighbours.is_alive(incarnation, self.awake.now())
        return known is not None and alive and known.is_live and known.run_id == run_id

    def _take_health(self, message: Health) -> None:
        if message.incarnation == self.incarnation or not self.concerns(message.role, message.node):
            return
        if self.neighbours.is_old(message):
            self.health.ignored += 1
            return
        neighbour = self.neighbours.take(message, self.awake.now())
        rival = self.neighbours.rival(
            self.health.role,
            self.health.node,
            (self.health.started.sec, self.health.started.nanosec),
            self.health.role in UNIQUE_ROLES,
            among=[neighbour] if neighbour else [],
        )
        if rival is not None and not self.finished:
            self._end_because_of(rival)
            return
        self.on_health(message, neighbour)
        self.report_heard()

    def publish_heartbeats(self, qos: QoSProfile) -> list[Publisher]:
        """Return publishers of heartbeats, for all who have to hear them."""
        topics = (HEALTH, self.topic(STATION_HEALTH)) if self.station else (HEALTH,)
        return [self.create_publisher(Health, topic, qos) for topic in topics]

    def heartbeat_topics(self) -> tuple[str, ...]:
        """Return the topics of the heartbeats that this node has to hear: of the run's nodes and those of its station.

        Nodes that belong to the run hear all.
        """
        if self.station:
            return HEALTH, self.topic(HEALTH)
        return (HEALTH,) if self.health.role in STATION_ROLES else (HEALTH, STATION_HEALTH)

    def receive_health(self) -> None:
        """Subscribe to heartbeats; who takes them by hand passes each to :meth:`_take_health`."""
        for topic in self.heartbeat_topics():
            self.create_subscription(Health, topic, self._take_health, HEARTBEATS)

    def on_health(self, message: Health, neighbour: Neighbour | None) -> None:
        """Take in a heartbeat; `neighbour` is None if it reports that a node has gone."""

    def _end_because_of(self, rival: Neighbour) -> None:
        """End this node, because there is another of its role or name."""
        unique = self.health.role if self.health.role in UNIQUE_ROLES else "node of a name"
        what = (
            f"{rival.node} is there already (process {rival.pid} on {rival.host}); a namespace has one {unique}: "
            "end it, or give this one another namespace or name (-r __ns:=, -r __node:=)"
        )
        self.get_logger().error(what)
        self.finished, self.status = True, 1
        self.set_state(Health.FAILED, what)

    def close(self) -> None:
        """Release what the node holds. Called once at the end; publishing may no longer be possible then."""


def resident_bytes() -> int:
    """Return the resident memory of this process in bytes."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()
