"""Which processes of a graph are waited for, since when, and when that is too long. No ROS, no clock.

Times are seconds in which the supervisor could run (:class:`bow_sim.neighbours.AwakeClock`).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from pathlib import Path
from typing import NamedTuple

from bow_sim.neighbours import BUSY, CONSUMERS, READY, STARTING

STUCK_S = 12.0
"""A process that knows of the run and is not heard by the others for so long is started again."""

UNHEARD_S = 20.0
"""A process has this long, while it does not compute, to be heard for the first time or again."""

STALL_S = 120.0
"""A sweep that makes no progress for so long, while no process is stopped, is given up; it can be resumed."""

RESTARTS = 3
"""A role that is started again so often because it is not heard will not be heard."""

BUSY_SHARE = 0.2
"""Share of a core that a process uses which is still starting, rather than waiting."""


class Usage(NamedTuple):
    """What the system says of a process."""

    stopped: bool
    cpu_s: float


def usage(pid: int) -> Usage:
    """Return whether a process is stopped, and its CPU seconds; of one that has ended, neither."""
    try:
        words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return Usage(False, 0.0)
    return Usage(words[0] in "Tt", (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK"))


class Waiting:
    """What a supervisor knows of the progress of its graph.

    Parameters
    ----------
    look
        Returns the :class:`Usage` of a process.
    """

    def __init__(self, look: Callable[[int], Usage] = usage) -> None:
        self._look = look
        self._starting: dict[int, tuple[str, float]] = {}  # pid -> role, and since when it looks for the others
        self._heard: dict[int, float] = {}
        self._usage: dict[int, tuple[float, float]] = {}  # pid -> CPU seconds, and when they were so many
        self._progress: tuple[object, float] = (None, 0.0)
        self.worked: set[int] = set()
        """Processes that were ready once."""

    def hear(self, pid: int, role: str, state: int, run_id: str, now: float) -> None:
        """Take in a heartbeat of one of our processes."""
        self._heard[pid] = now
        if state in (READY, BUSY):
            self.worked.add(pid)
        if state == STARTING and run_id:
            self._starting.setdefault(pid, (role, now))
        else:
            self._starting.pop(pid, None)

    def advance(self, progress: object, now: float) -> None:
        """Take in how far the sweep is: any other value is progress."""
        if progress != self._progress[0]:
            self._progress = (progress, now)

    def hold(self, pids: Collection[int], now: float) -> bool:
        """Do not count the time in which one of our processes is stopped; return whether one is."""
        stopped = any(self._look(pid).stopped for pid in pids)
        if stopped:
            self._progress = (self._progress[0], now)
            self._starting = {pid: (role, now) for pid, (role, _) in self._starting.items()}
            self._heard.update(dict.fromkeys(self._heard.keys() & set(pids), now))
        return stopped

    def stuck(self, now: float) -> set[int]:
        """Return the processes that the others do not hear; all others have as long again to hear their successors.

        Simulators are blamed only where the consumers, for which they wait, are heard by everybody.
        """
        waits = any(role in CONSUMERS for role, _ in self._starting.values())
        blamed = CONSUMERS if waits else ("simulator",)
        stuck = {pid for pid, (role, since) in self._starting.items() if role in blamed and now - since > STUCK_S}
        if stuck:
            self._starting = {pid: (role, now) for pid, (role, _) in self._starting.items() if pid not in stuck}
        return stuck

    def unheard(self, pids: Collection[int], now: float) -> set[int]:
        """Return the processes whose heartbeat does not come although they do not compute."""
        silent = set()
        for pid in pids:
            cpu, at = self._look(pid).cpu_s, now
            before, since = self._usage.get(pid, (cpu, at))
            if cpu - before > BUSY_SHARE * (at - since) and at - since > 1:
                self._heard[pid] = max(self._heard.get(pid, now), now - UNHEARD_S / 2)
            if pid not in self._usage or at - since > 2:
                self._usage[pid] = (cpu, at)
            if now - self._heard.setdefault(pid, now) > UNHEARD_S:
                silent.add(pid)
        return silent

    def is_stalled(self, now: float) -> bool:
        """Return whether there was no progress for too long."""
        return now - self._progress[1] > STALL_S
