"""The recorder and the classifier that a coordinator goes by. No ROS, no clock."""

from __future__ import annotations

from collections.abc import Callable

from bow_sim.protocol.neighbours import BUSY, CONSUMERS, READY, Neighbour, Neighbours


class Consumers:
    """One recorder and one classifier: the first that is heard of, and another only when that has gone.

    Parameters
    ----------
    neighbours
        Of the coordinator.
    complain
        Takes a line for people on one that is not heeded.
    """

    def __init__(self, neighbours: Neighbours, complain: Callable[[str], object]) -> None:
        self._neighbours, self._complain = neighbours, complain
        self._chosen: dict[str, str] = {}
        self._unheeded: set[str] = set()

    def take(self, other: Neighbour, now: float) -> bool:
        """Take in a heartbeat of a recorder or classifier; return whether it takes the place of one that has gone."""
        chosen = self._chosen.get(other.role, other.incarnation)
        if chosen != other.incarnation and self._neighbours.is_alive(chosen, now):
            if other.incarnation not in self._unheeded:
                self._unheeded.add(other.incarnation)
                known = self._neighbours.get(chosen)
                self._complain(
                    f"a second {other.role}, {other.node} (process {other.pid} on {other.host}), is not heeded: "
                    f"process {known.pid if known else '?'} is at work; end one of them"
                )
            return False
        self._chosen[other.role] = other.incarnation
        return chosen != other.incarnation

    def is_ready(self, role: str, run_id: str, now: float) -> bool:
        """Return whether the one of a role is there and at work on a run."""
        known = self._neighbours.get(self._chosen.get(role, ""))
        if known is None or not self._neighbours.is_alive(known.incarnation, now):
            return False
        return known.run_id == run_id and known.state in (READY, BUSY)

    def missing(self, run_id: str, now: float) -> list[str]:
        """Return for people who is not ready, and why; empty where both are."""
        return [self._lacks(role, run_id, now) for role in CONSUMERS if not self.is_ready(role, run_id, now)]

    def untold(self, run_id: str, now: float) -> bool:
        """Return whether one of the two, or a simulator, has not taken up the run."""
        simulators = self._neighbours.of_role("simulator", now)
        return bool(self.missing(run_id, now)) or any(node.run_id != run_id for node in simulators)

    def _lacks(self, role: str, run_id: str, now: float) -> str:
        there = self._neighbours.of_role(role, now)
        if not there:
            return f"no {role} is heard"
        mine = [known for known in there if known.run_id == run_id]
        return f"{role} ({mine[0].detail or 'is starting'})" if mine else f"{role} has not taken up the run"
