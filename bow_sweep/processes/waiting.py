"""Which processes of a graph are waited for, since when, and when that is too long. No ROS, no clock.

Times are seconds in which the supervisor could run (:class:`bow_sim.protocol.neighbours.AwakeClock`).
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Collection
from pathlib import Path
from typing import NamedTuple

from bow_sim.protocol.neighbours import BUSY, CONSUMERS, READY, STARTING

STUCK_S, AFTER_STOP_S = 12.0, 6.0
"""A process that does not get to work for so long is started again; sooner after a stop, when all have long started."""

UNHEARD_S = 15.0
"""A process has this long, while it does not compute, to be heard for the first time or again."""

STALL_S = 300.0
"""A sweep that makes no progress for so long, while no process is stopped, is given up; it can be resumed."""

RESTARTS = 3
"""A role that is started again so often because it is not heard will not be heard."""

BUSY_SHARE, BUSY_BYTES = 0.2, 1e6
"""Share of a core that a process uses or would use, if it had one, or bytes a second, that is still starting."""


class Usage(NamedTuple):
    """What the system says of a process: whether it is stopped, or runs or would like to; CPU seconds, bytes moved."""

    stopped: bool = False
    runs: bool = False
    cpu_s: float = 0.0
    bytes: int = 0


def usage(pid: int) -> Usage:
    """Return what a process used so far; of one that has ended, nothing."""
    try:
        words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        moved = [int(line.split()[1]) for line in Path(f"/proc/{pid}/io").read_text().splitlines()[:2]]
    except OSError:
        return Usage()
    return Usage(
        words[0] in "Tt", words[0] in "RD", (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK"), sum(moved)
    )


class Waiting:
    """What a supervisor knows of the progress of its graph.

    Parameters
    ----------
    run_id
        Of the run.
    look
        Returns the :class:`Usage` of a process.
    """

    def __init__(self, run_id: str, look: Callable[[int], Usage] = usage) -> None:
        self._run_id, self._look = run_id, look
        self._opened = math.inf  # when the coordinator had opened the run
        self._starting: dict[int, tuple[str, float]] = {}  # pid -> role, and since when it is not at work
        self._patience = STUCK_S
        self._away: set[int] = set()  # those of them that have not taken up the run
        self._heard: dict[int, float] = {}
        self._usage: dict[int, tuple[Usage, float]] = {}  # what each used, and when it was so much
        self._looks: dict[int, list[bool]] = {}  # since then: whether it ran
        self._progress: tuple[object, float] = (None, 0.0)
        self.worked: set[int] = set()
        """Processes that were ready once."""

    def hear(self, pid: int, role: str, state: int, run_id: str, now: float) -> None:
        """Take in a heartbeat of one of our processes."""
        self._heard[pid] = now
        if role == "coordinator" and run_id == self._run_id:
            self._opened = min(self._opened, now)
        if state in (READY, BUSY):
            self.worked.add(pid)
        away = role in CONSUMERS and run_id != self._run_id
        (self._away.add if away else self._away.discard)(pid)
        if away or (state == STARTING and run_id):
            self._starting.setdefault(pid, (role, now))
        else:
            self._starting.pop(pid, None)

    def advance(self, progress: object, now: float) -> None:
        """Take in how far the sweep is: any other value is progress."""
        if progress != self._progress[0]:
            self._progress = (progress, now)

    def hold(self, pids: Collection[int], now: float) -> set[int]:
        """Do not count the time in which one of our processes is stopped; return those that are."""
        stopped = {pid for pid in pids if self._look(pid).stopped}
        if stopped:
            self.note_stop()
            self._progress = (self._progress[0], now)
            self._starting = {pid: (role, now) for pid, (role, _) in self._starting.items()}
            self._heard.update(dict.fromkeys(self._heard.keys() & set(pids), now))
        return stopped

    def note_stop(self) -> None:
        """A process was stopped, or the machine slept: DDS may have lost what it does not find again."""
        self._patience = AFTER_STOP_S

    def stuck(self, now: float) -> set[int]:
        """Return the processes that do not get to work; all others have as long again, with their successors.

        Of those who wait for each other it is first a recorder or classifier that has not even taken up the run, then
        one that the others do not hear, then simulators.
        """
        starting = {pid: max(since, self._opened) for pid, (_, since) in self._starting.items()}
        consumers = {pid for pid, (role, _) in self._starting.items() if role in CONSUMERS}
        blamed = (self._away & consumers) or consumers or starting.keys()
        stuck = {pid for pid in blamed if now - starting[pid] > self._patience}
        if stuck:
            self._away -= stuck
            self._starting = {pid: (role, now) for pid, (role, _) in self._starting.items() if pid not in stuck}
        return stuck

    def unheard(self, pids: Collection[int], now: float) -> set[int]:
        """Return the processes whose heartbeat does not come although they neither compute nor read."""
        silent = set()
        for pid in pids:
            used = self._look(pid)
            before, since = self._usage.setdefault(pid, (used, now))
            looks = self._looks.setdefault(pid, [])
            looks.append(used.runs)
            passed = now - since
            if passed > 1:
                self._usage[pid], self._looks[pid] = (used, now), []
                cpu, moved = (used.cpu_s - before.cpu_s) / passed, (used.bytes - before.bytes) / passed
                if max(cpu, sum(looks) / len(looks)) > BUSY_SHARE or moved > BUSY_BYTES:
                    self._excuse(pid, now)
            if now - self._heard.setdefault(pid, now) > UNHEARD_S:
                silent.add(pid)
        return silent

    def _excuse(self, pid: int, now: float) -> None:
        """Give a process that is busy half of its time again."""
        self._heard[pid] = max(self._heard.get(pid, now), now - UNHEARD_S / 2)
        if pid in self._starting:
            role, since = self._starting[pid]
            self._starting[pid] = (role, max(since, now - self._patience / 2))

    def is_stalled(self, now: float) -> bool:
        """Return whether there was no progress for too long."""
        return now - max(self._progress[1], self._opened) > STALL_S
