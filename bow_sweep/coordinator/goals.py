"""Goals that come before the nodes that their sweep needs: they wait, and are then refused. No ROS, no clock.

An action server can only reject a goal without a reason. So goals are accepted, and one that cannot be run ends at once
as aborted, with the reason in its result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bow_sim.physics.errors import ParameterError
from bow_sim.protocol.states import ONE_AT_A_TIME
from bow_sweep.coordinator.session_events import GoalAccepted, GoalRefused
from bow_sweep.plan.sweep import Sweep

GOAL_WAIT_S = 20.0
"""Seconds that a goal waits for recorder and classifier, which may be starting; a parameter of the node."""


@dataclass(frozen=True)
class Hold:
    """A goal waits; `why` is for the log."""

    why: str


def is_wrong(goal: GoalAccepted) -> bool:
    """Return whether the sweep of a goal cannot be computed, whoever is there."""
    try:
        Sweep.from_spec(goal.preset, goal.settings)
    except ParameterError:
        return True
    return False


class GoalGate:
    """Lets goals pass to the coordinator's session when recorder and classifier are there.

    Parameters
    ----------
    patience
        Seconds that a goal waits for them.
    """

    def __init__(self, patience: float = GOAL_WAIT_S) -> None:
        self._patience = patience
        self._held: GoalAccepted | None = None
        self._until = 0.0

    def take(self, goal: GoalAccepted, now: float, missing: Sequence[str]) -> GoalAccepted | GoalRefused | Hold:
        """Return what becomes of a new goal, of which the sweep can be computed.

        Parameters
        ----------
        now
            Seconds.
        missing
            Which nodes are missing, in words; empty if none is.
        """
        if self._held is not None:
            return GoalRefused(goal.goal, f"another goal waits for recorder and classifier; {ONE_AT_A_TIME}")
        if not missing:
            return goal
        self._held, self._until = goal, now + self._patience
        return Hold(f"a goal waits, {self._patience:g} s at most: {', '.join(missing)}")

    def look(self, now: float, missing: Sequence[str]) -> GoalAccepted | GoalRefused | None:
        """Return the goal that waits, if its time has come: to be run, or refused; None if it goes on waiting."""
        held = self._held
        if held is None or (missing and now < self._until):
            return None
        self._held = None
        if not missing:
            return held
        right = "start both nodes in the coordinator's namespace and send the goal again"
        return GoalRefused(held.goal, f"{', '.join(missing)} within {self._patience:g} s; {right}")

    def cancel(self, goal: bytes) -> GoalRefused | None:
        """Return the end of the goal that waits, if it is the one to be cancelled."""
        if self._held is None or self._held.goal != goal:
            return None
        self._held = None
        return GoalRefused(goal, "cancelled while it waited for recorder and classifier")
