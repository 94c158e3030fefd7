"""Watches the processes of `bow station`: restarts those that exit, and sees when the run is over or lost."""

from __future__ import annotations

import gc
import time
from collections import Counter

from bow_msgs.msg import Health

from bow_sim.graph.discovery import apply_defaults
from bow_sim.graph.node_process import exit_after, leave
from bow_sim.protocol.neighbours import Neighbour
from bow_sim.protocol.states import NodeState
from bow_sweep.processes.interrupts import Interrupts
from bow_sweep.processes.progress import Display
from bow_sweep.processes.supervisor import GraphError, Supervisor
from bow_sweep.processes.supervisor_node import (
    Connection,
    SupervisorNode,
    hints,
    print_news,
    restart_exited,
    restart_unresponsive,
)

FOUND_S = 60.0
"""A station ends that has not heard the coordinator of its run for this long after its start."""

LOST_S = 120.0
"""A station ends that has heard the coordinator of its run, and then not for this long."""

CLOSE_S = 60.0
"""Seconds that the recorder has to close the bag when the run is over."""

ELSEWHERE = 0
"""Stands for the process of the coordinator, which is no child of this one."""


class StationNode(SupervisorNode):
    """Takes in the heartbeats of the run's coordinator too."""

    def on_health(self, message: Health, neighbour: Neighbour | None) -> None:
        """Take in a heartbeat of our processes, or of the coordinator."""
        super().on_health(message, neighbour)
        if message.role == "coordinator" and neighbour is not None:
            now = self._seen.awake.now()
            self._seen.coordinator_at = now
            self._seen.watchdog.heartbeat(ELSEWHERE, message.role, NodeState.BUSY, message.run_id, now)
            self._seen.details[message.role] = message.detail


def watch_station(supervisor: Supervisor, station: str, display: Display, interrupts: Interrupts) -> None:
    """Show the progress of the run until it closes and the bag of the station is closed.

    Raises
    ------
    GraphError
        Where the station cannot go on, or the coordinator is not heard.
    KeyboardInterrupt
        After Ctrl-C or SIGTERM.
    """
    apply_defaults()
    gc.freeze()  # modules stay loaded: collections need not look at them
    run_id = supervisor.namespace.rpartition("/")[2]
    graph = Connection(supervisor.namespace, run_id, StationNode, station)
    try:
        graph.join()
        _watch(supervisor, graph, display, interrupts)
    finally:
        graph.leave()
        leave()
        exit_after(0)


def _watch(supervisor: Supervisor, graph: Connection, display: Display, interrupts: Interrupts) -> None:
    restarts: Counter[str] = Counter()
    seen = graph.seen
    began, closed_at = seen.awake.now(), None
    while True:
        graph.spin(0.05)
        interrupts.check()
        print_news(seen, display)
        restart_exited(supervisor, graph, supervisor.exited(), display)
        seen.ours = {child.process.pid for child in supervisor.children}
        now = seen.awake.now()
        if seen.closed:
            closed_at = now if closed_at is None else closed_at
            supervisor.release(("simulator", "classifier"))
            if seen.states.get("recorder") in (NodeState.CLOSED, NodeState.FAILED) or now - closed_at > CLOSE_S:
                return
        if seen.failed:
            raise GraphError(seen.failed)
        _check_coordinator(supervisor.namespace, seen.coordinator_at, now, began)
        graph.join_if_lost(display.print_line)
        if not seen.closed:
            restart_unresponsive(supervisor, seen, display.print_line, restarts)
        heard = seen.coordinator_at is not None
        waiting = seen.details.get("coordinator", "") if heard else f"the coordinator, in {supervisor.namespace}"
        display.show(seen.progress, waiting, time.monotonic())


def _check_coordinator(namespace: str, at: float | None, now: float, began: float) -> None:
    """Give up where nothing more is to be expected of the run.

    Raises
    ------
    GraphError
        With what to look at.
    """
    if at is None and now - began > FOUND_S:
        raise GraphError(
            f"no coordinator is heard in {namespace} for {FOUND_S:g} s: is the run in progress, and does it ask for "
            f"other machines (--network)? Check: {hints()}"
        )
    if at is not None and now - at > LOST_S:
        raise GraphError(f"the coordinator in {namespace} is not heard any more for {LOST_S:g} s. Check: {hints()}")
