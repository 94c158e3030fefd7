"""Serialised messages are published from their memory as rclpy publishes their bytes."""

from __future__ import annotations

import time

import numpy as np
import pytest
import rclpy
from any_values import values_of
from bow_msgs.msg import BridgeForce
from rclpy.node import Node

from bow_sim.graph.node_base import STREAM, STREAM_WRITER, RCLError
from bow_sim.graph.serialized import publish
from bow_sim.protocol import cdr


def message(cells: int) -> bytes:
    return cdr.encode("BridgeForce", values_of("BridgeForce", np.random.default_rng(1), cells))


def test_the_readers_get_the_same_bytes(ros_domain: int) -> None:
    rclpy.init()
    node = Node("messages")
    publisher = node.create_publisher(BridgeForce, "bridge_force", STREAM_WRITER)
    heard: list[bytes] = []
    node.create_subscription(BridgeForce, "bridge_force", heard.append, STREAM, raw=True)
    ends = time.monotonic() + 20
    while not publisher.get_subscription_count() and time.monotonic() < ends:
        time.sleep(0.01)
    sent = [message(cells) for cells in (0, 3, 500)]
    for each in sent:
        publish(publisher, each)
        memory = bytearray(each)
        publish(publisher, memoryview(memory))
        memory[:] = bytes(len(memory))  # it was copied meanwhile
    while len(heard) < 2 * len(sent) and time.monotonic() < ends:
        rclpy.spin_once(node, timeout_sec=0.1)
    twice = [each for each in sent for _ in range(2)]
    assert all(data == each for data, each in zip(heard, twice, strict=True))
    node.destroy_node()
    rclpy.shutdown()


def test_what_the_middleware_does_not_take_is_an_error_that_says_why(ros_domain: int) -> None:
    rclpy.init()
    node = Node("messages")
    publisher = node.create_publisher(BridgeForce, "bridge_force", STREAM_WRITER)
    rclpy.shutdown()
    for _ in range(2):
        with pytest.raises(RCLError, match="publisher's context is invalid"):
            publish(publisher, bytearray(message(3)))
    node.destroy_node()
