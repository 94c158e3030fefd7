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

import rclpy
from bow_msgs.msg import Health
from rclpy.exceptions import ParameterException
from rclpy.experimental import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from . import reach
from .credit import LIMIT
from .identity import random_id

RCLError = rclpy_implementation.RCLError

NAMESPACE = "/bow"
"""Where nodes live unless remapped (``-r __ns:=``); `bow sweep` gives each run a namespace of its own below it."""

CONSUMERS = ("recorder", "classifier")
"""Roles of the nodes that take the streams whole: everybody waits for them."""

STREAM = QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE)
"""verdicts, receipts, subscribers of the streams: nothing is dropped; credit bounds what is under way."""

WAVES = QoSProfile(depth=LIMIT, reliability=ReliabilityPolicy.RELIABLE)
"""For publishers of the streams: as many are kept as credit lets be under way, so neither consumer misses any, and no
other subscriber stops them. For as many bridge_force has room in shared memory."""

LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""plan, basin_map, health: a late joiner gets the latest one of every publisher."""

HEARD = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""For subscribers of plan and health: publishers share the room of a subscriber, none must push out another's word."""

INSPECT = QoSProfile(depth=3, reliability=ReliabilityPolicy.BEST_EFFORT)
"""inspect: pictures for people; a lost one is no loss."""

HEALTH_PERIOD_S = 1.0

LEAVE_S = 10
"""A node that has closed and does not get away from DDS in this time is ended by SIGALRM: where many leave at once, or
one was killed with a lock in its hands, Fast DDS sometimes waits for ever."""


class StartupError(Exception):
    """A node cannot start: a parameter is wrong, or a directory cannot be used. The message is for people."""


class BowNode(Node):
    """A node with a role, an incarnation and a heartbeat on ``health``.

    Attributes
    ----------
    incarnation
        Random, new at every start: tells others that state kept here is gone.
    health
        The message of the next heartbeat: count messages, bytes, duplicates and ignored ones in its fields.
    finished
        Set it when the node has nothing more to do: its process then ends with status 0.
    """

    finished = False

    def __init__(self, role: str, name: str | None = None) -> None:
        super().__init__(name or role, namespace=NAMESPACE)
        self.incarnation = random_id()
        self.health = Health(
            role=role,
            node=self.get_fully_qualified_name(),
            incarnation=self.incarnation,
            host=socket.gethostname(),
            pid=os.getpid(),
            state=Health.STARTING,
        )
        self._health_publisher = self.create_publisher(Health, "health", LATCHED)
        self.create_timer(HEALTH_PERIOD_S, self.beat)
        self.beat()

    def beat(self) -> None:
        """Publish the state of this node now."""
        self.health.stamp = self.get_clock().now().to_msg()
        self.health.rss = resident_bytes()
        self._health_publisher.publish(self.health)

    def become(self, state: int, detail: str = "", run: str | None = None) -> None:
        """Change the published state; say so at once if it is another one."""
        run = self.health.run_id if run is None else run
        changed = (self.health.state, self.health.detail, self.health.run_id) != (state, detail, run)
        self.health.state, self.health.detail, self.health.run_id = state, detail, run
        if changed:
            self.beat()

    def close(self) -> None:
        """Leave nothing half-done behind; called once, while publishing may no longer be possible."""


def resident_bytes() -> int:
    """Return the resident memory of this process in bytes."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def has_met(node: Node, publisher: Publisher, names: Iterable[str]) -> bool:
    """Return whether subscribers of these node names, in the node's own namespace, have met a publisher of its.

    What a volatile publisher says before that is lost to them.
    """
    listeners = node.get_subscriptions_info_by_topic(publisher.topic_name)
    ours = {info.node_name for info in listeners if info.node_namespace == node.get_namespace()}
    return set(names) <= ours and publisher.get_subscription_count() >= len(listeners)


def publishes(node: Node, name: str, topic: str) -> bool:
    """Return whether a node of this name, in the node's own namespace, publishes on a topic."""
    infos = node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
    return any(info.node_name == name and info.node_namespace == node.get_namespace() for info in infos)


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
    reach.apply_defaults()
    keep_memory()
    interrupt_less()
    node: BowNode | None = None
    status = 0
    told: list[int] = []  # an Event would lock itself out where two signals come at once
    for number in (signal.SIGINT, signal.SIGTERM):  # our own handlers, so that a node can say goodbye
        signal.signal(number, lambda number, _: told.append(number))
    gc.freeze()  # what is imported stays
    gc.enable()
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    executor = EventsExecutor()
    try:
        node = make()
        executor.add_node(node)
        while not (told or node.finished):
            executor.spin_once(timeout_sec=0.1)
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
                node.become(Health.CLOSED, "left")
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
