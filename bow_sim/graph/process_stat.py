"""What the kernel reports of a process in /proc/PID/stat."""

from __future__ import annotations

import os
from typing import NamedTuple


class ProcessStat(NamedTuple):
    """State, CPU time and start of a process; see proc_pid_stat(5)."""

    state: str
    """One letter: R running, S sleeping, D waiting for a disk, T or t stopped, Z zombie, X dead."""
    cpu_s: float
    """CPU seconds used, in user and kernel mode."""
    started: int
    """Start of the process, in clock ticks since boot: a number and a start name one process for good."""

    @property
    def has_ended(self) -> bool:
        """Whether it is a zombie: ended, and its parent has not yet taken the exit status."""
        return self.state in "ZX"


def read_stat(pid: int) -> ProcessStat | None:
    """Return what the kernel reports of a process; None where there is no process with this number."""
    try:
        with open(f"/proc/{pid}/stat", errors="replace") as file:  # pathlib takes twice as long
            text = file.read()
    except OSError:
        return None
    fields = text.rpartition(")")[2].split()  # field 2, the name in parentheses, may contain spaces
    return ProcessStat(fields[0], (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK"), int(fields[19]))


def start_of(pid: int) -> int | None:
    """Return when a process started, in clock ticks since boot; None where it has ended."""
    stat = read_stat(pid)
    return None if stat is None or stat.has_ended else stat.started
