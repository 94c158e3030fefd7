"""What is recorded: the topics of a run's graph, their types, and the quality of service they are offered with."""

from __future__ import annotations

from typing import NamedTuple


class Qos(NamedTuple):
    """Quality of service in rosbag2's words."""

    history: str
    depth: int
    reliability: str
    durability: str


STREAM = Qos("keep_all", 0, "reliable", "volatile")
"""What a bag asks for when it is played: nothing is dropped. Live streams keep the last 16, as credit bounds them."""

LATCHED = Qos("keep_last", 1, "reliable", "transient_local")
INSPECT = Qos("keep_last", 3, "best_effort", "volatile")
PLAIN = Qos("keep_last", 10, "reliable", "volatile")
LOGS = Qos("keep_last", 1000, "reliable", "transient_local")


class Topic(NamedTuple):
    """A topic by its name relative to the run's namespace; one that starts with a slash is global."""

    name: str
    type: str
    qos: Qos


TOPICS: dict[str, Topic] = {
    topic.name: topic
    for topic in (
        Topic("bridge_force", "bow_msgs/msg/BridgeForce", STREAM),
        Topic("stick_slip", "bow_msgs/msg/StickSlip", STREAM),
        Topic("verdicts", "bow_msgs/msg/Verdicts", STREAM),
        Topic("receipts", "bow_msgs/msg/Receipt", STREAM),
        Topic("plan", "bow_msgs/msg/Plan", LATCHED),
        Topic("blocks", "bow_msgs/msg/Block", STREAM),
        Topic("health", "bow_msgs/msg/Health", LATCHED),
        Topic("basin_map", "bow_msgs/msg/BasinMap", LATCHED),
        Topic("basin_map/image", "sensor_msgs/msg/Image", LATCHED),
        Topic("diagnostics", "diagnostic_msgs/msg/DiagnosticArray", PLAIN),
        Topic("inspect", "bow_msgs/msg/BridgeForce", INSPECT),
        Topic("/rosout", "rcl_interfaces/msg/Log", LOGS),
    )
}
"""Everything on the graph, by name."""

STORED_ONCE = {"bridge_force": "BridgeForce", "stick_slip": "StickSlip", "verdicts": "Verdicts"}
"""Topics whose messages have an identity, of which the bag holds each once, and the names that
:mod:`bow_sim.protocol.cdr` has."""


def short_name(topic: str) -> str:
    """Return the key of `TOPICS` for the full name a bag gives; "" where it is none of them."""
    if topic in TOPICS:
        return topic
    return next((name for name in TOPICS if topic.endswith("/" + name)), "")
