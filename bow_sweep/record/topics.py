"""The recorded topics of a run's graph: their types, and the quality of service that the bag offers them with.

In every bag they have the same names, whatever namespace the run had on the graph: one bag is one run, and its identity
is in the messages. So `ros2 bag play` feeds what listens in /bow, the namespace that ``ros2 run`` gives to a node.
"""

from __future__ import annotations

from typing import NamedTuple

from bow_sim.protocol.messages import STREAMS


class Qos(NamedTuple):
    """Quality of service, with the names that rosbag2 uses."""

    history: str
    depth: int
    reliability: str
    durability: str


STREAM = Qos("keep_all", 0, "reliable", "volatile")
"""Of a bag that is played: no message is dropped. Live streams keep the last 16, because credit limits them."""

LATCHED = Qos("keep_last", 1, "reliable", "transient_local")
INSPECT = Qos("keep_last", 3, "best_effort", "volatile")
PLAIN = Qos("keep_last", 10, "reliable", "volatile")
LOGS = Qos("keep_last", 1000, "reliable", "transient_local")


class Topic(NamedTuple):
    """A topic. Its name is relative to the run's namespace; a name that starts with a slash is global."""

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
        Topic("basin_map/regimes", "sensor_msgs/msg/Image", LATCHED),
        Topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", PLAIN),
        Topic("inspect", "bow_msgs/msg/InspectedCell", INSPECT),
        Topic("/rosout", "rcl_interfaces/msg/Log", LOGS),
    )
}
"""Name -> topic, for all topics of the graph."""

STORED_ONCE = STREAMS | {"verdicts": "Verdicts"}
"""Topic -> message type, as :mod:`bow_sim.protocol.cdr` names it, of messages with an identity: each is stored once."""


NAMESPACE = "/bow"
"""Namespace of the topics in a bag."""


def full_names(namespace: str = NAMESPACE) -> dict[str, str]:
    """Return the full name of every topic in a bag, by its key in `TOPICS`."""
    return {name: name if name.startswith("/") else f"{namespace}/{name}" for name in TOPICS}


def short_name(topic: str) -> str:
    """Return the key of `TOPICS` for the full name of a topic in a bag; "" where it is another topic."""
    if topic in TOPICS:
        return topic
    return next((name for name in TOPICS if topic.endswith("/" + name.lstrip("/"))), "")
