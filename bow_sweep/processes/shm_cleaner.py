"""A process beside a supervisor: it sees what its processes have in shared memory, and removes what dead ones leave.

It is no thread, as it has to be there before the first of them is copied from the supervisor, and no part of the
supervisor, as it outlives one that is killed. Where it is killed too, a note beside the logs says what there was, and
the next one of that run sees to it.
"""

from __future__ import annotations

import contextlib
import gc
import os
import selectors
import subprocess
import time
from collections.abc import Iterable
from functools import partial
from pathlib import Path

import setproctitle
from inotify_simple import INotify, flags

from bow_sim.graph import shm_files
from bow_sim.graph.discovery import SHARED_MEMORY
from bow_sweep.processes.fork import Forked

NOTE = "shared_memory"
"""Begin of the names of notes; the rest is the number of the janitor's process."""

LOOK_S = 0.02
"""Between two looks at what the processes have, while new files appear; a look at one takes 0.2 ms."""

SETTLE_S = 0.1
"""So long after a file was made, whose it is has shown."""

LEAVE_S = 30.0
"""So long a janitor waits for processes that outlive their supervisor."""


class House:
    """What processes have in shared memory, and what was left by those that have died.

    Parameters
    ----------
    logs
        Directory with the notes of those before us, and place for ours.
    """

    def __init__(self, logs: Path) -> None:
        self._notes = set(logs.glob(f"{NOTE}.*"))
        self._note = logs / f"{NOTE}.{os.getpid()}"
        self._files: dict[int, set[str]] = {}
        self.asks: set[str] = set()
        """Locks made just now, by nobody knows whom."""
        self._left = shm_files.remove(set[str]().union(*map(shm_files.noted, self._notes)))

    def enter(self, pid: int) -> None:
        """A process has been started."""
        self._files[pid] = set()
        self._take(pid, shm_files.files_of(pid))

    def make(self, names: Iterable[str]) -> None:
        """Files of these names have been made just now: what is lent says by whom; whose a lock is, a look says."""
        for file in (f"{SHARED_MEMORY}/{name}" for name in names):
            owner = shm_files.owner(file)
            if shm_files.is_lock(file):
                self.asks.add(file)
            for pid in self._files:
                if owner == pid % shm_files.OWNERS:
                    self._take(pid, {file})

    def look(self) -> None:
        """Look at what the living have."""
        for pid, files in self._files.items():
            self._take(pid, shm_files.files_of(pid, files))

    def _take(self, pid: int, files: set[str]) -> None:
        if files - self._files[pid]:
            shm_files.note(self._note, files - self._files[pid])
            self._files[pid] |= files
            self.asks -= files

    def leave(self, pid: int) -> None:
        """A process has died."""
        self._left = shm_files.remove(self._left | self._files.pop(pid, set()))

    def close(self) -> None:
        """All have died: remove the last of it, and the notes. What somebody else has by now is theirs."""
        for pid in list(self._files):
            self.leave(pid)
        shm_files.remove(self._left, ports=True)
        for note in self._notes | {self._note}:
            note.unlink(missing_ok=True)


class Janitor:
    """Starts the process; begin with it before there are others.

    Parameters
    ----------
    logs
        Directory for its log and its note.
    name
        What it is called in lists of processes.
    pids
        Processes to have an eye on, of which this one has not yet taken the exit status: no other has their numbers.
    """

    def __init__(self, logs: Path, name: str, pids: Iterable[int]) -> None:
        self._logs = logs
        heard, told = os.pipe()
        self._told = open(told, "wb", buffering=0)  # noqa: SIM115  # as long as this object
        self._process = Forked(partial(_main, heard, logs, name), logs / "janitor.log", keep=heard)
        os.close(heard)
        for pid in (os.getpid(), *pids):
            self.tell(pid)

    @property
    def died(self) -> bool:
        """Whether it has ended before it was told to; another one knows by its note what there was."""
        return self._process.poll() is not None

    def tell(self, pid: int) -> None:
        """Have an eye on one more process."""
        with contextlib.suppress(BrokenPipeError):
            self._told.write(b"%d\n" % pid)

    def close(self, timeout: float) -> None:
        """Have the last of it removed, now that all but this process have ended; after `timeout` seconds without it."""
        self.tell(CLOSE)
        self._told.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout)
        self._process.kill()
        if self._process.wait():
            House(self._logs).close()


CLOSE = 0
"""Said instead of the number of a process: the supervisor has no others, and lives on."""


def _main(heard: int, logs: Path, name: str) -> int:
    """Be the janitor, in a process of its own and out of the terminal's reach."""
    os.setpgid(0, 0)
    setproctitle.setproctitle(f"bow janitor {name}")
    gc.enable()
    with selectors.DefaultSelector() as selector:
        return _keep(House(logs), heard, _made(), selector)


def _made() -> INotify | None:
    """Return what tells of new files in shared memory; None where the system has no more of these."""
    try:
        made = INotify()
        made.add_watch(SHARED_MEMORY, flags.CREATE)
    except OSError:
        return None
    return made


def _keep(house: House, heard: int, made: INotify | None, selector: selectors.BaseSelector) -> int:
    """Keep house until the supervisor says so, or all have died; return 0, or 1 where some did not in time."""
    for source in filter(None, (heard, made)):
        selector.register(source, selectors.EVENT_READ)
    living = _Living(selector)
    settled, deadline = 0.0, 0.0  # until then it shows whose new locks are; processes without supervisor may end
    while living or not deadline:
        pause = LOOK_S if made is None or deadline or house.asks or living.looked_at else None
        ready = {key.fd for key, _ in selector.select(pause)}
        now = time.monotonic()
        if deadline and now > deadline:
            return 1
        if made is not None and made.fileno() in ready:
            house.make([event.name for event in made.read(timeout=0)])
            settled = now + SETTLE_S
        elif now > settled:  # a stranger's
            house.asks.clear()
        if heard in ready:
            said = [int(word) for word in os.read(heard, 1 << 16).split()]
            if CLOSE in said:
                break
            if not said:  # the supervisor has died
                selector.unregister(heard)
                deadline = now + LEAVE_S
            for pid in said:
                house.enter(pid)
                if not living.add(pid):
                    house.leave(pid)
        if made is None or house.asks:
            house.look()
        for pid in living.ended(ready):
            house.leave(pid)
    house.close()
    return 0


class _Living:
    """Processes until they end: the system tells of it, or they are looked at where it has no pidfd.

    Parameters
    ----------
    selector
        Gets the descriptors of those of which the system tells.
    """

    def __init__(self, selector: selectors.BaseSelector) -> None:
        self._selector = selector
        self._told: dict[int, int] = {}  # pidfd -> process
        self.looked_at: dict[int, str] = {}  # process -> its beginning

    def __len__(self) -> int:
        return len(self._told) + len(self.looked_at)

    def add(self, pid: int) -> bool:
        """Take in a process; return whether it lives."""
        try:
            descriptor = os.pidfd_open(pid)
        except ProcessLookupError:
            return False
        except (OSError, AttributeError):  # an old kernel, a sandbox, or a Python made on one
            began = _beginning(pid)
            if began:
                self.looked_at[pid] = began
            return bool(began)
        self._told[descriptor] = pid
        self._selector.register(descriptor, selectors.EVENT_READ)
        return True

    def ended(self, ready: set[int]) -> list[int]:
        """Return the processes that have ended, `ready` being the descriptors with news; they are forgotten."""
        gone = [pid for pid, began in self.looked_at.items() if _beginning(pid) != began]
        for pid in gone:
            del self.looked_at[pid]
        for descriptor in ready & self._told.keys():
            gone.append(self._told.pop(descriptor))
            self._selector.unregister(descriptor)
            os.close(descriptor)
        return gone


def _beginning(pid: int) -> str:
    """Return when a process began, as the system counts it; "" where it has ended."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(errors="replace")
    except OSError:
        return ""
    state, *numbers = stat.rpartition(")")[2].split()
    return "" if state in "ZX" else numbers[_STARTTIME]


_STARTTIME = 18
"""Place of the beginning in /proc/PID/stat, counted behind the state."""
