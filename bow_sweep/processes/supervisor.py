"""The processes of a graph on this machine: started, watched, started again, stopped, none left behind."""

from __future__ import annotations

import ctypes
import importlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import setproctitle

from bow_sim.graph.shm_notes import SUPERVISED, work_off
from bow_sweep.processes.fork import UNKNOWN, Forked, Process, Started
from bow_sweep.processes.roles import CHILD, MODULES
from bow_sweep.processes.shm_cleaner import Janitor

STOP_ORDER = ("simulator", "classifier", "coordinator", "recorder", "dashboard")
"""Sources first, so that the recorder still hears what was under way."""

STOP_S, LEAST_STOP_S = 15.0, 3.0
"""All processes have this long after a polite signal before they are killed, and those of each role at least that."""

CRASHES = 5
CRASHES_WITHIN_S = 20.0
"""A role that dies this often within this time will not come to life by starting it again."""

SPECTATORS = ("dashboard",)
"""Roles that are only for looking at: one that cannot live is left out."""

NAMED = 5
"""Arguments of a node that say which it is: ``--ros-args``, its name, its namespace."""

NICE = {"dashboard": 10}
"""Pictures wait where cores are short; the sweep does not."""

PR_SET_PDEATHSIG = 1

ROS_LOGS = "ROS_LOG_DIR"


class GraphError(Exception):
    """The graph cannot go on; the message names the process and its log."""


@dataclass
class Child:
    """One process of the graph."""

    role: str
    name: str
    process: Process
    log: Path
    started: float = field(default_factory=time.monotonic)
    worked: bool = False  # it was ready once

    def ask_to_end(self) -> None:
        """Ask politely; it hears it even where it was stopped."""
        self.process.send_signal(signal.SIGCONT)
        self.process.send_signal(signal.SIGINT)


@dataclass(frozen=True)
class Death:
    """A process that ended by itself."""

    child: Child
    status: int

    @property
    def cause(self) -> str:
        """What ended it, for people."""
        if self.status == UNKNOWN:
            return "exit status unknown: taken by another part of this process"
        if self.status < 0:
            known = {number.value: number.name for number in signal.Signals}
            return f"killed by {known.get(-self.status, f'signal {-self.status}')}"
        return f"exit status {self.status}"


def _be_a_child(role: str) -> None:
    """Run in the child first of all: get SIGTERM when the supervisor dies, and no Ctrl-C of the terminal."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    os.nice(NICE.get(role, 0))
    os.setpgid(0, 0)


def _main(role: str, name: str, command: Sequence[str], environment: Mapping[str, str]) -> int:
    """Be a node in a copy of the supervisor: under its own name, as if the command had started it."""
    _be_a_child(role)
    os.environ.update(environment)
    module, *arguments = command
    setproctitle.setproctitle(f"bow {' '.join(arguments[:NAMED])}")  # ROS names a log file by it, so it must be short
    setproctitle.setthreadtitle(name)
    sys.argv = [module, *arguments]
    status: int = importlib.import_module(module).main()
    return status


class Supervisor:
    """Starts one process a role (and several simulators) in a namespace and keeps them alive.

    Parameters
    ----------
    namespace
        ROS namespace of the graph.
    logs
        Directory for one log file a process.
    parameters
        Role -> ROS parameters of its nodes.
    finished
        Whether the work is done, as far as the disk says: asked where the coordinator's exit status is unknown.
    """

    def __init__(
        self,
        namespace: str,
        logs: Path,
        parameters: Mapping[str, Mapping[str, object]],
        finished: Callable[[], bool] = lambda: False,
    ) -> None:
        self.namespace, self.logs, self.parameters, self._finished = namespace, logs, parameters, finished
        self.children: list[Child] = []
        self._leaving: list[Child] = []
        self._count: dict[str, int] = {}
        self._deaths: dict[str, list[float]] = {}
        self.left_out: list[Path] = []
        """Logs of the processes that are not started again, though the graph goes on."""
        self._janitor: Janitor | None = None
        logs.mkdir(parents=True, exist_ok=True)
        work_off()
        self._logs_before = os.environ.get(ROS_LOGS)
        os.environ[ROS_LOGS] = str(logs.resolve())  # for the nodes of this process as for those of its children

    def start(self, role: str) -> Child:
        """Start a process; simulators get a new name each time, so that nobody mistakes one for its predecessor."""
        self._count[role] = self._count.get(role, 0) + 1
        name = f"simulator_{self._count[role]}" if role == "simulator" else role
        log = self.logs / f"{name}.log"
        janitor = self._hire()
        command = [MODULES[role], "--ros-args", *self._arguments(role, name)]
        environment = {"PYTHONUNBUFFERED": "1", SUPERVISED: "1"}
        process: Process
        if "rclpy" not in sys.modules and threading.active_count() == 1:  # a copy would lack other threads
            process = Forked(partial(_main, role, name, command, environment), log)
        else:
            python = [sys.executable, "-c", CHILD, str(Path(__file__).parent.parent)]
            process = Started([*python, *command], log, {**os.environ, **environment}, partial(_be_a_child, role))
        janitor.tell(process.pid)
        child = Child(role, name, process, log)
        self.children.append(child)
        return child

    def _hire(self) -> Janitor:
        """Return the janitor: at first, and where it was killed, a new one."""
        if self._janitor is None or self._janitor.died:
            pids = [child.process.pid for child in [*self.children, *self._leaving] if child.process.returncode is None]
            self._janitor = Janitor(self.logs, self.namespace, pids)
        return self._janitor

    def _arguments(self, role: str, name: str) -> list[str]:
        arguments = ["-r", f"__node:={name}", "-r", f"__ns:={self.namespace}", "--log-file-name", name]
        for key, value in self.parameters.get(role, {}).items():
            arguments += ["-p", f"{key}:={_yaml(value)}"]
        return arguments

    def buried(self) -> list[Death]:
        """Return the processes that have ended since the last call; they are no longer children."""
        ended = [(child, status) for child in self.children if (status := child.process.poll()) is not None]
        if self._janitor is not None:
            self._hire()
        gone = [Death(child, self._meant(child, status)) for child, status in ended]
        self.children = [child for child in self.children if child.process.returncode is None]
        return gone

    def leaves_out(self, death: Death) -> str:
        """Return why a process that is only for looking at is not started again, for people, or "".

        One that failed before it came to work would do so again; the others may end as often as a role may crash.
        """
        child = death.child
        if child.role not in SPECTATORS:
            return ""
        ends = self._deaths[child.role] = [*self._deaths.get(child.role, []), time.monotonic()]
        failed = death.status in range(1, 256)
        if len(ends) < CRASHES and (child.worked or not failed):
            return ""
        self.left_out.append(child.log)
        times = f"ended {len(ends)} times, at last: " if len(ends) > 1 else ""
        last = tail(child.log, 1).partition(f"{child.log.name}: ")[2] if failed else ""
        return f"{times}{death.cause}" + (f": {last}" if last else "")

    def _meant(self, child: Child, status: int) -> int:
        """Return the exit status of a child, 0 where it had done its work."""
        late = status == -signal.SIGALRM  # see ros.LEAVE_S
        done = status == UNKNOWN and child.role == "coordinator" and self._finished()
        return 0 if late or done else status

    def revive(self, death: Death) -> Child:
        """Start a process again.

        Simulators that came to work and died of it are the ledger's to judge: it gives up the block, not the sweep.

        Raises
        ------
        GraphError
            Where its role dies again and again.
        """
        if (death.child.role == "simulator" and death.child.worked) or death.child.role in SPECTATORS:
            return self.start(death.child.role)
        now = time.monotonic()
        deaths = [when for when in self._deaths.get(death.child.role, []) if now - when < CRASHES_WITHIN_S]
        self._deaths[death.child.role] = [*deaths, now]
        short_lived = now - death.child.started < CRASHES_WITHIN_S / CRASHES
        if len(deaths) + 1 >= CRASHES and short_lived and death.status >= 0:
            raise GraphError(f"{death.child.name} ended {CRASHES} times ({death.cause}):\n{tail(death.child.log)}")
        return self.start(death.child.role)

    def release(self, roles: Sequence[str]) -> None:
        """Tell processes whose work is over to end; nobody waits for them, or misses them."""
        going = [child for child in self.children if child.role in roles]
        self.children = [child for child in self.children if child not in going]
        self._leaving += going
        for child in going:
            child.ask_to_end()

    def stop(self, idle: bool) -> list[Child]:
        """Stop every process, politely first; return those that had to be killed.

        Where the graph is not `idle`, those that publish go first, so that the recorder still hears them.
        """
        stubborn: list[Child] = []
        began = time.monotonic()
        for roles in [STOP_ORDER] if idle else [[role] for role in STOP_ORDER]:
            group = [child for child in self.children if child.role in roles]
            for child in group:
                child.ask_to_end()
            deadline = max(began + STOP_S, time.monotonic() + LEAST_STOP_S)
            for child in [*group, *self._leaving]:
                try:
                    child.process.wait(max(0.1, deadline - time.monotonic()))
                except subprocess.TimeoutExpired:
                    stubborn.append(child)
                    child.process.kill()
                    child.process.wait()
        self.children += self._leaving
        self._leaving = []
        self.buried()
        if self._janitor is not None:
            self._janitor.close(STOP_S)
            self._janitor = None
        if self._logs_before is None:
            os.environ.pop(ROS_LOGS, None)
        else:
            os.environ[ROS_LOGS] = self._logs_before
        return stubborn


def _yaml(value: object) -> str:
    """Return a parameter value as the command line of a node takes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return "'" + value.replace("'", "''") + "'"
    if isinstance(value, Sequence):
        return "[" + ", ".join(_yaml(item) for item in value) + "]"
    return str(value)


def tail(log: Path, lines: int = 8) -> str:
    """Return the last lines of a log."""
    try:
        return "\n".join(f"  {log.name}: {line}" for line in log.read_text(errors="replace").splitlines()[-lines:])
    except OSError as error:
        return f"  {log}: {error.strerror}"
