"""Decides whose plan a node obeys: only that of the coordinator in charge of the run in progress. No ROS, no clock.

Any process may publish a plan: another coordinator in the namespace, or a bag that is played there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from bow_sim.protocol.states import PlanState

MOST_CLOSED = 1000
"""Runs that were closed and are remembered, at most: a graph may stay for any number of runs."""


class Authority:
    """The run that a node works for, as announced by the plan that opened it.

    Parameters
    ----------
    is_alive
        Returns whether a coordinator, by its incarnation, is alive and works for a run, by its run_id.
    """

    def __init__(self, is_alive: Callable[[str, str], bool]) -> None:
        self._is_alive = is_alive
        self._closed: dict[str, int] = {}  # epoch in which each run was closed, the latest last
        self.run_id = self.owner = ""
        self.epoch = 0

    def objection(self, plan: Mapping[str, Any]) -> str:
        """Return why a decoded Plan is not to be obeyed; if "", its run is in progress from now on."""
        run_id, owner, epoch = str(plan["run_id"]), str(plan["incarnation"]), int(plan["epoch"])
        why = ""
        if self.run_id == run_id:
            if epoch < self.epoch or (epoch == self.epoch and owner != self.owner):
                why = f"epoch {epoch} of coordinator {owner or '?'}: epoch {self.epoch} of {self.owner} is in charge"
        elif self.run_id and plan["state"] != PlanState.OPEN:
            why = f"it closes run {run_id}, run {self.run_id} is in progress"
        elif epoch <= self._closed.get(run_id, -1):
            why = f"run {run_id} is over"
        elif self.run_id and self._is_alive(self.owner, self.run_id):
            why = f"run {run_id} of coordinator {owner or '?'}: run {self.run_id} of {self.owner} is in progress"
        if why:
            return why
        self.run_id, self.owner, self.epoch = run_id, owner, epoch
        if plan["state"] != PlanState.OPEN:
            self._closed.pop(run_id, None)
            if len(self._closed) >= MOST_CLOSED:
                del self._closed[next(iter(self._closed))]
            self._closed[run_id] = epoch
            self.release()
        return ""

    def release(self) -> None:
        """Note that no run is in progress any more."""
        self.run_id, self.owner, self.epoch = "", "", 0
