"""A node that hears what the nodes of a graph say of themselves: the part of a client that asks for nothing."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bow_sim.graph.leaving import at_end, destroy_entities
from bow_sim.protocol.identity import random_id
from bow_sim.protocol.states import NodeState
from bow_sim.protocol.stations import HEALTH, STATION_HEALTH
from bow_sweep.standing.state import State

if TYPE_CHECKING:
    from bow_msgs.msg import Health

SPIN_S = 0.05


@dataclass(frozen=True)
class Seen:
    """A node of the graph, as its latest heartbeat describes it.

    Attributes
    ----------
    rss
        Resident memory, bytes.
    at
        When the heartbeat arrived, seconds of the monotonic clock.
    """

    role: str
    node: str
    incarnation: str
    pid: int
    state: int
    detail: str
    run_id: str
    rss: int
    at: float


class Listener:
    """A node in the namespace of a standing graph, with DDS connections of its own. ROS is loaded when it is made.

    Parameters
    ----------
    state
        The graph.

    Attributes
    ----------
    nodes
        Name -> node, those heard so far.
    """

    def __init__(self, state: State) -> None:
        import rclpy
        from bow_msgs.msg import Health
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.signals import SignalHandlerOptions

        from bow_sim.graph.discovery import apply_defaults
        from bow_sim.graph.node_base import LATCHED_DEEP

        os.environ.update(state.network)
        apply_defaults()
        self.state = state
        self.nodes: dict[str, Seen] = {}
        self._context = Context()
        rclpy.init(
            args=[],
            context=self._context,
            domain_id=int(state.domain),
            signal_handler_options=SignalHandlerOptions.NO,
        )
        self._node = rclpy.create_node(
            f"client_{random_id()[:8]}",
            namespace=state.namespace,
            context=self._context,
            enable_rosout=False,
            start_parameter_services=False,
        )
        for topic in (HEALTH, STATION_HEALTH):
            self._node.create_subscription(Health, topic, self._on_health, LATCHED_DEEP)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)

    def close(self) -> None:
        """Leave the graph; a command does that when its work is done."""
        at_end(self._leave)

    def _leave(self) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()
        del self._executor, self._node
        destroy_entities()

    def spin(self, seconds: float = SPIN_S) -> None:
        """Take in what comes within a time; update :attr:`nodes`."""
        self._executor.spin_once(timeout_sec=seconds)

    def _on_health(self, message: Health) -> None:
        if message.state == NodeState.DEAD:
            for name in [name for name, node in self.nodes.items() if node.pid == message.pid]:
                del self.nodes[name]
            return
        self.nodes[message.node] = Seen(
            message.role,
            message.node,
            message.incarnation,
            message.pid,
            message.state,
            message.detail,
            message.run_id,
            message.rss,
            time.monotonic(),
        )

    @property
    def coordinator(self) -> Seen | None:
        """The coordinator, as it was heard last."""
        return next((node for node in self.nodes.values() if node.role == "coordinator"), None)
