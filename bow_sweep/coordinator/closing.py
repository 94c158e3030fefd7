"""When a closing run can be finished: its bags are closed and the dashboard has drawn, or they take too long."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from bow_sim.protocol.states import NodeState

IDLE_S = 10.0
"""Seconds that a dashboard without a run, perhaps still starting, has to take up the run after its plan has closed."""

NEXT_S = 5.0
"""Seconds in which one that was killed is heard again, started by its supervisor, unless it is left out."""

DRAW_S = 20.0
"""Seconds that a dashboard has to draw its last picture: it may hang, and no result depends on it."""

DRAW_REPORT_S = 5.0
"""After this many seconds of waiting for the dashboard the coordinator reports it."""

GONE_S = 15.0
"""A recorder that was not heard for so long has gone with its station, if there are others; one that is killed is
heard again before."""

CLOSE_S = 60.0
"""Seconds that the recorder has to close the bag, before the report is written without waiting for it."""


def waits_for(
    nodes: Iterable[Any],
    run_id: str,
    waited: float,
    shown: bool,
    station_of: Callable[[str], str] = lambda _: "",
    silent: Callable[[str], float] = lambda _: 0.0,
) -> str:
    """Return the role that a closing run waits for; "" if it can be finished.

    Parameters
    ----------
    nodes
        The latest Health of each node.
    run_id
        Of the closing run.
    waited
        Seconds since its plan closed.
    shown
        Whether a dashboard was started for it.
    station_of
        Returns the station of a node, by its full name: each station has a recorder.
    silent
        Returns for how many seconds a node was not heard, by its full name.
    """
    late = waited > IDLE_S
    of_run = [node for node in nodes if node.run_id == run_id or (not node.run_id and not late)]
    recorders = [node for node in of_run if node.role == "recorder"]
    closed = {station_of(node.node) for node in recorders if node.state in (NodeState.CLOSED, NodeState.FAILED)}
    there = {station_of(node.node) for node in recorders if silent(node.node) <= GONE_S}
    recorded = bool(closed) and there <= closed
    drawn = [
        node.state in (NodeState.CLOSED, NodeState.FAILED)
        or (node.state == NodeState.DEAD and silent(node.node) > NEXT_S)
        for node in of_run
        if node.role == "dashboard"
    ]
    if not recorded and waited <= CLOSE_S:
        return "recorder"
    all_drawn = all(drawn) and (drawn or late or not shown)
    return "" if all_drawn or waited > (DRAW_S if recorded else CLOSE_S) else "dashboard"
