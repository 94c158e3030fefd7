"""The map and the health of the nodes as standard ROS messages, for tools such as RViz and rqt."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Mapping
from typing import Any

from bow_msgs.msg import Health
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from sensor_msgs.msg import Image

from bow_sim.protocol.states import NODE_STATE_NAMES, NodeState
from bow_sweep.maps.plane import Snapshot, image_of

LEVELS = {
    NodeState.READY: DiagnosticStatus.OK,
    NodeState.BUSY: DiagnosticStatus.OK,
    NodeState.CLOSED: DiagnosticStatus.OK,
    NodeState.STARTING: DiagnosticStatus.WARN,
    NodeState.DEAD: DiagnosticStatus.STALE,
    NodeState.FAILED: DiagnosticStatus.ERROR,
}
NUMBERS = ("messages", "bytes", "duplicates", "ignored", "rss", "pid")


def image_message(basin_map: Mapping[str, Any], stamp: Time) -> Image:
    """Return the transient lengths of a map (fields of a BasinMap) as an image: 32FC1, first row on top."""
    height, width, data = image_of(Snapshot.from_message(basin_map))
    image = Image(height=height, width=width, encoding="32FC1", step=4 * width, data=array("B", data))
    image.header.stamp = stamp
    image.header.frame_id = "basin_map"
    return image


def diagnostics_message(nodes: Iterable[Health], stamp: Time) -> DiagnosticArray:
    """Return the health of the nodes as diagnostics."""
    diagnostics = DiagnosticArray(
        status=[
            DiagnosticStatus(
                level=LEVELS.get(health.state, DiagnosticStatus.WARN),
                name=f"bow: {health.node}",
                hardware_id=health.host,
                message=health.detail or NODE_STATE_NAMES.get(health.state, ""),
                values=[KeyValue(key=name, value=str(getattr(health, name))) for name in NUMBERS],
            )
            for health in nodes
        ]
    )
    diagnostics.header.stamp = stamp
    return diagnostics
