"""Heartbeats reach the nodes of the own station and those of the run, and no other station."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import pytest
import rclpy
from bow_msgs.msg import Health
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

from bow_sim.graph.discovery import apply_defaults
from bow_sim.graph.node_base import CHECK_S, BowNode
from bow_sim.protocol.neighbours import AwakeClock, Neighbour
from bow_sim.protocol.stations import STATION_HEALTH, namespace_of

RUN = "/bow/run"
PATIENCE_S = 30.0

pytestmark = pytest.mark.usefixtures("ros_domain")


class Listening(BowNode):
    """A node that notes every heartbeat that arrives, also one that does not concern it."""

    def __init__(self, role: str, station: str, context: Context) -> None:
        self.arrived: set[str] = set()
        super().__init__(role, namespace=namespace_of(RUN, station), context=context)

    def concerns(self, role: str, node: str) -> bool:
        self.arrived.add(node)
        return super().concerns(role, node)

    def on_health(self, message: Health, neighbour: Neighbour | None) -> None:
        assert message.node in self.arrived


@contextmanager
def nodes(*wanted: tuple[str, str]) -> Iterator[tuple[list[Listening], Callable[[float], None]]]:
    """Nodes by role and station, each in a context of its own, as a process has it; and what spins all for a time."""
    apply_defaults()
    with ExitStack() as stack:
        made, executors = [], []
        for role, station in wanted:
            context = Context()
            rclpy.init(args=["--ros-args", "-p", f"station:={station}"] if station else [], context=context)
            stack.callback(rclpy.shutdown, context=context)
            made.append(Listening(role, station, context))
            stack.callback(made[-1].destroy_node)
            executors.append(SingleThreadedExecutor(context=context))
            stack.callback(executors[-1].shutdown)
            executors[-1].add_node(made[-1])

        def spin(seconds: float) -> None:
            until = time.monotonic() + seconds
            while time.monotonic() < until:
                for executor in executors:
                    executor.spin_once(timeout_sec=0.005)

        yield made, spin


def test_a_station_hears_itself_and_the_run_and_the_run_hears_all() -> None:
    wanted = (("coordinator", ""), ("simulator", ""), ("recorder", "a"), ("simulator", "a"), ("simulator", "b"))
    with nodes(*wanted) as (made, spin):
        coordinator, nameless, recorder, simulator, other = made
        names = {node.get_fully_qualified_name(): node for node in made}
        without = {name for name, node in names.items() if not node.station}
        expected = {
            coordinator: set(names),
            nameless: without,
            recorder: without | {f"{RUN}/a/recorder", f"{RUN}/a/simulator"},
            simulator: without | {f"{RUN}/a/recorder", f"{RUN}/a/simulator"},
            other: without | {f"{RUN}/b/simulator"},
        }
        others = [(node, heard - {node.get_fully_qualified_name()}) for node, heard in expected.items()]
        until = time.monotonic() + PATIENCE_S
        while any(node.arrived < heard for node, heard in others) and time.monotonic() < until:
            spin(0.1)
        spin(1.5)  # so long that each node has sent one more
        assert [node.arrived for node, _ in others] == [heard for _, heard in others]
        listeners = coordinator.get_subscriptions_info_by_topic(f"{RUN}/{STATION_HEALTH}")
        assert {info.node_name for info in listeners} == {"coordinator"}


def test_what_is_heard_for_the_first_time_is_reported_at_once_and_more_of_it_soon() -> None:
    with nodes(("coordinator", "")) as (made, spin):
        node, clock = made[0], [0.0]
        node.awake = AwakeClock(lambda: clock[0])
        node.publish_health()
        number = node.health.number
        clock[0] += CHECK_S
        node.heard("verdicts", "another")
        assert (node.health.number, node.health.hears) == (number + 1, ["another verdicts"])
        node.heard("verdicts", "another")
        node.heard("receipts", "another")
        assert node.health.number == number + 1  # not a heartbeat for each
        until = time.monotonic() + PATIENCE_S
        while node.health.number == number + 1 and time.monotonic() < until:
            spin(CHECK_S)
        assert (node.health.number, node.health.hears) == (number + 2, ["another receipts verdicts"])
