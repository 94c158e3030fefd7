"""Which nodes are alive and which topics work, according to the heartbeats (`health`). No ROS, no clock.

The middleware's view of the graph (names, counts of endpoints) can stay wrong after a process was stopped for longer
than its lease, so nothing depends on it. A node is alive as long as its heartbeats arrive. A topic works as long as its
reader reports, in its own heartbeat, that messages arrive. A node that has nothing to publish sends a *hello* on its
topics once a second.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bow_sim.protocol.states import NodeState

SILENT_S = 6.0
"""A node whose heartbeat, sent once a second, does not arrive for this long counts as gone."""

HEARS_S = 4.0
"""A message proves for this long that its topic works."""

HELLO_S = 1.0
"""Between two hellos; `FIRST_HELLO_S` until the reader reports that they arrive."""

FIRST_HELLO_S = 0.1

UNCONFIRMED_S = 5.0
"""A topic that worked counts as broken if its living reader has not confirmed it for this long."""

LONGEST_STEP_S = 1.0
"""What `AwakeClock` counts at most between two calls."""

MOST_LEFT = 1000
"""Nodes that have gone and are remembered, at most: their late heartbeats are recognised as old."""

CONSUMERS = ("recorder", "classifier")
"""Roles of the nodes that receive every chunk: simulators wait for them."""

LEFT = "left"
"""Health.detail of a node that has ended by itself."""


class AwakeClock:
    """Seconds in which this process could run. A stop, or a suspend of the machine, counts as `LONGEST_STEP_S` at most.

    So deadlines of heartbeats extend by the time in which this process could not receive any. To be read at least once
    a second.

    Attributes
    ----------
    slept
        Seconds that were left out.
    """

    def __init__(self, source: Callable[[], float] = time.monotonic) -> None:
        self._source = source
        self._lock = threading.Lock()
        self._last = source()
        self._now = self.slept = 0.0

    def now(self) -> float:
        """Return the seconds since the start."""
        with self._lock:
            at = self._source()
            passed = max(at - self._last, 0.0)
            counted = min(passed, LONGEST_STEP_S)
            self._now += counted
            self.slept += passed - counted
            self._last = at
            return self._now


def is_gone(host: str, pid: int, own_host: str) -> bool:
    """Return whether a process of this machine has ended; False for processes of other machines, which are not seen."""
    return host == own_host and not Path(f"/proc/{pid}").exists()


@dataclass
class Neighbour:
    """Another node, as its latest heartbeat describes it."""

    role: str
    node: str
    incarnation: str
    host: str
    pid: int
    started: tuple[int, int]
    """Seconds and nanoseconds since 1970."""
    heard_at: float
    number: int = 0
    """Of the heartbeat."""
    run_id: str = ""
    state: int = NodeState.STARTING
    detail: str = ""
    hears: frozenset[str] = frozenset()
    """Our topics, and "health", from which messages arrive there."""
    confirmed: dict[str, float] = field(default_factory=dict)
    """Topic -> when the node last reported that messages arrive."""

    @property
    def is_live(self) -> bool:
        """Whether it receives our messages: a heartbeat from a bag cannot know our incarnation."""
        return bool(self.hears)


class Neighbours:
    """The other nodes of a namespace.

    Parameters
    ----------
    incarnation, host
        Of this node.
    confirms
        Takes role and node name; returns whether this node reports that the heartbeats of that node arrive.
    """

    def __init__(self, incarnation: str, host: str, confirms: Callable[[str, str], bool] = lambda *_: True) -> None:
        self._own, self._host, self._confirms = incarnation, host, confirms
        self._known: dict[str, Neighbour] = {}
        self._heard: dict[str, dict[str, float]] = {}
        self._left: deque[str] = deque(maxlen=MOST_LEFT)
        self.changed = False
        """Whether a new node or topic was heard: the next heartbeat is due at once."""

    # ---- what comes in

    def heard(self, topic: str, incarnation: str, now: float) -> None:
        """Note that a message of a node has arrived on a topic."""
        if incarnation and incarnation != self._own:
            topics = self._heard.setdefault(incarnation, {})
            self.changed |= topic not in topics
            topics[topic] = now

    def is_old(self, message: Any) -> bool:
        """Return whether a heartbeat is not newer than the latest of its node: it comes from a bag that is played."""
        known = self._known.get(message.incarnation)
        return message.incarnation in self._left or (known is not None and message.number <= known.number)

    def take(self, message: Any, now: float) -> Neighbour | None:
        """Take in a heartbeat (Health) that is not old; return the node, or None if it has gone."""
        if message.state == NodeState.DEAD:
            for incarnation, known in list(self._known.items()):
                if (known.host, known.pid) == (message.host, message.pid):
                    self.forget(incarnation)
            return None
        incarnation = message.incarnation
        if not incarnation or incarnation == self._own:
            return None
        if message.state == NodeState.CLOSED and message.detail == LEFT:
            self.forget(incarnation)
            self._left.append(incarnation)
            return None
        started = (message.started.sec, message.started.nanosec)
        new = Neighbour(message.role, message.node, incarnation, message.host, message.pid, started, now)
        known = self._known.setdefault(incarnation, new)
        known.number, known.run_id, known.state, known.detail, known.heard_at = (
            message.number,
            message.run_id,
            message.state,
            message.detail,
            now,
        )
        mine = [words.split()[1:] for words in message.hears if words.startswith(f"{self._own} ")]
        known.hears = frozenset(mine[0]) if mine else frozenset()
        known.confirmed.update(dict.fromkeys(known.hears, now))
        if self._confirms(known.role, known.node):
            self.heard("health", incarnation, now)
        return known

    def forget(self, incarnation: str) -> None:
        """Forget a node that has gone."""
        self._known.pop(incarnation, None)
        self._heard.pop(incarnation, None)

    # ---- what goes out

    def hears(self, now: float) -> list[str]:
        """Return Health.hears: for each node, the topics from which its messages arrive here."""
        self.changed = False
        for incarnation, topics in list(self._heard.items()):
            for topic, at in list(topics.items()):
                if now - at > HEARS_S:
                    del topics[topic]
            if not topics:
                del self._heard[incarnation]
        return [" ".join([incarnation, *sorted(topics)]) for incarnation, topics in sorted(self._heard.items())]

    # ---- what is asked

    def get(self, incarnation: str) -> Neighbour | None:
        """Return a node that is known and has not gone."""
        return self._known.get(incarnation)

    def is_alive(self, incarnation: str, now: float) -> bool:
        """Return whether a node's heartbeat arrived within `SILENT_S` and its process has not ended since."""
        known = self._known.get(incarnation)
        if known is None or now - known.heard_at > SILENT_S:
            return False
        return now - known.heard_at < 2 or not is_gone(known.host, known.pid, self._host)

    def any_alive(self, now: float) -> bool:
        """Return whether any other node is alive."""
        return any(self.is_alive(incarnation, now) for incarnation in self._known)

    def of_role(self, role: str, now: float, run_id: str | None = None) -> list[Neighbour]:
        """Return the living nodes of a role, of a run if given."""
        found = [known for known in self._known.values() if known.role == role and run_id in (None, known.run_id)]
        return [known for known in found if self.is_alive(known.incarnation, now)]

    def has_role(self, role: str, now: float) -> bool:
        """Return whether a node of a role is alive; the first that is found is enough."""
        return any(known.role == role and self.is_alive(each, now) for each, known in self._known.items())

    def missing(self, topics: Iterable[tuple[str, str]], run_id: str, now: float, patience: float) -> list[str]:
        """Return, as texts for the user, which readers of this node's topics are missing or do not receive them.

        Parameters
        ----------
        topics
            Pairs of topic and the role that has to receive it.
        run_id
            The run that the readers must have taken up.
        patience
            A report of a reader counts for so long, in seconds.
        """
        out = []
        for topic, role in topics:
            readers = self.of_role(role, now, run_id)
            if not readers:
                out.append(f"no {role} has taken up the run")
            elif not any(now - known.confirmed.get(topic, -patience - 1) <= patience for known in readers):
                out.append(f"{readers[0].node} does not hear {topic}")
        return list(dict.fromkeys(out))

    def rival(
        self, role: str, node: str, started: tuple[int, int], single: bool, among: Iterable[Neighbour] | None = None
    ) -> Neighbour | None:
        """Return a living node that started before this one and has its role, if that is `single`, or else its name.

        The node that started later has to end. Who asks at every heartbeat need look only `among` the node that sent
        it, as nothing else changes the answer; None: among all.
        """
        for other in self._known.values() if among is None else among:
            same = other.role == role if single else other.node == node
            if same and other.is_live and (other.started, other.incarnation) < (started, self._own):
                return other
        return None
