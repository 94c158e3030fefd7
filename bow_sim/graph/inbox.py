"""Messages of one topic that a node takes when it wants them, all that wait at once.

An executor wakes a node for every message, which costs more than to take it: a node that receives thousands of messages
a second takes them by a timer.
"""

from __future__ import annotations

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription


class Inbox:
    """A subscription of which the executor of the node is not told.

    Parameters
    ----------
    node
        The node; it destroys the subscription when it is destroyed itself.
    kind, topic, qos
        Message type, topic and quality of service.

    Attributes
    ----------
    subscription
        The node must leave it out of its `subscriptions`, from which the executor takes those that it serves.
    """

    def __init__(self, node: Node, kind: type, topic: str, qos: QoSProfile) -> None:
        self._kind = kind
        self.subscription: Subscription = node.create_subscription(kind, topic, _not_called, qos, raw=True)

    def take(self, most: int) -> list[bytes]:
        """Return the messages that wait, in CDR, the oldest first; `most` of them at most."""
        out: list[bytes] = []
        handle = self.subscription.handle
        with handle:
            while len(out) < most and (taken := handle.take_message(self._kind, True)) is not None:
                out.append(taken[0])
        return out


def _not_called(_data: bytes) -> None:
    """Be the callback that a subscription must have."""
    raise AssertionError("the executor serves a subscription that is taken by hand")
