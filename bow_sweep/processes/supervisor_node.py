"""The node of `bow sweep` itself: reports exits to the graph, and progress and problems to the user."""

from __future__ import annotations

import contextlib
import gc
import os
import time
from collections import Counter
from collections.abc import Callable

import numpy as np
import rclpy
from bow_msgs.msg import BasinMap, Health, Plan
from rclpy.context import Context
from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions

from bow_classifier.verdict.regimes import REGIMES
from bow_sim.graph.diagnosis import network_hints
from bow_sim.graph.discovery import apply_defaults
from bow_sim.graph.leaving import at_end, destroy_entities
from bow_sim.graph.node_base import LATCHED, LATCHED_DEEP, BowNode
from bow_sim.protocol import cdr
from bow_sim.protocol.neighbours import CONSUMERS, Neighbour
from bow_sim.protocol.stations import namespace_of, station_of
from bow_sweep.processes.interrupts import Interrupts
from bow_sweep.processes.observed import Observed
from bow_sweep.processes.progress import Display, Progress
from bow_sweep.processes.supervisor import SPECTATORS, Exit, GraphError, Supervisor, tail
from bow_sweep.processes.watchdog import RESTARTS, STALL_S, UNHEARD_S, Watchdog, usage
from bow_sweep.view.wanted import NOTE

SUSPENDED_S = 5.0
"""After this process was stopped for so long in all, DDS may have lost its connections."""

LOOK_S = 0.1
"""Least time between two looks at what each process uses: most messages need none."""

NEWS = ("refuses blocks", "waiting for the dashboard")
"""Health details that begin so are printed. They last: of two heartbeats at once only the second is sure to arrive."""


class SupervisorNode(BowNode):
    """Reports exits of our processes to the graph, and takes in what the others publish."""

    def __init__(self, name: str, seen: Observed, context: Context) -> None:
        super().__init__("supervisor", name, context=context)
        self._seen = seen
        # Depth 100: the publisher of heartbeats keeps one message, the last of several exits.
        self._exits = self.publish_heartbeats(LATCHED_DEEP)
        self.create_subscription(BasinMap, self.topic("basin_map"), self._on_map, LATCHED, raw=True)
        self.create_subscription(Plan, self.topic("plan"), self._on_plan, LATCHED_DEEP, raw=True)
        self.set_state(Health.READY)

    def _on_map(self, data: bytes) -> None:
        try:
            values = cdr.decode("BasinMap", data)
        except cdr.WireError:
            return
        self._seen.watchdog.progress(int(values["tests"].sum(dtype=np.int64)), self._seen.awake.now())
        counts = np.bincount(values["regime"], minlength=256)
        self._seen.progress = Progress(
            done=values["cells_done"],
            quarantined=values["cells_quarantined"],
            planned=sum(values[f"cells_{name}"] for name in ("done", "quarantined", "outstanding")),
            regimes={name: int(count) for name, count in zip(REGIMES, counts, strict=False)},
        )

    def _on_plan(self, data: bytes) -> None:
        with contextlib.suppress(cdr.WireError):
            plan = cdr.decode("Plan", data)
            self._seen.closed |= plan["state"] == Plan.CLOSED and self.run_namespace == f"/bow/{plan['run_id']}"

    def on_health(self, message: Health, neighbour: Neighbour | None) -> None:
        """Take in a heartbeat of our processes; those that others have started in this namespace do not count."""
        seen = self._seen
        if message.host != self.health.host or message.pid not in seen.ours:
            return
        now = seen.awake.now()
        seen.details[message.role], seen.states[message.role] = message.detail, message.state
        if message.state != Health.DEAD:
            seen.heard.add(message.pid)
            seen.watchdog.heartbeat(
                message.pid,
                message.role,
                message.state,
                message.run_id,
                now,
                message.incarnation,
                message.hears,
                station_of(message.node, self.run_namespace) or "",
            )
        if message.role == "coordinator":
            seen.note_waiting(message.detail if message.state == Health.STARTING else "", now)
        if message.state == Health.FAILED and message.role in CONSUMERS:
            seen.failed = f"{message.role}: {message.detail}"
        elif message.state == Health.FAILED or message.detail.startswith(NEWS):
            seen.news.setdefault(f"{message.node}: {message.detail}", True)
        for note in message.detail.split(NOTE)[1:]:
            seen.news.setdefault(note, True)

    def report_exit(self, exit_: Exit) -> None:
        """Publish that a process has exited."""
        message = Health(
            role=exit_.child.role,
            node=f"{namespace_of(self.run_namespace, exit_.child.station)}/{exit_.child.name}",
            pid=exit_.child.process.pid,
            host=self.health.host,
            state=Health.DEAD,
            detail=exit_.cause,
        )
        message.stamp = self.wall_time()
        for publisher in self._exits:
            publisher.publish(message)


def watch(supervisor: Supervisor, display: Display, interrupts: Interrupts, when_recorded: Callable[[], bool]) -> None:
    """Show the progress of a graph until all files of the run are complete, and restart processes that exit.

    Parameters
    ----------
    when_recorded
        Called when a recorder has closed its bag after the last plan; again while it returns False.

    Raises
    ------
    GraphError
        Where the graph cannot go on.
    KeyboardInterrupt
        After Ctrl-C or SIGTERM.
    """
    apply_defaults()
    gc.freeze()  # modules stay loaded: collections need not look at them
    graph = Connection(supervisor, supervisor.namespace.rpartition("/")[2])
    try:
        graph.join()
        _watch(supervisor, graph, display, interrupts, when_recorded)
    finally:
        at_end(graph.leave)


class Connection:
    """The supervisor's node in the graph, which can be made again: see `LOST_S`.

    Parameters
    ----------
    supervisor
        Of the graph; it makes no more copies of this process once the node has joined.
    run_id
        The run that the watchdog begins with.
    make
        Makes the node.
    station
        That the node is in; "" for a node of the run.
    """

    def __init__(
        self, supervisor: Supervisor, run_id: str, make: type[SupervisorNode] = SupervisorNode, station: str = ""
    ) -> None:
        namespace, self._supervisor = namespace_of(supervisor.namespace, station), supervisor
        place = ["-r", f"__ns:={namespace}", *(["-p", f"station:={station}"] if station else [])]
        self._arguments = ["bow", "--ros-args", *place, "--log-file-name", "supervisor"]
        self._make = make
        self.seen = Observed(Watchdog(run_id))
        self._made: list[tuple[Context, Executor, SupervisorNode]] = []

    def join(self) -> None:
        """Make a node with DDS connections of its own. Earlier ones stay, idle: ending them could take long.

        Where ROS cannot, for example for want of open files, GraphError is raised.
        """
        self._supervisor.stop_copying()
        context = Context()
        name = f"supervisor_{len(self._made) + 1}" if self._made else "supervisor"
        try:
            rclpy.init(args=self._arguments, context=context, signal_handler_options=SignalHandlerOptions.NO)
            executor, node = EventsExecutor(context=context), self._make(name, self.seen, context)
        except RuntimeError as error:  # RCLError is one; DDS raises others
            raise GraphError(f"ROS makes no node here: {error}") from None
        executor.add_node(node)
        self._made.append((context, executor, node))

    def join_if_lost(self, print_line: Callable[[str], object]) -> None:
        """Make another node where this one has lost its connections, and tell the user."""
        if self.seen.watchdog.must_join_again(self.seen.awake.now()):
            print_line("the coordinator is not heard any more: joining the graph again")
            self.join()

    def spin(self, timeout_s: float) -> None:
        """Take in what comes within a time."""
        self._made[-1][1].spin_once(timeout_sec=timeout_s)

    def report_exit(self, exit_: Exit) -> None:
        """Publish that a process has exited."""
        self._made[-1][2].report_exit(exit_)

    def leave(self) -> None:
        """End all nodes."""
        while self._made:
            context, executor, node = self._made.pop()
            executor.shutdown()
            node.destroy_node()
            context.try_shutdown()
            del context, executor, node
        destroy_entities()


def _watch(
    supervisor: Supervisor,
    graph: Connection,
    display: Display,
    interrupts: Interrupts,
    when_recorded: Callable[[], bool],
) -> None:
    """Spin until all files of the run are complete; restart processes that exit or are not heard."""
    restarts: Counter[str] = Counter()
    seen, look_at, told = graph.seen, 0.0, False
    while True:
        graph.spin(0.05)
        interrupts.check()
        print_news(seen, display)
        for exit_ in supervisor.exited():
            if exit_.child.role != "coordinator":
                restart_exited(supervisor, graph, [exit_], display)
            elif exit_.status == 0:
                return
            elif exit_.child.process.pid == seen.watchdog.deaf:
                graph.report_exit(exit_)
                supervisor.resume(exit_)
            else:
                graph.report_exit(exit_)  # stations on other machines need not wait until they miss it
                raise GraphError(f"the coordinator ended ({exit_.cause}):\n{tail(exit_.child.log)}")
        seen.ours = {child.process.pid for child in supervisor.children}
        graph.join_if_lost(display.print_line)
        if (now := time.monotonic()) >= look_at:
            look_at = now + LOOK_S
            restart_unresponsive(supervisor, seen, display.print_line, restarts)
        if release_finished(supervisor, seen):
            print_news(seen, display)
            return
        if seen.failed:
            raise GraphError(seen.failed)
        if problem := supervisor.screen.problem():
            display.print_line(problem)
        display.show(seen.progress, seen.details.get("coordinator", ""), now)
        if seen.closed and not told and seen.states.get("recorder") == Health.CLOSED:
            with interrupts.immediate():
                told = when_recorded()


def release_finished(supervisor: Supervisor, seen: Observed) -> bool:
    """Interrupt the processes whose work is over; return whether all files of the run are complete.

    Recorder and dashboard send messages that others must receive before they exit. The dashboard's last one went to the
    coordinator when it came here; that is still drawing then.
    """
    if not seen.closed:
        return False
    coordinator = seen.states.get("coordinator")
    over = coordinator in (Health.READY, Health.CLOSED)
    supervisor.release(("simulator", "classifier", *(["recorder"] if over else [])))
    if over or seen.states.get("dashboard") == Health.CLOSED:
        supervisor.release(("dashboard",))
    return coordinator == Health.READY


def print_news(seen: Observed, display: Display) -> None:
    """Print the lines that were not printed yet."""
    for line in [text for text, new in seen.news.items() if new]:
        seen.news[line] = False
        display.print_line(line)


def restart_exited(supervisor: Supervisor, graph: Connection, exits: list[Exit], display: Display) -> None:
    """Report exits to the graph, and start the processes again that it needs.

    Raises
    ------
    GraphError
        Where one exits again and again.
    """
    for exit_ in exits:
        child = exit_.child
        graph.report_exit(exit_)
        child.worked = child.process.pid in graph.seen.watchdog.worked
        if child.role in SPECTATORS:
            graph.seen.states.pop(child.role, None)  # not that of the next one
        if why := supervisor.why_left_out(exit_):
            display.print_line(f"the sweep goes on without {child.label} ({why}); see {child.log}")
            continue
        display.print_line(f"{child.label} ended ({exit_.cause}), starting it again; see {child.log}")
        supervisor.restart(exit_)


def restart_unresponsive(
    supervisor: Supervisor,
    seen: Observed,
    print_line: Callable[[str], None],
    restarts: Counter[str],
    stays: bool = False,
) -> None:
    """Kill the processes that others do not hear: the next round restarts them. Give up where that does not help.

    Parameters
    ----------
    print_line
        Takes a line for the user.
    restarts
        Role -> how often that was done; this counts on.
    stays
        The graph is there for more than one run: its coordinator is started again too.

    Raises
    ------
    GraphError
        Naming the processes that are not heard, and what to check.
    """
    now, watchdog = seen.awake.now(), seen.watchdog
    children = {child.process.pid: child for child in supervisor.children}
    needed = {pid: child for pid, child in children.items() if child.role not in SPECTATORS}
    if seen.awake.slept > SUSPENDED_S:
        watchdog.note_stop(now)
    stopped = watchdog.suspend_timeouts(needed, now)
    if stopped:
        names = ", ".join(sorted(children[pid].label for pid in stopped))
        seen.news.setdefault(f"stopped by somebody (SIGSTOP): {names}; the sweep waits until they go on", True)
        return
    unheard = watchdog.unheard(children, now)
    unheard -= {pid for pid in unheard - needed.keys() if usage(pid).stopped}  # the sweep does not need these
    if needed and unheard >= needed.keys():
        names = ", ".join(child.label for child in needed.values())
        raise GraphError(f"no heartbeat from {names} for {UNHEARD_S:g} s. Check: {hints()}")
    for pid in (unheard | watchdog.stuck(now, needed)) & children.keys():
        child = children[pid]
        restarts[child.role] += 1
        why = f"no heartbeat from {child.label}" if pid in unheard else f"{child.label} is not connected to the others"
        if pid == watchdog.deaf:
            why = "the coordinator does not hear all others, or not those that were started again"
        of_role = sum(other.role == child.role for other in children.values())
        too_often = restarts[child.role] > RESTARTS * of_role and pid in needed
        goes_on = stays or (pid == watchdog.deaf and bool(supervisor.again))
        if too_often or (child.role == "coordinator" and not goes_on):
            raise GraphError(f"{why}:\n{tail(child.log)}\nCheck: {hints()}")
        print_line(f"{why}: it is started again; see {child.log}")
        child.process.kill()
    if watchdog.is_stalled(now) and not seen.closed:
        why = f"no progress for {STALL_S:g} s; {seen.details.get('coordinator') or 'nothing is missing'}"
        if not stays:
            raise GraphError(why)
        print_line(f"{why}: the coordinator is started again, and its run is given up; it can be resumed")
        watchdog.progress(object(), now)
        for child in supervisor.children:
            if child.role == "coordinator":
                child.process.kill()


def hints() -> str:
    """Return what to look at where nodes do not hear each other, as text for people."""
    return "; ".join(network_hints(os.environ))
