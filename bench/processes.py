"""What the processes of a graph use: CPU time and memory of each, read from /proc."""

from __future__ import annotations

import contextlib
import os
import re
import threading
import time
from dataclasses import dataclass
from pathlib import Path

ROLE = re.compile(r"(coordinator|recorder|classifier|dashboard|simulator(_\w+)?)")
EVERY_S = 0.2
MEMORY_EVERY_S = 1.0
"""The kernel walks all pages of a process to say its share of them, which takes milliseconds."""

_TICK = os.sysconf("SC_CLK_TCK")
_PAGE = os.sysconf("SC_PAGE_SIZE")


def name_of(pid: int) -> str:
    """Return the role of a process of a graph, as ``simulator_1``; "" where nothing tells.

    Its own name says it, or the file that it logs into, or the name of its node on the command line.
    """
    root = Path("/proc") / str(pid)
    with contextlib.suppress(OSError):
        words = [(root / "comm").read_text().strip(), Path((root / "fd" / "1").readlink()).stem]
        for word in reversed((root / "cmdline").read_text().split("\0")):
            words.append(word.removeprefix("__node:=").rpartition(".")[2])
        return next((word for word in words if ROLE.fullmatch(word)), "")
    return ""


def memory_of(pid: int) -> dict[str, float]:
    """Return resident memory, the share of it that is this process's own (PSS), and the anonymous part, MB.

    Raises
    ------
    OSError
        Where the process is gone.
    """
    lines = (Path("/proc") / str(pid) / "smaps_rollup").read_text().splitlines()[1:]
    kilobytes = {line.split(":")[0]: float(line.split()[1]) for line in lines}
    return {key.lower(): kilobytes[key] * 1024 / 1e6 for key in ("Rss", "Pss", "Anonymous")}


def family_of(pid: int) -> list[int]:
    """Return a process and all that came of it, as far as they live."""
    found = [pid]
    for parent in found:  # grows while it is read
        with contextlib.suppress(OSError):
            for task in (Path("/proc") / str(parent) / "task").iterdir():
                with contextlib.suppress(OSError):
                    found += map(int, (task / "children").read_text().split())
    return found


@dataclass
class Usage:
    """What one process has used: CPU seconds, and its greatest resident memory and share of memory, MB."""

    name: str
    cpu_s: float = 0.0
    peak_rss_mb: float = 0.0
    peak_pss_mb: float = 0.0
    rss_mb: float = 0.0
    pss_mb: float = 0.0

    def read(self, pid: int, memory: bool) -> None:
        """Read /proc once more; with `memory` the share too, which is slower."""
        fields = (Path("/proc") / str(pid) / "stat").read_text().rpartition(")")[2].split()
        self.cpu_s = (int(fields[11]) + int(fields[12])) / _TICK
        self.rss_mb = int(fields[21]) * _PAGE / 1e6
        self.peak_rss_mb = max(self.peak_rss_mb, self.rss_mb)
        if memory:
            highest = re.search(r"VmHWM:\s*(\d+) kB", (Path("/proc") / str(pid) / "status").read_text())
            if highest:
                self.peak_rss_mb = max(self.peak_rss_mb, int(highest[1]) * 1024 / 1e6)
            self.pss_mb = memory_of(pid)["pss"]
            self.peak_pss_mb = max(self.peak_pss_mb, self.pss_mb)


class Watch:
    """Watches a process and all that it starts, in a thread, until :meth:`stop`.

    Attributes
    ----------
    usage
        pid -> what it has used.
    peak_rss_mb, peak_pss_mb
        The greatest sums over all processes at one time; the resident sum counts shared pages once for each.
    cpu_s
        What watching itself took.
    """

    def __init__(self, pid: int, name: str) -> None:
        self.usage = {pid: Usage(name)}
        self.peak_rss_mb = self.peak_pss_mb = self.cpu_s = 0.0
        self._root = pid
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch)
        self._thread.start()

    def _watch(self) -> None:
        looked = 0.0
        while not self._over.wait(EVERY_S):
            memory = time.monotonic() - looked > MEMORY_EVERY_S
            looked = time.monotonic() if memory else looked
            living = []
            for pid in family_of(self._root):
                used = self.usage.setdefault(pid, Usage(""))
                used.name = used.name or name_of(pid)
                with contextlib.suppress(OSError, IndexError):
                    used.read(pid, memory)
                    living.append(used)
            self.peak_rss_mb = max(self.peak_rss_mb, sum(used.rss_mb for used in living))
            if memory:
                self.peak_pss_mb = max(self.peak_pss_mb, sum(used.pss_mb for used in living))
        self.cpu_s = time.thread_time()

    def stop(self) -> dict[str, dict[str, float]]:
        """Stop watching; return name -> CPU seconds and peaks, those of one name that followed each other together."""
        self._over.set()
        self._thread.join()
        found: dict[str, dict[str, float]] = {}
        for used in self.usage.values():
            one = found.setdefault(used.name or "others", {"cpu_s": 0.0, "peak_rss_mb": 0.0, "peak_pss_mb": 0.0})
            one["cpu_s"] += used.cpu_s
            for key in ("peak_rss_mb", "peak_pss_mb"):
                one[key] = max(one[key], getattr(used, key))
        return dict(sorted(found.items()))
