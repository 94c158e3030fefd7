"""When a run is over: the bag is closed and the dashboard has drawn, or they take too long. No ROS, no clock."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from bow_sim.protocol.neighbours import CLOSED, DEAD, FAILED

IDLE_S = 10.0
"""After the plan has closed, a dashboard that is starting, or has no run yet, has this long to take this one up."""

DRAW_S = 20.0
"""It has this long to draw: it is only for looking at, and may hang."""

DRAW_SAY_S = 5.0
"""Waiting for it is said when it lasts so long."""

CLOSE_S = 60.0
"""The recorder has this long to close the bag before the results are written without it."""


def waits_for(nodes: Iterable[Any], run_id: str, waited: float, shown: bool) -> str:
    """Return the role for which a run whose plan has closed waits; "" where it can be finished.

    Parameters
    ----------
    nodes
        The latest Health of each node.
    run_id
        Of the run.
    waited
        Seconds since its plan closed.
    shown
        Whether a dashboard was started for it.
    """
    gone, late = (CLOSED, FAILED, DEAD), waited > IDLE_S
    mine = [node for node in nodes if node.run_id == run_id or (not node.run_id and not late)]
    recorded = any(node.role == "recorder" and node.state in (CLOSED, FAILED) for node in mine)
    drawn = [node.state in gone for node in mine if node.role == "dashboard"]
    if not recorded and waited <= CLOSE_S:
        return "recorder"
    done = all(drawn) and (drawn or late or not shown)
    return "" if done or waited > (DRAW_S if recorded else CLOSE_S) else "dashboard"
