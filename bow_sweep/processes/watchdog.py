"""The watchdog of a graph: which processes make no progress, since when, and when that is too long. No ROS, no clock.

Times are seconds in which the supervisor could run (:class:`bow_sim.protocol.neighbours.AwakeClock`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from typing import NamedTuple

from bow_sim.graph.process_stat import read_stat
from bow_sim.protocol.messages import STREAMS
from bow_sim.protocol.neighbours import CONSUMERS
from bow_sim.protocol.states import NodeState

STUCK_S, AFTER_STOP_S = 12.0, 6.0
"""A process that is not ready after this time is restarted. After a stop the time is shorter: all have started before.
"""

UNHEARD_S = 15.0
"""A process has this long to send its first or next heartbeat, while it does not compute."""

LOST_S, JOINS = 6.0, 2
"""The supervisor joins the graph again when the coordinator, heard before, is not heard for this long, and this often
until it is heard: after a stop that is longer than the lease of DDS, two participants may not find each other again. It
does so after a stop also where the coordinator was never heard."""

STALL_S = 300.0
"""A sweep without progress for this long, while no process is stopped, is given up; it can be resumed."""

RESTARTS = 3
"""Each process of a role is restarted this often because its heartbeats do not arrive; more often does not help."""

BUSY_SHARE, BUSY_BYTES = 0.2, 1e6
"""A process is busy, and may be starting, that uses (or waits for) this share of a core, or moves this many bytes/s."""


class Usage(NamedTuple):
    """Resources that a process has used.

    Attributes
    ----------
    stopped
        It is stopped (SIGSTOP).
    runs
        It runs, or waits for a core or a disk.
    cpu_s
        CPU seconds so far.
    bytes
        Bytes read and written so far.
    """

    stopped: bool = False
    runs: bool = False
    cpu_s: float = 0.0
    bytes: int = 0


def usage(pid: int) -> Usage:
    """Return the resources that a process has used so far; zeros where it has exited."""
    stat = read_stat(pid)
    try:
        with open(f"/proc/{pid}/io") as file:  # pathlib takes twice as long
            lines = file.read().splitlines()
    except OSError:
        return Usage()
    if stat is None:
        return Usage()
    return Usage(stat.state in "Tt", stat.state in "RD", stat.cpu_s, sum(int(line.split()[1]) for line in lines[:2]))


class _Starting(NamedTuple):
    """A process that is not ready."""

    role: str
    since: float


class _Peer(NamedTuple):
    """A process that was heard: its role, incarnation and station, and since when it is heard."""

    role: str
    incarnation: str
    station: str
    since: float


class Watchdog:
    """Decides by heartbeats and CPU use which processes of a graph are stuck, unheard, or stalled.

    Parameters
    ----------
    run_id
        The run of the graph; an attribute too.
    read_usage
        Returns the :class:`Usage` of a process, by its number.
    """

    def __init__(self, run_id: str, read_usage: Callable[[int], Usage] = usage) -> None:
        self.run_id, self._read_usage = run_id, read_usage
        self._opened = math.inf  # when the coordinator had opened the run
        self._starting: dict[int, _Starting] = {}
        self._patience = STUCK_S
        self._without_run: set[int] = set()  # consumers that have not opened this run yet
        self._heard: dict[int, float] = {}  # time of the last heartbeat, or of the first call that names the process
        self._usage: dict[int, tuple[Usage, float]] = {}  # at the beginning of a second, and when that was
        self._ran: dict[int, list[bool]] = {}  # whether it ran, at each check since then
        self._coordinator: tuple[int, float] = (0, math.inf)  # its process, and when it was heard
        self._peers: dict[int, _Peer] = {}  # recorder, classifier and simulators
        self._heard_by_coordinator: set[str] = set()  # incarnations
        self._hears: dict[int, dict[str, set[str]]] = {}  # recorder or classifier: incarnation -> topics
        self._doubted: set[int] = set()  # consumers that did not hear a simulator which was restarted for that
        self._stuck: set[str] = set()  # roles of which a process was stuck and none was ready since
        self._joins = 0  # since then
        self._progress: tuple[object, float] = (None, 0.0)
        self.deaf = 0
        """Process of the coordinator that is restarted because it does not hear the others; 0 until there is one."""
        self.worked: set[int] = set()
        """Processes that have been ready."""

    def heartbeat(
        self,
        pid: int,
        role: str,
        state: int,
        run_id: str,
        now: float,
        incarnation: str = "",
        hears: Collection[str] = (),
        station: str = "",
    ) -> None:
        """Take in a heartbeat of one of our processes.

        Parameters
        ----------
        state
            A :class:`NodeState`.
        run_id
            The run that it works for.
        now
            Seconds.
        incarnation
            Of the process.
        hears
            As in a Health: an incarnation, and what arrives from it.
        station
            That the process is in.
        """
        self._heard[pid] = now
        if role == "coordinator":
            self._coordinator, self._joins = (pid, now), 0
            self._heard_by_coordinator = {words.split()[0] for words in hears if words}
            if run_id == self.run_id:
                self._opened = min(self._opened, now)
        elif role in (*CONSUMERS, "simulator"):
            self._peers.setdefault(pid, _Peer(role, incarnation, station, now))
        if role in CONSUMERS:
            self._hears[pid] = {words.split()[0]: set(words.split()[1:]) for words in hears if words}
        if state in (NodeState.READY, NodeState.BUSY):
            self.worked.add(pid)
        without_run = role in CONSUMERS and run_id != self.run_id
        (self._without_run.add if without_run else self._without_run.discard)(pid)
        if without_run or (state == NodeState.STARTING and run_id):
            self._starting.setdefault(pid, _Starting(role, now))
        else:
            self._starting.pop(pid, None)
            self._stuck.discard(role)

    def progress(self, value: object, now: float) -> None:
        """Take in how far the sweep is; a value other than the last one is progress."""
        if value != self._progress[0]:
            self._progress = (value, now)

    def suspend_timeouts(self, pids: Collection[int], now: float) -> set[int]:
        """Restart all timeouts while one of the processes is stopped; return those that are stopped."""
        stopped = {pid for pid in pids if self._read_usage(pid).stopped}
        if stopped:
            self.note_stop(now)
            self._restart_timeouts(now)
        return stopped

    def must_join_again(self, now: float) -> bool:
        """Return whether the supervisor itself has lost its connections; all timeouts then start again."""
        pid, heard = self._coordinator
        if now - heard <= LOST_S or self._joins == JOINS:
            return False
        self._joins += 1
        self._coordinator = (pid, now)
        self._restart_timeouts(now)
        return True

    def pause(self, now: float) -> None:
        """Restart the timeouts of processes: while their coordinator is away, none can be ready."""
        self._progress = (self._progress[0], now)
        self._starting = {pid: process._replace(since=now) for pid, process in self._starting.items()}
        self._heard = dict.fromkeys(self._heard, now)

    def _restart_timeouts(self, now: float) -> None:
        self.pause(now)
        pid, heard = self._coordinator
        self._coordinator = (pid, max(heard, now))

    def note_stop(self, now: float) -> None:
        """A process was stopped, or the machine slept: DDS may have lost connections that it does not find again.

        Also that to a coordinator which was not heard yet.
        """
        self._patience = AFTER_STOP_S
        pid, heard = self._coordinator
        self._coordinator = (pid, heard if heard < math.inf else now)

    def stuck(self, now: float, needed: Collection[int] = ()) -> set[int]:
        """Return the processes to restart because they are not ready; the timeouts of all others start again.

        Processes that are not ready wait for each other. First in question is a recorder or classifier that has not
        opened the run, then one that other nodes do not hear, then simulators. Where the successor of such a process is
        not ready either, recorder and classifier may be the ones that do not hear. If all these are ready and the
        coordinator is not, it is they that it does not hear; last in question is the coordinator itself, also where
        neither the successor of the recorder nor that of the classifier gets ready: `deaf` names it then, once.

        Parameters
        ----------
        now
            Seconds.
        needed
            The processes without which the sweep does not go on. One that was never heard may still be starting.
        """
        since = {pid: max(process.since, self._opened) for pid, process in self._starting.items()}
        consumers = {pid for pid, process in self._starting.items() if process.role in CONSUMERS}
        coordinator = self._coordinator[0]
        candidates = (self._without_run & consumers) or consumers or since.keys() - {coordinator}
        if not candidates and coordinator in since and not set(needed) - self._peers.keys() - {coordinator}:
            lost = {pid: self._peers[pid] for pid in needed if pid != coordinator}
            lost = {pid: peer for pid, peer in lost.items() if peer.incarnation not in self._heard_by_coordinator}
            since |= {pid: max(peer.since, since[coordinator]) for pid, peer in lost.items()}
            candidates = set(lost) or {coordinator}
        stuck = {pid for pid in candidates if now - since[pid] > self._patience}
        if stuck:
            stuck = self._deaf_to_simulators(stuck, needed) or stuck
            roles = {self._peers[pid].role for pid in stuck & self._peers.keys()}
            of_both = roles & self._stuck and self._stuck >= set(CONSUMERS)
            if of_both and coordinator in needed and not self.deaf:
                stuck, roles = {coordinator}, set()
                self._stuck.clear()
            elif roles & self._stuck:
                stuck |= {pid for pid in needed if pid in self._peers and self._peers[pid].role in CONSUMERS}
                roles |= set(CONSUMERS)
            if coordinator in stuck and not self.deaf:
                self.deaf, self._coordinator = coordinator, (0, math.inf)  # its successor has yet to be heard
            self._stuck |= roles
            self._without_run -= stuck
            others = {pid: process for pid, process in self._starting.items() if pid not in stuck}
            self._starting = {pid: process._replace(since=now) for pid, process in others.items()}
        return stuck

    def _deaf_to_simulators(self, stuck: Collection[int], needed: Collection[int]) -> set[int]:
        """Return the consumers to restart instead of stuck processes, which are simulators that these do not hear.

        A process that was killed may leave its listeners in the middleware without what others send them.
        """
        waiting = {pid: process.role for pid, process in self._starting.items()}
        if any(waiting.get(pid) != "simulator" for pid in stuck):
            return set()
        simulators = [peer for pid, peer in self._peers.items() if waiting.get(pid) == "simulator"]
        deaf = set()
        for pid in (self._hears.keys() & set(needed)) - waiting.keys():
            hears, station = self._hears[pid], self._peers[pid].station
            of_station = [peer.incarnation for peer in simulators if peer.station == station]
            unheard = sum(not hears.get(incarnation, set()).issuperset(STREAMS) for incarnation in of_station)
            if unheard > 1 or (unheard and pid in self._doubted):
                deaf.add(pid)
            elif unheard:
                self._doubted.add(pid)
        self._doubted -= deaf
        return deaf

    def unheard(self, pids: Collection[int], now: float) -> set[int]:
        """Return the processes whose heartbeat is overdue although they neither compute nor read."""
        overdue = set()
        for pid in pids:
            used = self._read_usage(pid)
            before, since = self._usage.setdefault(pid, (used, now))
            ran = self._ran.setdefault(pid, [])
            ran.append(used.runs)
            passed = now - since
            if passed > 1:
                self._usage[pid], self._ran[pid] = (used, now), []
                cpu, moved = (used.cpu_s - before.cpu_s) / passed, (used.bytes - before.bytes) / passed
                if max(cpu, sum(ran) / len(ran)) > BUSY_SHARE or moved > BUSY_BYTES:
                    self._extend(pid, now)
            if now - self._heard.setdefault(pid, now) > UNHEARD_S:
                overdue.add(pid)
        return overdue

    def _extend(self, pid: int, now: float) -> None:
        """Leave a busy process at least half of each timeout."""
        self._heard[pid] = max(self._heard.get(pid, now), now - UNHEARD_S / 2)
        if pid == self._coordinator[0]:
            self._coordinator = (pid, max(self._coordinator[1], now - LOST_S / 2))
        if pid in self._starting:
            process = self._starting[pid]
            self._starting[pid] = process._replace(since=max(process.since, now - self._patience / 2))

    def is_stalled(self, now: float) -> bool:
        """Return whether the sweep has made no progress for `STALL_S`."""
        return now - max(self._progress[1], self._opened) > STALL_S
