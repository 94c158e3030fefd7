"""The state of a graph as diagnostics: one item for the health of each node, and what the coordinator knows. No ROS."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

from bow_sim.protocol.neighbours import LEFT
from bow_sim.protocol.states import NODE_STATE_NAMES, NodeState


class Level(IntEnum):
    """DiagnosticStatus.level."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


LEVELS = {
    NodeState.READY: Level.OK,
    NodeState.BUSY: Level.OK,
    NodeState.CLOSED: Level.OK,
    NodeState.STARTING: Level.WARN,
    NodeState.DEAD: Level.STALE,
    NodeState.FAILED: Level.ERROR,
}
NUMBERS = ("pid", "rss", "messages", "bytes", "duplicates", "ignored")
"""Fields of a heartbeat that are shown."""

MOST_AT_ONCE = 128
"""Nodes of which diagnostics are published at a time, as long as that is enough to have each in `TURNS` times."""

TURNS = 4
"""Times in which each node comes once: tools call stale what they have not heard for five seconds."""


@dataclass(frozen=True)
class Status:
    """One item, with the fields of a DiagnosticStatus; `name` is "NODE: ITEM", as diagnostic_updater writes it."""

    name: str
    level: Level
    message: str
    hardware_id: str
    values: Mapping[str, Any] = field(default_factory=dict)


def health_of(health: Any, alive: bool) -> Status:
    """Return the item of a node, from its latest heartbeat (Health); STALE if it is not heard any more."""
    level = LEVELS.get(health.state, Level.WARN) if alive else Level.STALE
    words = health.detail or NODE_STATE_NAMES.get(health.state, "")
    said = words if alive or health.state == NodeState.DEAD else f"not heard any more; the last word was: {words}"
    values = {"role": health.role, "state": NODE_STATE_NAMES.get(health.state, str(health.state))}
    values |= {"run_id": health.run_id, **{name: getattr(health, name) for name in NUMBERS}}
    return Status(f"{health.node}: health", level, said, health.host, values)


def in_turn(nodes: Sequence[Any], turn: int) -> Sequence[Any]:
    """Return the nodes that are published this time, the `turn`-th: all, unless they are very many.

    With 1024 nodes and no work, all of them each second took half of the time of the coordinator's thread.
    """
    parts = max(1, min(TURNS, math.ceil(len(nodes) / MOST_AT_ONCE)))
    return nodes[turn % parts :: parts]


def nodes_health(nodes: Iterable[Any], is_alive: Callable[[str], bool]) -> list[Status]:
    """Return the items of other nodes; one that has ended by itself has none.

    Parameters
    ----------
    nodes
        Their latest heartbeats.
    is_alive
        Returns whether a node is heard, by its incarnation.
    """
    there = [one for one in nodes if not (one.state == NodeState.CLOSED and one.detail == LEFT)]
    return [health_of(one, is_alive(one.incarnation)) for one in there]


def sweep_of(node: str, host: str, run_id: str, accounts: Mapping[str, int] | None) -> Status:
    """Return the item of the sweep; `accounts` of its cells, None if no sweep is open."""
    if accounts is None:
        return Status(f"{node}: sweep", Level.OK, "no sweep is open", host)
    level = Level.WARN if accounts["quarantined"] else Level.OK
    given_up = f", {accounts['quarantined']} given up" if accounts["quarantined"] else ""
    said = f"{accounts['done']} of {accounts['planned']} cells done{given_up}"
    return Status(f"{node}: sweep", level, said, host, {"run_id": run_id, **accounts})


def last_word(node: str, host: str, item: str, problem: str, otherwise: str) -> Status:
    """Return an item that shows the latest problem of its kind, as a warning, until something has gone well again."""
    return Status(f"{node}: {item}", Level.WARN if problem else Level.OK, problem or otherwise, host)
