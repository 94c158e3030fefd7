"""What every node of the graph shares: quality of service, health, and a life from start to Ctrl-C."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import resource
import signal
import socket
import sys
import threading
import traceback
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import rclpy
from bow_msgs.msg import Health, Plan
from builtin_interfaces.msg import Time
from rcl_interfaces.msg import IntegerRange, ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.exceptions import ParameterException
from rclpy.experimental import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from bow_sim.graph import discovery, environment
from bow_sim.graph.diagnosis import network_hints
from bow_sim.graph.shm_notes import Note
from bow_sim.protocol import cdr
from bow_sim.protocol.authority import Authority
from bow_sim.protocol.flow_control import LIMIT
from bow_sim.protocol.identity import random_id
from bow_sim.protocol.neighbours import DEAF_S, HELLO_S, LEFT, AwakeClock, Neighbour, Neighbours

RCLError = rclpy_implementation.RCLError

NAMESPACE = "/bow"
"""Where nodes live unless remapped (``-r __ns:=``); `bow sweep` gives each run a namespace of its own below it."""

STREAM = QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE)
"""verdicts, receipts, subscribers of the streams: nothing is dropped; credit bounds what is under way."""

WAVES = QoSProfile(depth=LIMIT, reliability=ReliabilityPolicy.RELIABLE)
"""For publishers of the streams: as many are kept as credit lets be under way, so neither consumer misses any, and no
other subscriber stops them. For as many bridge_force has room in shared memory."""

LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""plan, basin_map, health: a late joiner gets the latest one of every publisher."""

HEARD = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""For subscribers of plan and health: publishers share the room of a subscriber, none must push out another's word."""

WORK = QoSProfile(depth=512, reliability=ReliabilityPolicy.RELIABLE)
"""blocks: two for each of 64 simulators, with room; one that is lost is sent again."""

INSPECT = QoSProfile(depth=3, reliability=ReliabilityPolicy.BEST_EFFORT)
"""inspect: pictures for people; a lost one is no loss."""

HEALTH_PERIOD_S = 1.0

LEAVE_S = 10
"""A node that has closed and does not get away from DDS in this time is ended by SIGALRM: where many leave at once, or
one was killed with a lock in its hands, Fast DDS sometimes waits for ever."""


class StartupError(Exception):
    """A node cannot start: a parameter is wrong, or a directory cannot be used. The message is for people."""


SINGLE = ("coordinator", "recorder", "classifier")
"""Roles of which a namespace has one node, whatever it is called; of the others one of each name."""

LOG_AGAIN_S = 5.0
"""Between two lines in the log on the same trouble."""

LOOK_S = 0.05
"""Between two looks at whether a heartbeat is due."""

SAY_S, REMIND_S = 1.0, 20.0
"""A node that waits for others for so long says for whom; and again, with what to look at."""


class BowNode(Node):
    """A node with a role, an incarnation and a heartbeat on ``health``. Its timers do not depend on any clock of ROS.

    Attributes
    ----------
    incarnation
        Random, new at every start: tells others that state kept here is gone.
    health
        The message of the next heartbeat: count messages, bytes, duplicates and ignored ones in its fields.
    neighbours
        The other nodes of the namespace.
    authority
        Decides whose plan is obeyed.
    awake
        Clock for what the others do: it stands still while this process is stopped.
    finished, status
        Set `finished` when the node has nothing more to do: its process then ends with exit status `status`.
    """

    finished = False
    status = 0

    def __init__(
        self, role: str, name: str | None = None, namespace: str = NAMESPACE, context: Context | None = None
    ) -> None:
        super().__init__(name or role, namespace=namespace, context=context)
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
        self.neighbours = Neighbours(self.incarnation, self.health.host, self.cares)
        self.authority = Authority(self.works_for)
        self._next_beat = self._say_at = 0.0
        self._said = False
        self._health_publisher = self.create_publisher(Health, "health", LATCHED)
        self.create_subscription(Health, "health", self._take_health, HEARD)
        self.every(LOOK_S, self._beat_when_due)
        self.beat()

    def every(self, seconds: float, do: Callable[[], None]) -> None:
        """Call `do` again and again, by the steady clock: with use_sim_time ROS's own stands still."""
        self.create_timer(seconds, do, clock=Clock(clock_type=ClockType.STEADY_TIME))

    @staticmethod
    def wall_time() -> Time:
        """Return the system's time, as a stamp."""
        return Clock(clock_type=ClockType.SYSTEM_TIME).now().to_msg()

    def declared(self, name: str, default: Any, what: str, between: tuple[int, int] | None = None) -> Any:
        """Declare a read-only parameter, described by `what`, and return its value."""
        descriptor = ParameterDescriptor(description=what, read_only=True)
        if between is not None:
            descriptor.integer_range = [IntegerRange(from_value=between[0], to_value=between[1], step=1)]
        return self.declare_parameter(name, default, descriptor).value

    # ---- what comes in

    def ignore(self, why: str) -> None:
        """Count a message that does not belong here, and log why."""
        self.health.ignored += 1
        self.get_logger().warning(f"ignored: {why}", throttle_duration_sec=LOG_AGAIN_S)

    def decoded(self, name: str, data: bytes) -> dict[str, Any] | None:
        """Return the fields of a message that carries no checksum; None if the bytes are not such a message."""
        try:
            return cdr.decode(name, data)
        except cdr.WireError as error:
            self.ignore(str(error))
            return None

    def subscribe_plan(self, take: Callable[[dict[str, Any], bytes], None]) -> None:
        """Subscribe to `plan`; `take` gets each plan that is to be obeyed, decoded and as bytes."""

        def on_plan(data: bytes) -> None:
            plan = self.decoded("Plan", data)
            if plan is None:
                return
            why = self.authority.objection(plan)
            if why:
                self.ignore(f"plan: {why}")
            else:
                take(plan, data)

        self.create_subscription(Plan, "plan", on_plan, HEARD, raw=True)

    # ---- the heartbeat

    def beat(self) -> None:
        """Publish the state of this node now."""
        now = self.awake.now()
        self._next_beat = now + HEALTH_PERIOD_S
        self.health.stamp = self.wall_time()
        self.health.number += 1
        self.health.rss = resident_bytes()
        self.health.hears = self.neighbours.hears(now)
        self._health_publisher.publish(self.health)

    def _beat_when_due(self) -> None:
        now = self.awake.now()
        if self.neighbours.changed or now >= self._next_beat:
            self.beat()
        self._remind(now)

    def become(self, state: int, detail: str = "", run: str | None = None) -> None:
        """Change the published state; say so at once if it is another one."""
        run = self.health.run_id if run is None else run
        changed = (self.health.state, self.health.detail, self.health.run_id) != (state, detail, run)
        self.health.state, self.health.detail, self.health.run_id = state, detail, run
        if changed:
            self._say_at = self.awake.now() + SAY_S
            self._said = False
            self.beat()

    def _remind(self, now: float) -> None:
        """Say for whom this node waits, once it lasts; again and with more from time to time."""
        if now < self._say_at:
            return
        again, self._said, self._say_at = self._said, True, now + REMIND_S
        if not again:
            if self.health.state == Health.STARTING and self.health.detail:
                self.get_logger().info(self.health.detail)
        elif not self.neighbours.any_alive(now):
            hints = "; ".join(network_hints(os.environ))
            self.get_logger().warning(f"no other node is heard in {self.get_namespace()}; look at: {hints}")
        elif self.health.state == Health.STARTING and self.health.run_id:
            self.get_logger().warning(f"still {self.health.detail}")

    # ---- the others

    def cares(self, role: str, node: str) -> bool:
        """Whether the heartbeats of a node matter here, so that it is told that they arrive."""
        return True

    def heard(self, topic: str, incarnation: str) -> None:
        """A message of another node has come on a topic."""
        self.neighbours.heard(topic, incarnation, self.awake.now())

    def missing_readers(self, topics: Iterable[tuple[str, str]], run_id: str) -> list[str]:
        """Return what keeps the readers of our topics, pairs of topic and role, from receiving them; empty if nothing.

        They report it in their heartbeats: at first it must be reported just now, later within `DEAF_S`.
        """
        patience = HELLO_S if self.health.state == Health.STARTING else DEAF_S
        return self.neighbours.missing(topics, run_id, self.awake.now(), patience)

    def is_heard(self, topics: Iterable[tuple[str, str]], run_id: str) -> bool:
        """Return whether the readers of our topics receive them; if not, wait for them, in state STARTING."""
        missing = self.missing_readers(topics, run_id)
        if missing:
            self.become(Health.STARTING, f"waiting: {', '.join(missing)}")
        return not missing

    def works_for(self, incarnation: str, run_id: str) -> bool:
        """Return whether a coordinator is there, answers us, and works for a run."""
        known = self.neighbours.get(incarnation)
        alive = self.neighbours.is_alive(incarnation, self.awake.now())
        return known is not None and alive and known.is_live and known.run_id == run_id

    def _take_health(self, message: Health) -> None:
        if message.incarnation == self.incarnation:
            return
        if self.neighbours.is_old(message):
            self.health.ignored += 1
            return
        neighbour = self.neighbours.take(message, self.awake.now())
        rival = self.neighbours.rival(
            self.health.role,
            self.health.node,
            (self.health.started.sec, self.health.started.nanosec),
            self.health.role in SINGLE,
        )
        if rival is not None and not self.finished:
            self._give_way(rival)
            return
        self.on_health(message, neighbour)

    def on_health(self, message: Health, neighbour: Neighbour | None) -> None:
        """Take in a heartbeat; `neighbour` is None where it says that a node has gone."""

    def _give_way(self, rival: Neighbour) -> None:
        """End, as there is another of this role or name."""
        what = (
            f"{rival.node} is there already (process {rival.pid} on {rival.host}); a namespace has one "
            f"{self.health.role if self.health.role in SINGLE else 'node of a name'}: end it, or give this one another "
            "namespace or name (-r __ns:=, -r __node:=)"
        )
        self.get_logger().error(what)
        self.finished, self.status = True, 1
        self.become(Health.FAILED, what)

    def close(self) -> None:
        """Leave nothing half-done behind; called once, while publishing may no longer be possible."""


def resident_bytes() -> int:
    """Return the resident memory of this process in bytes."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def keep_memory() -> None:
    """Let the C library keep what is freed: messages of 356 kB otherwise give back and fault in their pages each time.

    It saves a sixth of the recorder's CPU time. Elsewhere than on glibc nothing happens.
    """
    trim_threshold, mmap_threshold, kept = -1, -3, 16 << 20
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(trim_threshold, kept)
        mallopt(mmap_threshold, kept)


def interrupt_less() -> None:
    """Tell the scheduler that throughput counts: who wakes up for a message waits until another's turn is over.

    Caches then stay warm and messages are taken several at a time; on two cores it saves a tenth of a map's CPU time.
    Threads inherit it. Elsewhere than on Linux nothing happens.
    """
    if hasattr(os, "SCHED_BATCH"):
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))


def leave() -> None:
    """Let go of DDS: call it after the last node is destroyed, when nothing refers to node and executor any more.

    A process that ends before that may die with a lock of its shared memory in its hands, for which others then wait.
    """
    gc.collect()


def live(make: Callable[[], BowNode], args: Sequence[str] | None = None, description: str = "") -> int:
    """Run one node until it is told to stop; return its exit status (0, or 1 after an error).

    `make` builds the node inside an initialised context. ``--help`` prints `description`.
    """
    arguments = list(sys.argv if args is None else args)
    if {"-h", "--help"} & set(remove_ros_args(arguments)[1:]):
        print(description.strip())
        return 0
    environment.open_streams()
    try:
        ignored = environment.settle()
    except environment.EnvironmentProblem as error:
        print(f"{Path(arguments[0]).name if arguments else 'bow'}: {error}", file=sys.stderr)
        return 2
    if ignored:
        print(ignored, file=sys.stderr)
    discovery.apply_defaults()
    keep_memory()
    interrupt_less()
    node: BowNode | None = None
    status = 0
    told: list[int] = []  # an Event would lock itself out where two signals come at once
    for number in (signal.SIGINT, signal.SIGTERM):  # our own handlers, so that a node can say goodbye
        signal.signal(number, lambda number, _: told.append(number))
    gc.freeze()  # what is imported stays
    gc.enable()
    note = Note()
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    executor = EventsExecutor()
    try:
        node = make()
        executor.add_node(node)
        while not (told or node.finished):
            executor.spin_once(timeout_sec=0.1)
            note.update()
        status = node.status
    except (StartupError, ParameterException) as error:
        print(f"{Path(arguments[0]).name if arguments else 'bow'}: {error}", file=sys.stderr)
        status = 1
    except Exception:
        traceback.print_exc()
        status = 1
    finally:
        if node is not None:
            try:
                node.close()
                end_after(LEAVE_S)
                node.become(Health.CLOSED, LEFT)
            except Exception:
                traceback.print_exc()
                status = 1
        end_after(LEAVE_S)
        executor.shutdown()
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
        node = None
        del executor
        leave()
        note.close()
        end_after(0)
    return status


def end_after(seconds: int) -> None:
    """Have this process ended by SIGALRM, whatever it waits for then; 0: not after all.

    Only from the main thread: a process with others is not ours to end.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(seconds)
