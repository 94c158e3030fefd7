"""The node of a measured string, where DDS takes its messages no more."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import rclpy
from rclpy.publisher import Publisher

from bow_classifier.measured.tuning import Given
from bow_classifier.measured_node import FAILURES, MeasuredNode
from bow_sim.graph.node_base import RCLError
from bow_sim.protocol import cdr


class Full:
    """A publisher that has no memory left."""

    def publish(self, data: bytes) -> None:
        raise RCLError("cannot publish data")


@pytest.fixture
def node(ros_domain: int) -> Iterator[MeasuredNode]:
    rclpy.init()
    made = MeasuredNode("/bridge_force", Given(48000.0, 440.0, 0.1), 0.0, 1.0, "/bow")
    yield made
    made.destroy_node()
    rclpy.shutdown()


def test_a_publisher_that_takes_nothing_more_is_created_again(node: MeasuredNode) -> None:
    others = {topic: publisher for topic, publisher in node._topics.items() if topic != "bridge_force"}
    for again in (True, False):  # not twice within seconds: its readers have to find the new one
        node._topics["bridge_force"] = Full()  # type: ignore[assignment]
        for _ in range(FAILURES):
            node._publish("bridge_force", b"")
            node._publish("stick_slip", cdr.hello("StickSlip", node.incarnation))
        assert isinstance(node._topics["bridge_force"], Publisher) == again
    assert {topic: node._topics[topic] for topic in others} == others
