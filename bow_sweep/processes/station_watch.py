"""Watches the processes of `bow station`: restarts those that exit, and sees when the run is over or lost."""

from __future__ import annotations

import gc
import time
from collections import Counter

from bow_msgs.msg import Health

from bow_sim.graph.discovery import apply_defaults
from bow_sim.graph.leaving import at_end
from bow_sim.protocol.neighbours import Neighbour
from bow_sim.protocol.states import NodeState
from bow_sweep.processes.interrupts import Interrupts
from bow_sweep.processes.leader import Leader
from bow_sweep.processes.observed import NO_RUN
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

CLOSE_S = 60.0
"""Seconds that the recorder has to close the bag when the run is over."""

ELSEWHERE = 0
"""Stands for the process of the coordinator, which is no child of this one."""


class StationNode(SupervisorNode):
    """Takes in the heartbeats of the run's coordinator too."""

    def on_health(self, message: Health, neighbour: Neighbour | None) -> None:
        """Take in a heartbeat of our processes, or of the coordinator."""
        super().on_health(message, neighbour)
        if message.role != "coordinator":
            return
        now, leader = self._seen.awake.now(), self._seen.leader
        if message.state == Health.DEAD:
            leader.died(message.host, message.pid, message.detail, now)
        elif neighbour is None:
            leader.left(message.incarnation)
        else:
            leader.heard(message.incarnation, message.host, message.pid, now)
            self._seen.watchdog.heartbeat(ELSEWHERE, message.role, NodeState.BUSY, message.run_id, now)
            self._seen.details[message.role] = message.detail


class StandingStationNode(StationNode):
    """As the supervisor of a station of one run, but the run changes."""

    def on_health(self, message: Health, neighbour: Neighbour | None) -> None:
        """Take in a heartbeat; begin to watch another run when the coordinator has one."""
        if message.role == "coordinator" and neighbour is not None:
            self._seen.follow(message.run_id)
        super().on_health(message, neighbour)


def watch_station(
    supervisor: Supervisor,
    station: str,
    display: Display,
    interrupts: Interrupts,
    stays: bool = False,
    was_closed: bool = False,
) -> None:
    """Show the progress of the run until it closes and the bag of the station is closed.

    Parameters
    ----------
    stays
        The station is of a standing graph, for all of its runs, until that ends.
    was_closed
        Its bag says that the run was closed.

    Raises
    ------
    GraphError
        Where the station cannot go on, or the coordinator is not heard.
    KeyboardInterrupt
        After Ctrl-C or SIGTERM.
    """
    apply_defaults()
    gc.freeze()  # modules stay loaded: collections need not look at them
    run_id = NO_RUN if stays else supervisor.namespace.rpartition("/")[2]
    graph = Connection(supervisor, run_id, StandingStationNode if stays else StationNode, station)
    graph.seen.leader = Leader("its graph to start it again") if stays else Leader(was_closed=was_closed)
    try:
        graph.join()
        _watch(supervisor, graph, display, interrupts, stays)
    finally:
        at_end(graph.leave)


def _watch(supervisor: Supervisor, graph: Connection, display: Display, interrupts: Interrupts, stays: bool) -> None:
    restarts: Counter[str] = Counter()
    seen = graph.seen
    closed_at = None
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
        if stays and seen.leader.has_left:
            display.print_line("the graph has ended")
            return
        if seen.leader.is_over(now):
            display.print_line("no coordinator is heard, and this station's bag was closed with the run: it is over")
            return
        if not seen.closed:
            _look_after_run(supervisor, graph, now, display, restarts, stays)
        heard = seen.leader.was_heard
        waiting = seen.details.get("coordinator", "") if heard else f"the coordinator, in {supervisor.namespace}"
        display.show(seen.progress, waiting, time.monotonic())


def _look_after_run(
    supervisor: Supervisor, graph: Connection, now: float, display: Display, restarts: Counter[str], stays: bool
) -> None:
    """Wait for a coordinator that is away; restart processes that are not heard while it is there.

    Raises
    ------
    GraphError
        Where nothing more is to be expected of the run, with what to look at.
    """
    seen = graph.seen
    if line := seen.leader.news(now):
        display.print_line(line)
    if why := seen.leader.lost(now):
        raise GraphError(f"{why}, in {supervisor.namespace}. Check: {hints()}")
    if not seen.leader.has_ended:
        graph.join_if_lost(display.print_line)
    if seen.leader.is_away(now):
        seen.watchdog.pause(now)
    else:
        restart_unresponsive(supervisor, seen, display.print_line, restarts, stays)
