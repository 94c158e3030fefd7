"""The recorder and the classifier of each station that a coordinator works with. No ROS, no clock."""

from __future__ import annotations

from collections.abc import Callable

from bow_sim.protocol.neighbours import CONSUMERS, Neighbour, Neighbours
from bow_sim.protocol.states import NodeState
from bow_sim.protocol.stations import MOST_STATIONS, STATION_ROLES, station_of


class Consumers:
    """One recorder and one classifier: the first of each that is heard, and another only when that one has gone.

    Parameters
    ----------
    neighbours
        The other nodes, as the coordinator hears them.
    log_error
        Takes a line for the log about a node that is ignored.
    is_here
        Returns whether a node, by its full name, is of this station.
    """

    def __init__(
        self,
        neighbours: Neighbours,
        log_error: Callable[[str], object],
        is_here: Callable[[str], bool] = lambda _: True,
    ) -> None:
        self._neighbours, self._log_error, self._is_here = neighbours, log_error, is_here
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

    def are_ready(self, run_id: str, now: float) -> bool:
        """Return whether both are ready."""
        return all(self.is_ready(role, run_id, now) for role in CONSUMERS)

    def have_gone(self, now: float) -> bool:
        """Return whether one of the two, heard before, is not there any more, or cannot work any more."""
        known = [self._neighbours.get(incarnation) for incarnation in self._chosen.values()]
        return any(
            one is None or one.state == NodeState.FAILED or not self._neighbours.is_alive(one.incarnation, now)
            for one in known
        )

    def is_behind(self, run_id: str, now: float) -> bool:
        """Return whether one of the two is alive and has not taken up the run."""
        known = [self._neighbours.get(incarnation) for incarnation in self._chosen.values()]
        alive = [one for one in known if one is not None and self._neighbours.is_alive(one.incarnation, now)]
        return any(one.run_id != run_id for one in alive)

    def _reason(self, role: str, run_id: str, now: float) -> str:
        heard = [known for known in self._neighbours.of_role(role, now) if self._is_here(known.node)]
        if not heard:
            return f"no {role} is heard"
        of_run = [known for known in heard if known.run_id == run_id]
        return f"{role} ({of_run[0].detail or 'is starting'})" if of_run else f"{role} has not taken up the run"


class Stations:
    """The stations of a run that are heard, and the consumers of each.

    Parameters
    ----------
    neighbours, log_error
        As for :class:`Consumers`.
    namespace
        Of the run.
    """

    def __init__(self, neighbours: Neighbours, namespace: str, log_error: Callable[[str], object]) -> None:
        self._neighbours, self._namespace, self._log_error = neighbours, namespace, log_error
        self._consumers: dict[str, Consumers] = {}

    def of(self, node: str) -> str:
        """Return the station of a node, by its full name; a node that is somewhere else counts as beside us."""
        return station_of(node, self._namespace) or ""

    def hear(self, node: str, role: str) -> list[str]:
        """Take up the station of a node that is heard; return the stations that are new."""
        station = self.of(node)
        if role not in STATION_ROLES or station in self._consumers or len(self._consumers) >= MOST_STATIONS:
            return []
        self._consumers[station] = Consumers(self._neighbours, self._log_error, lambda node: self.of(node) == station)
        return [station]

    def update(self, other: Neighbour, now: float) -> bool:
        """Take a heartbeat of a recorder or classifier; return whether it replaces one of its station that has gone."""
        consumers = self._consumers.get(self.of(other.node))
        return consumers is not None and consumers.update(other, now)

    def ready(self, run_id: str, now: float, only: str | None = None) -> set[str]:
        """Return the stations whose recorder and classifier are ready; with `only` at most that one."""
        known = self._consumers if only is None else self._consumers.keys() & {only}
        return {station for station in known if self._consumers[station].are_ready(run_id, now)}

    def gone(self, now: float) -> set[str]:
        """Return the stations whose recorder or classifier has gone."""
        return {station for station, consumers in self._consumers.items() if consumers.have_gone(now)}

    def missing(self, run_id: str, now: float) -> list[str]:
        """Return what keeps each station from being ready, as texts for people."""
        known = self._consumers or {"": Consumers(self._neighbours, self._log_error, lambda node: self.of(node) == "")}
        if list(known) == [""]:
            return known[""].missing(run_id, now)
        return [
            f"{station or 'the station without a name'}: {', '.join(texts)}"
            for station, consumers in sorted(known.items())
            if (texts := consumers.missing(run_id, now))
        ]

    def is_plan_needed(self, run_id: str, now: float) -> bool:
        """Return whether a recorder, a classifier or a simulator that is heard has not taken up the run."""
        if not self.ready(run_id, now) or any(each.is_behind(run_id, now) for each in self._consumers.values()):
            return True
        return any(node.run_id != run_id for node in self._neighbours.of_role("simulator", now))
