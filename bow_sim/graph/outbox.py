"""Messages of one topic that must all be published, in order, also while a subscriber hangs."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable

from rclpy.publisher import Publisher

from bow_sim.graph.node_base import LOG_AGAIN_S, BowNode, RCLError
from bow_sim.protocol.neighbours import FIRST_HELLO_S, HELLO_S
from bow_sim.protocol.states import NodeState

RETRY_S = 0.25
"""Between two tries to publish while a subscriber hangs: publish() itself waits 0.1 s, and the node has other work."""


class Outbox:
    """Publishes messages in order and keeps those that cannot be published now; flow control bounds their number.

    Parameters
    ----------
    node
        The node that publishes: gives clock, log and timer.
    publisher
        Of the topic.
    """

    def __init__(self, node: BowNode, publisher: Publisher) -> None:
        self._node, self._publisher = node, publisher
        self._waiting: deque[bytes] = deque()
        self._blocked = False
        self._last_sent, self._said = float("-inf"), ""
        node.every(RETRY_S, self.flush)

    def send(self, messages: Iterable[bytes]) -> None:
        """Publish messages after those that wait already."""
        self._waiting.extend(messages)
        if not self._blocked:
            self.flush()

    def send_hello(self, make: Callable[[], bytes]) -> None:
        """Publish a hello if nothing was published for a while.

        Until the node is ready that is ten times a second, and when it waits for something else than at the last time:
        readers that have taken up the run meanwhile hear the next one.
        """
        health, pause = self._node.health, HELLO_S
        if health.state == NodeState.STARTING:
            pause = FIRST_HELLO_S if health.detail == self._said else 0.0
        if not self._waiting and self._node.awake.now() - self._last_sent >= pause:
            self._said = health.detail
            self.send([make()])

    def flush(self) -> None:
        """Publish the messages that wait, until the middleware reports an error."""
        self._blocked = False
        while self._waiting and not self._blocked:
            try:
                self._publisher.publish(self._waiting[0])
            except RCLError as error:
                self._blocked = True
                topic = self._publisher.topic_name
                readers = self._node.get_subscriptions_info_by_topic(topic)
                names = ", ".join(sorted({reader.node_name for reader in readers}))
                self._node.get_logger().warning(
                    f"{topic}: {len(self._waiting)} messages wait, one of the subscribers hangs ({names}): {error}",
                    throttle_duration_sec=LOG_AGAIN_S,
                )
            else:
                self._waiting.popleft()
                self._last_sent = self._node.awake.now()
