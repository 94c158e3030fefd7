"""The supervisor: starts, restarts and stops the processes of a graph on this machine, and leaves none behind."""

from __future__ import annotations

import importlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import setproctitle

from bow_sim.graph.environment import PAINTER_SOCKET
from bow_sim.graph.leaving import at_end
from bow_sim.graph.parent import end_with_parent
from bow_sim.graph.shm_notes import SUPERVISED, Note, remove_leftovers
from bow_sim.protocol.stations import named, namespace_of
from bow_sweep.processes.exit_status import DONE
from bow_sweep.processes.fork import UNKNOWN, Forked, Process, Spawned
from bow_sweep.processes.roles import CHILD, MODULES, PAINTER
from bow_sweep.processes.shm_cleaner import ShmCleaner
from bow_sweep.view.viewer import Screen

STOP_ORDER = ("simulator", "classifier", "coordinator", "recorder", "dashboard")
"""Sources first, so that the recorder still receives the messages under way."""

STOP_S, LEAST_STOP_S = 15.0, 3.0
"""Time from SIGINT to SIGKILL: so long for all processes together, and at least so long for those of each role."""

CRASHES = 5
CRASHES_WITHIN_S = 20.0
"""A role that exits this often within this time is not restarted any more."""

SPECTATORS = ("dashboard",)
"""Roles that only show the sweep: it goes on without one that cannot run."""

TITLE_ARGUMENTS = 5
"""Arguments of a node in its process title: ``--ros-args``, its name, its namespace."""

NICE = {"dashboard": 10}
"""Scheduling priority (nice value): where cores are short, pictures wait and the sweep does not."""

ROS_LOGS = "ROS_LOG_DIR"


class GraphError(Exception):
    """The graph cannot go on; the message names the process and its log."""


@dataclass
class Child:
    """One process of the graph.

    Attributes
    ----------
    role, name
        A key of :data:`bow_sweep.processes.roles.MODULES`, and the name of the node.
    log
        File with its stdout and stderr.
    station
        The station that it belongs to, see :mod:`bow_sim.protocol.stations`.
    started
        When it was started, seconds of the monotonic clock.
    worked
        It has been ready.
    """

    role: str
    name: str
    process: Process
    log: Path
    station: str = ""
    started: float = field(default_factory=time.monotonic)
    worked: bool = False

    @property
    def label(self) -> str:
        """Its name as text for people, with that of its station."""
        return f"{self.station}/{self.name}" if self.station else self.name

    def interrupt(self) -> None:
        """Send SIGINT, and SIGCONT before it: a stopped process would not get it."""
        self.process.send_signal(signal.SIGCONT)
        self.process.send_signal(signal.SIGINT)


@dataclass(frozen=True)
class Exit:
    """The exit of a process that nobody has stopped."""

    child: Child
    status: int

    @property
    def cause(self) -> str:
        """The exit status or signal, as text for people."""
        if self.status == UNKNOWN:
            return "exit status unknown: taken by another part of this process"
        if self.status < 0:
            known = {number.value: number.name for number in signal.Signals}
            return f"killed by {known.get(-self.status, f'signal {-self.status}')}"
        return f"exit status {self.status}"


def _prepare_child(nice: int) -> None:
    """Set up a child process: SIGTERM when the supervisor exits, and no Ctrl-C from the terminal."""
    end_with_parent()
    os.nice(nice)
    os.setpgid(0, 0)


def _run_node(nice: int, name: str, command: Sequence[str], environment: Mapping[str, str]) -> int:
    """Run a node in a copy of the supervisor, under its own name, as if the command had started it."""
    _prepare_child(nice)
    os.environ.update(environment)
    module, *arguments = command
    # ROS names a log file by the title, so it must be short.
    setproctitle.setproctitle(f"bow {' '.join(arguments[:TITLE_ARGUMENTS])}")
    setproctitle.setthreadtitle(name)
    sys.argv = [module, *arguments]
    status: int = importlib.import_module(module).main()
    return status


def _run_painter(descriptor: int, namespace: str) -> int:
    """Run the process that draws the picture, in a copy of the supervisor."""
    _prepare_child(0)
    setproctitle.setproctitle(f"bow painter {namespace}")
    status: int = importlib.import_module(PAINTER).serve(descriptor)
    return status


class Supervisor:
    """Starts the processes of a graph, one for each role and several simulators, and restarts those that exit.

    Parameters
    ----------
    namespace
        ROS namespace of the graph, that of the run; a station is in one below it.
    logs
        Directory for the log files, one for each process.
    parameters
        Role -> ROS parameters of its nodes.
    finished
        Returns whether the files of the run are complete. Called where the coordinator's exit status is unknown.
    screen
        Where the dashboard is seen live: somebody looks at it, so it has the same priority as the others.
    """

    def __init__(
        self,
        namespace: str,
        logs: Path,
        parameters: Mapping[str, Mapping[str, object]],
        finished: Callable[[], bool] = lambda: False,
        screen: Screen | None = None,
    ) -> None:
        self.namespace, self.logs, self.parameters, self._finished = namespace, logs, parameters, finished
        self.screen = screen or Screen()
        self.children: list[Child] = []
        self._released: list[Child] = []
        self._count: dict[str, int] = {}
        self._exits: dict[tuple[str, str], list[float]] = {}  # role and station -> when its processes exited
        self.again: Mapping[str, object] = {}
        """Parameters of a coordinator that goes on with the run in place of the first; none where none can."""
        self.left_out: list[Path] = []
        """Logs of the processes that are not restarted, though the graph goes on."""
        self._cleaner: ShmCleaner | None = None
        self._painter: Process | None = None
        self._to_painter: socket.socket | None = None  # until the coordinator has it
        self._copies = "rclpy" not in sys.modules  # who has loaded it may have DDS entities
        logs.mkdir(parents=True, exist_ok=True)
        remove_leftovers()
        self._logs_before = os.environ.get(ROS_LOGS)
        os.environ[ROS_LOGS] = str(logs.resolve())  # for the nodes of this process and of its children

    def start(self, role: str, station: str = "") -> Child:
        """Start a process, in a station. Each simulator gets a new name: nobody takes one for its predecessor."""
        self._count[role] = self._count.get(role, 0) + 1
        name = f"simulator_{self._count[role]}" if role == "simulator" else role
        of_log = f"{station}_{name}" if station else name
        log = self.logs / f"{of_log}.log"
        cleaner = self._running_cleaner()
        command = [MODULES[role], "--ros-args", *self._arguments(role, name, station, of_log)]
        environment = {"PYTHONUNBUFFERED": "1", SUPERVISED: "1"}
        nice = 0 if self.screen.process else NICE.get(role, 0)
        process: Process
        if self._can_copy:
            channel = self._to_painter if role == "coordinator" else None
            kept = channel.fileno() if channel else 0
            if channel:
                environment[PAINTER_SOCKET] = str(kept)
            process = Forked(partial(_run_node, nice, name, command, environment), log, kept)
            if channel:
                channel.close()
                self._to_painter = None
        else:
            python = [sys.executable, "-c", CHILD, str(Path(__file__).parents[2])]
            process = Spawned([*python, *command], log, {**os.environ, **environment}, partial(_prepare_child, nice))
        cleaner.watch(process.pid)
        child = Child(role, name, process, log, station)
        self.children.append(child)
        return child

    @property
    def _can_copy(self) -> bool:
        return self._copies and threading.active_count() == 1  # a copy would lack the other threads

    def start_painter(self) -> None:
        """Start the process that draws the picture for the coordinator that is started as a copy of this process.

        There is none where processes are not started as copies.
        """
        if self._can_copy:
            self._to_painter, its = socket.socketpair(type=socket.SOCK_SEQPACKET)
            with its:
                run = partial(_run_painter, its.fileno(), self.namespace)
                self._painter = Forked(run, self.logs / "painter.log", keep=its.fileno())

    def stop_copying(self) -> None:
        """Start no more processes as copies of this one: call it before this one makes DDS entities."""
        self._copies = False

    def _running_cleaner(self) -> ShmCleaner:
        """Return the shared-memory cleaner; start one at first, and where it has exited."""
        if self._cleaner is None or self._cleaner.has_exited:
            known = [child.process for child in [*self.children, *self._released]]
            pids = [process.pid for process in known if process.returncode is None]
            self._cleaner = ShmCleaner(self.logs, self.namespace, pids)
        return self._cleaner

    def _arguments(self, role: str, name: str, station: str, of_log: str) -> list[str]:
        namespace = namespace_of(self.namespace, station)
        arguments = ["-r", f"__node:={name}", "-r", f"__ns:={namespace}", "--log-file-name", of_log]
        for key, value in {**self.parameters.get(role, {}), **named(station)}.items():
            arguments += ["-p", f"{key}:={_yaml(value)}"]
        return arguments

    def exited(self) -> list[Exit]:
        """Return the processes that have exited since the last call; they are no longer children."""
        exits = [(child, status) for child in self.children if (status := child.process.poll()) is not None]
        if self._cleaner is not None:
            self._running_cleaner()
        if self._painter is not None:
            self._painter.poll()  # it ends with the coordinator that it draws for
        gone = [Exit(child, self._effective_status(child, status)) for child, status in exits]
        self.children = [child for child in self.children if child.process.returncode is None]
        return gone

    def why_left_out(self, exit_: Exit) -> str:
        """Return why a spectator is not restarted, as text for people; "" for a process to restart.

        One that failed before it was ready would fail again. Others may exit up to `CRASHES` times.
        """
        child = exit_.child
        if child.role not in SPECTATORS:
            return ""
        place = (child.role, child.station)
        exits = self._exits[place] = [*self._exits.get(place, []), time.monotonic()]
        failed = exit_.status in range(1, 256)
        if len(exits) < CRASHES and (child.worked or not failed):
            return ""
        self.left_out.append(child.log)
        times = f"ended {len(exits)} times, at last: " if len(exits) > 1 else ""
        last = tail(child.log, 1).partition(f"{child.log.name}: ")[2] if failed else ""
        return f"{times}{exit_.cause}" + (f": {last}" if last else "")

    def _effective_status(self, child: Child, status: int) -> int:
        """Return the exit status of a child; 0 where it had done its work before."""
        done = status == UNKNOWN and child.role == "coordinator" and self._finished()
        return DONE if done else status

    def restart(self, exit_: Exit) -> Child:
        """Start a process in place of one that has exited.

        A simulator that exits at work is restarted without a limit: the ledger quarantines the block that causes it.

        Raises
        ------
        GraphError
            Where its role exits again and again.
        """
        child = exit_.child
        if (child.role == "simulator" and child.worked) or child.role in SPECTATORS:
            return self.start(child.role, child.station)
        now, place = time.monotonic(), (child.role, child.station)
        recent = [when for when in self._exits.get(place, []) if now - when < CRASHES_WITHIN_S]
        self._exits[place] = [*recent, now]
        short_lived = now - child.started < CRASHES_WITHIN_S / CRASHES
        if len(recent) + 1 >= CRASHES and short_lived and exit_.status >= 0:
            raise GraphError(f"{child.label} ended {CRASHES} times ({exit_.cause}):\n{tail(child.log)}")
        return self.start(child.role, child.station)

    def resume(self, exit_: Exit) -> Child:
        """Start a coordinator that goes on with the run, in place of one that was killed for that."""
        self.parameters = {**self.parameters, exit_.child.role: self.again}
        return self.restart(exit_)

    def release(self, roles: Sequence[str]) -> None:
        """Interrupt the processes of roles whose work is over; do not wait for them, nor report their exit."""
        going = [child for child in self.children if child.role in roles]
        self.children = [child for child in self.children if child not in going]
        self._released += going
        for child in going:
            child.interrupt()

    def stop(self, idle: bool) -> list[Child]:
        """Stop every process, by SIGINT and then SIGKILL.

        Parameters
        ----------
        idle
            Nothing is under way: stop all at once. Otherwise publishers first, so that the recorder still gets their
            messages.

        Returns
        -------
        list
            The processes that had to be killed.
        """
        killed: list[Child] = []
        began = time.monotonic()
        for roles in [STOP_ORDER] if idle else [[role] for role in STOP_ORDER]:
            group = [child for child in self.children if child.role in roles]
            for child in group:
                child.interrupt()
            deadline = max(began + STOP_S, time.monotonic() + LEAST_STOP_S)
            for child in [*group, *self._released]:
                try:
                    child.process.wait(max(0.1, deadline - time.monotonic()))
                except subprocess.TimeoutExpired:
                    killed.append(child)
                    child.process.kill()
                    child.process.wait()
        if self._painter is not None:
            self._painter.kill()
            self._painter.wait()
        if self._to_painter is not None:
            self._to_painter.close()
        self.children += self._released
        self._released = []
        self.exited()
        if self._cleaner is not None:
            self._cleaner.close(STOP_S)
            self._cleaner = None
            note = Note()  # of what this process may leave where it does not leave DDS
            note.update()
            at_end(note.close)
        if self._logs_before is None:
            os.environ.pop(ROS_LOGS, None)
        else:
            os.environ[ROS_LOGS] = self._logs_before
        return killed


def _yaml(value: object) -> str:
    """Return a parameter value in the form of a node's command line."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return "'" + value.replace("'", "''") + "'"
    if isinstance(value, Sequence):
        return "[" + ", ".join(_yaml(item) for item in value) + "]"
    return str(value)


def tail(log: Path, lines: int = 8) -> str:
    """Return the last lines of a log, each with its file name before it."""
    try:
        return "\n".join(f"  {log.name}: {line}" for line in log.read_text(errors="replace").splitlines()[-lines:])
    except OSError as error:
        return f"  {log}: {error.strerror}"
