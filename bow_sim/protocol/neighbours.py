"""Who is on the graph, whose messages arrive where: what nodes say of each other in `health`. No ROS, no clock.

What the middleware knows of the graph (names, counts of endpoints) can stay wrong after a process was stopped for
longer than its lease. So nothing depends on it: a node is there as long as its heartbeat comes, and a topic works as
long as its reader says, in its own heartbeat, that messages arrive. A node that has nothing to publish sends a *hello*
on its topics once a second.
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
"""A node whose heartbeat, once a second, does not come for this long is taken for gone."""

HEARS_S = 4.0
"""A message is evidence for this long that its topic works."""

HELLO_S = 1.0
"""Between two hellos; while the reader does not say that they arrive, `FIRST_HELLO_S`."""

FIRST_HELLO_S = 0.1

DEAF_S = 5.0
"""A topic that worked counts as broken when its living reader has not confirmed it for this long."""

LONGEST_STEP_S = 1.0

MOST_LEFT = 1000
"""Nodes remembered that have gone."""

CONSUMERS = ("recorder", "classifier")
"""Roles of the nodes that take the streams whole: everybody waits for them."""

LEFT = "left"
"""Health.detail of a node that has gone by itself."""


class AwakeClock:
    """Seconds in which this process could run. A stop, or a sleep of the machine, counts as `LONGEST_STEP_S` at most.

    After a stop nobody was silent: we were deaf. Ask it at least once a second.

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
    """Return whether a process of this machine has ended; of other machines nothing is known."""
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
    """What arrives there from us: topics, and "health"."""
    confirmed: dict[str, float] = field(default_factory=dict)
    """Topic -> when it last said so."""

    @property
    def is_live(self) -> bool:
        """Whether it answers us: a heartbeat out of a bag cannot know our incarnation."""
        return bool(self.hears)


class Neighbours:
    """The other nodes of a namespace.

    Parameters
    ----------
    incarnation, host
        Of this node.
    cares
        Whose messages this node reports as heard: takes role and node name.
    """

    def __init__(self, incarnation: str, host: str, cares: Callable[[str, str], bool] = lambda *_: True) -> None:
        self._own, self._host, self._cares = incarnation, host, cares
        self._known: dict[str, Neighbour] = {}
        self._heard: dict[str, dict[str, float]] = {}
        self._left: deque[str] = deque(maxlen=MOST_LEFT)
        self.changed = False
        """Somebody or something new was heard: worth a heartbeat at once."""

    # ---- what comes in

    def heard(self, topic: str, incarnation: str, now: float) -> None:
        """A message of a node has come on a topic."""
        if incarnation and incarnation != self._own:
            topics = self._heard.setdefault(incarnation, {})
            self.changed |= topic not in topics
            topics[topic] = now

    def is_old(self, message: Any) -> bool:
        """Return whether a heartbeat is not newer than the latest of its node: somebody plays a bag."""
        known = self._known.get(message.incarnation)
        return message.incarnation in self._left or (known is not None and message.number <= known.number)

    def take(self, message: Any, now: float) -> Neighbour | None:
        """Take in a heartbeat (Health) that is no old one; return the node, or None where it has gone."""
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
        if self._cares(known.role, known.node):
            self.heard("health", incarnation, now)
        return known

    def forget(self, incarnation: str) -> None:
        """A node has gone."""
        self._known.pop(incarnation, None)
        self._heard.pop(incarnation, None)

    # ---- what goes out

    def hears(self, now: float) -> list[str]:
        """Return Health.hears: what arrives here from whom."""
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
        """Return a node that was heard of and has not gone."""
        return self._known.get(incarnation)

    def is_alive(self, incarnation: str, now: float) -> bool:
        """Return whether a node's heartbeat came within `SILENT_S`, and it has not ended since."""
        known = self._known.get(incarnation)
        if known is None or now - known.heard_at > SILENT_S:
            return False
        return now - known.heard_at < 2 or not is_gone(known.host, known.pid, self._host)

    def any_alive(self, now: float) -> bool:
        """Return whether anybody else is there."""
        return any(self.is_alive(incarnation, now) for incarnation in self._known)

    def of_role(self, role: str, now: float, run_id: str | None = None) -> list[Neighbour]:
        """Return the living nodes of a role, of a run if given."""
        found = [known for known in self._known.values() if known.role == role and run_id in (None, known.run_id)]
        return [known for known in found if self.is_alive(known.incarnation, now)]

    def missing(self, topics: Iterable[tuple[str, str]], run_id: str, now: float, patience: float) -> list[str]:
        """Return for people which readers of this node's topics are not there, or have not said that it arrives.

        Parameters
        ----------
        topics
            Pairs of topic and the role that has to hear it.
        run_id
            The run that the readers must have taken up.
        patience
            For so long, seconds, a reader need not have said so again.
        """
        out = []
        for topic, role in topics:
            readers = self.of_role(role, now, run_id)
            if not readers:
                out.append(f"no {role} has taken up the run")
            elif not any(now - known.confirmed.get(topic, -patience - 1) <= patience for known in readers):
                out.append(f"{readers[0].node} does not hear {topic}")
        return list(dict.fromkeys(out))

    def rival(self, role: str, node: str, started: tuple[int, int], single: bool) -> Neighbour | None:
        """Return a living node that is there instead of us: of our role where that is `single`, else of our name.

        Of two the one that started later gives way.
        """
        for other in self._known.values():
            same = other.role == role if single else other.node == node
            if same and other.is_live and (other.started, other.incarnation) < (started, self._own):
                return other
        return None
