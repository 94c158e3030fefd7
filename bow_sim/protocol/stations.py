"""Stations: groups of simulators with a recorder and a classifier of their own. No ROS, no clock.

The nodes of a station NAME are in the namespace ``<run's namespace>/NAME``; there its streams, verdicts and receipts
stay. Plan, blocks and the map are topics of the run's namespace. So the station of a node follows from its name. The
station without a name, "", is that of the coordinator's namespace.
"""

from __future__ import annotations

import re

from bow_sim.protocol.messages import STREAMS

LONGEST_NAME = 32

NAME = re.compile(rf"[a-z][a-z0-9_]{{0,{LONGEST_NAME - 1}}}")

MOST_STATIONS = 1024
"""Stations of one run that a coordinator takes up at most: any process may publish heartbeats."""

STATION_ROLES = ("recorder", "classifier", "simulator")
"""Roles of the nodes that belong to a station; all others belong to the run."""

STATION_TOPICS = (*STREAMS, "verdicts", "receipts")
"""Topics that each station has for itself; all others are those of the run, but for heartbeats, see `HEALTH`."""

HEALTH, STATION_HEALTH = "health", "station_health"
"""Topics of heartbeats. `health` is in the run's namespace for nodes without a station, and in that of the station for
its own nodes. Those publish each heartbeat in the run's namespace too, on `station_health`, where only nodes of the run
listen. So a simulator receives what it needs, and the traffic does not grow with the square of the nodes."""


class StationError(ValueError):
    """A station cannot have this name, or a node is not where its station is; the text says what would be right."""


def check_name(name: str) -> str:
    """Return the name of a station.

    Raises
    ------
    StationError
        Where it is not 1 to 32 lower-case letters, digits and _, with a letter first.
    """
    if not NAME.fullmatch(name):
        raise StationError(
            f"station {name!r}: should be a lower-case letter, then lower-case letters, digits and _, "
            f"{LONGEST_NAME} characters at most, as in lab_2"
        )
    return name


def named(station: str) -> dict[str, str]:
    """Return how entries and parameters name a station: not at all, if it is the one without a name."""
    return {"station": station} if station else {}


def numbered(count: int) -> tuple[str, ...]:
    """Return the stations of a machine that is divided into `count`; one is the station without a name."""
    return ("",) if count == 1 else tuple(f"station_{number}" for number in range(1, count + 1))


def namespace_of(run_namespace: str, station: str) -> str:
    """Return the namespace of a station's nodes, as ``/bow/RUN/NAME``."""
    return f"{run_namespace.rstrip('/')}/{station}" if station else run_namespace


def run_namespace_of(namespace: str, station: str) -> str:
    """Return the run's namespace for a node of a station that is in `namespace`.

    Raises
    ------
    StationError
        Where this is no name of a station, or the namespace does not end with it.
    """
    if not station:
        return namespace
    check_name(station)
    above, _, last = namespace.rpartition("/")
    if last != station:
        raise StationError(
            f"station {station}: its nodes should be in a namespace that ends with its name, as /bow/RUN/{station}; "
            f"this one is in {namespace}"
        )
    return above or "/"


def station_of(node: str, run_namespace: str) -> str | None:
    """Return the station of a node, by its full name; None for a node that is not of this run.

    >>> station_of("/bow/a1/recorder", "/bow/a1"), station_of("/bow/a1/lab/recorder", "/bow/a1")
    ('', 'lab')
    """
    namespace, _, name = node.rpartition("/")
    if not name:
        return None
    if namespace == run_namespace.rstrip("/"):
        return ""
    above, _, last = namespace.rpartition("/")
    return last if above == run_namespace.rstrip("/") and NAME.fullmatch(last) else None
