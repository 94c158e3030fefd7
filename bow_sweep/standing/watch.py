"""Watches the nodes of a standing graph: restarts those that exit or are not heard, whatever run is in progress."""

from __future__ import annotations

import gc
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from bow_msgs.msg import Health

from bow_sim.graph.discovery import apply_defaults
from bow_sim.graph.leaving import at_end
from bow_sim.protocol.neighbours import Neighbour
from bow_sweep.processes.interrupts import Interrupts
from bow_sweep.processes.observed import NO_RUN
from bow_sweep.processes.supervisor import SPECTATORS, Supervisor
from bow_sweep.processes.supervisor_node import Connection, SupervisorNode, restart_unresponsive

LOOK_S, LOOK_IDLE_S = 0.05, 0.5
"""Between two looks at the processes, while a run is in progress and between two runs."""


class StandingNode(SupervisorNode):
    """As the supervisor of one run, but the run changes."""

    def on_health(self, message: Health, neighbour: Neighbour | None) -> None:
        """Take in a heartbeat; begin to watch another run when the coordinator has one."""
        ours = message.host == self.health.host and message.pid in self._seen.ours
        if ours and message.role == "coordinator" and message.state != Health.DEAD:
            self._seen.follow(message.run_id)
        super().on_health(message, neighbour)


def watch(
    supervisor: Supervisor,
    print_line: Callable[[str], None],
    interrupts: Interrupts,
    when_ready: Callable[[], None],
    when_left_out: Callable[[str, str, Path], None],
    is_over: Callable[[], bool],
) -> None:
    """Watch a graph until it is over.

    Parameters
    ----------
    print_line
        Takes a line for the log.
    when_ready
        Called once, when all nodes that runs need have been heard.
    when_left_out
        Called with name, reason and log of a node that the graph goes on without.
    is_over
        Returns whether the graph is not needed any more.

    Raises
    ------
    GraphError
        Where the graph cannot go on.
    KeyboardInterrupt
        After SIGTERM or SIGINT.
    """
    apply_defaults()
    gc.freeze()  # modules stay loaded: collections need not look at them
    connection = Connection(supervisor, NO_RUN, StandingNode)
    try:
        connection.join()
        _watch(supervisor, connection, print_line, interrupts, when_ready, when_left_out, is_over)
    finally:
        at_end(connection.leave)


def _watch(
    supervisor: Supervisor,
    connection: Connection,
    print_line: Callable[[str], None],
    interrupts: Interrupts,
    when_ready: Callable[[], None],
    when_left_out: Callable[[str, str, Path], None],
    is_over: Callable[[], bool],
) -> None:
    restarts: Counter[str] = Counter()
    seen, ready, run, look_at = connection.seen, False, NO_RUN, 0.0
    while not is_over():
        connection.spin(LOOK_S)
        interrupts.check()
        if time.monotonic() < look_at:
            continue
        look_at = time.monotonic() + (LOOK_IDLE_S if ready and seen.watchdog.run_id == NO_RUN else LOOK_S)
        if run != seen.watchdog.run_id:
            run = seen.watchdog.run_id
            restarts.clear()
        for exit_ in supervisor.exited():
            child = exit_.child
            connection.report_exit(exit_)
            child.worked = child.process.pid in seen.watchdog.worked
            if why := supervisor.why_left_out(exit_):
                print_line(f"the graph goes on without {child.name} ({why}); see {child.log}")
                when_left_out(child.name, why, child.log)
                continue
            print_line(f"{child.name} ended ({exit_.cause}), starting it again; see {child.log}")
            supervisor.restart(exit_)
        for line in [text for text, new in seen.news.items() if new]:
            print_line(line)
        seen.news.clear()
        seen.ours = {child.process.pid for child in supervisor.children}
        connection.join_if_lost(print_line)
        restart_unresponsive(supervisor, seen, print_line, restarts, stays=True)
        needed = {child.process.pid for child in supervisor.children if child.role not in SPECTATORS}
        if not ready and needed <= seen.heard:
            ready = True
            when_ready()
