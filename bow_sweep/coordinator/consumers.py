"""The recorder and the classifier that a coordinator works with. No ROS, no clock."""

from __future__ import annotations

from collections.abc import Callable

from bow_sim.protocol.neighbours import CONSUMERS, Neighbour, Neighbours
from bow_sim.protocol.states import NodeState


class Consumers:
    """One recorder and one classifier: the first of each that is heard, and another only when that one has gone.

    Parameters
    ----------
    neighbours
        The other nodes, as the coordinator hears them.
    log_error
        Takes a line for the log about a node that is ignored.
    """

    def __init__(self, neighbours: Neighbours, log_error: Callable[[str], object]) -> None:
        self._neighbours, self._log_error = neighbours, log_error
        self._chosen: dict[str, str] = {}
        self._ignored: set[str] = set()

    def update(self, other: Neighbour, now: float) -> bool:
        """Take a heartbeat of a recorder or classifier; return whether it replaces one that has gone."""
        chosen = self._chosen.get(other.role, other.incarnation)
        if chosen != other.incarnation and self._neighbours.is_alive(chosen, now):
            if other.incarnation not in self._ignored:
                self._ignored.add(other.incarnation)
                known = self._neighbours.get(chosen)
                self._log_error(
                    f"a second {other.role}, {other.node} (process {other.pid} on {other.host}), is ignored: "
                    f"process {known.pid if known else '?'} is in use; end one of them"
                )
            return False
        self._chosen[other.role] = other.incarnation
        return chosen != other.incarnation

    def is_ready(self, role: str, run_id: str, now: float) -> bool:
        """Return whether the chosen node of a role is alive and ready for a run."""
        known = self._neighbours.get(self._chosen.get(role, ""))
        if known is None or not self._neighbours.is_alive(known.incarnation, now):
            return False
        return known.run_id == run_id and known.state in (NodeState.READY, NodeState.BUSY)

    def missing(self, run_id: str, now: float) -> list[str]:
        """Return which of the two are not ready, and why, as texts for people; empty if both are ready."""
        return [self._reason(role, run_id, now) for role in CONSUMERS if not self.is_ready(role, run_id, now)]

    def is_plan_needed(self, run_id: str, now: float) -> bool:
        """Return whether recorder, classifier or a simulator has not taken up the run."""
        simulators = self._neighbours.of_role("simulator", now)
        return bool(self.missing(run_id, now)) or any(node.run_id != run_id for node in simulators)

    def _reason(self, role: str, run_id: str, now: float) -> str:
        heard = self._neighbours.of_role(role, now)
        if not heard:
            return f"no {role} is heard"
        of_run = [known for known in heard if known.run_id == run_id]
        return f"{role} ({of_run[0].detail or 'is starting'})" if of_run else f"{role} has not taken up the run"
