"""The shared-memory cleaner: a process beside a supervisor that removes the files of processes that have exited.

It is a process and not a thread, because it must exist before the first child is forked from the supervisor, and a
fork copies only one thread. It is not part of the supervisor, because it must outlive a supervisor that is killed.
A note beside the logs lists the files it knows; where the cleaner is killed too, the next one of that run removes them.
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
from typing import TYPE_CHECKING

import setproctitle

from bow_sim.graph import shm_files
from bow_sim.graph.discovery import SHARED_MEMORY
from bow_sim.graph.process_stat import start_of
from bow_sweep.processes.exit_status import DONE, FAILED
from bow_sweep.processes.fork import Forked

if TYPE_CHECKING:
    from inotify_simple import INotify

NOTE = "shared_memory"
"""Notes are named ``shared_memory.<pid of the cleaner>``."""

SCAN_S = 0.02
"""Interval of looks at new files; one takes 0.1 ms, a scan of all that one process has open 0.2 ms."""

SETTLE_S = 0.1
"""A file has this long after its creation to show up among the files of its process."""

LEAVE_S = 30.0
"""A cleaner without a supervisor waits this long for the other processes to exit."""

CLOSE = 0
"""Written in place of a process number: all processes but the supervisor have exited."""


class SharedFiles:
    """The shared-memory files of some processes, and those left by processes that have exited.

    Parameters
    ----------
    logs
        Directory of the notes: those of earlier cleaners, which are read, and the one of this process.
    """

    def __init__(self, logs: Path) -> None:
        self._notes = set(logs.glob(f"{NOTE}.*"))
        self._note = logs / f"{NOTE}.{os.getpid()}"
        self._files: dict[int, set[str]] = {}
        self.unowned: set[str] = set()
        """Lock files created recently whose process is not known yet."""
        self._left = shm_files.remove(set[str]().union(*map(shm_files.noted, self._notes)))

    def add(self, pid: int) -> None:
        """Take in a process that has been started."""
        self._files[pid] = set()
        self._assign(pid, shm_files.files_of(pid))

    def created(self, names: Iterable[str]) -> None:
        """Take in names of files that were just created.

        Data-sharing file names encode the owner's process number; for locks, :meth:`look` has to ask the kernel.
        """
        for file in (f"{SHARED_MEMORY}/{name}" for name in names):
            owner = shm_files.owner(file)
            if shm_files.is_lock(file):
                self.unowned.add(file)
            for pid in self._files:
                if owner == pid % shm_files.OWNERS:
                    self._assign(pid, {file})

    def look(self) -> None:
        """Look whose the new locks are. Most are those of other graphs, which are then known as such."""
        holders = shm_files.holders()
        if holders is None:
            self.scan()
            return
        for file in list(self.unowned):
            place = shm_files.place_of(file)
            held_by = holders.get(place, set()) if place else {0}
            for pid in held_by & self._files.keys():
                self._assign(pid, {file})
            if held_by:
                self.unowned.discard(file)

    def scan(self) -> None:
        """Look for new files of all processes in /proc."""
        for pid, files in self._files.items():
            self._assign(pid, shm_files.files_of(pid, files))

    def _assign(self, pid: int, files: set[str]) -> None:
        if files - self._files[pid]:
            shm_files.note(self._note, files - self._files[pid])
            self._files[pid] |= files
            self.unowned -= files

    def exited(self, pid: int) -> None:
        """Remove the files of a process that has exited, as far as no other process uses them."""
        self._left = shm_files.remove(self._left | self._files.pop(pid, set()))

    def close(self) -> None:
        """Remove what is left, and the notes, when all processes have exited; files that others use by now stay."""
        for pid in list(self._files):
            self.exited(pid)
        shm_files.remove(self._left, ports=True)
        for note in self._notes | {self._note}:
            note.unlink(missing_ok=True)


class ShmCleaner:
    """Starts the cleaner process. Create it before other children: it has to be a fork without threads.

    Parameters
    ----------
    logs
        Directory for its log and its note.
    name
        Shown in lists of processes.
    pids
        Children that are running, or whose exit status was not taken yet: their numbers are not in use by others.
    """

    def __init__(self, logs: Path, name: str, pids: Iterable[int]) -> None:
        self._logs = logs
        receives, sends = os.pipe()
        self._pipe = open(sends, "wb", buffering=0)  # noqa: SIM115  # open as long as this object
        self._process = Forked(partial(_main, receives, logs, name), logs / "shm_cleaner.log", keep=receives)
        os.close(receives)
        for pid in (os.getpid(), *pids):
            self.watch(pid)

    @property
    def has_exited(self) -> bool:
        """Whether the process has exited without being told to. Another one learns from its note what there was."""
        return self._process.poll() is not None

    def watch(self, pid: int) -> None:
        """Tell the cleaner of one more process."""
        with contextlib.suppress(BrokenPipeError):
            self._pipe.write(b"%d\n" % pid)

    def close(self, timeout: float) -> None:
        """Have the last files removed when all other processes have exited; after `timeout` seconds, do it here."""
        self.watch(CLOSE)
        self._pipe.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout)
        self._process.kill()
        if self._process.wait():
            SharedFiles(self._logs).close()


def _main(pipe: int, logs: Path, name: str) -> int:
    """Run the cleaner process, in a process group of its own: Ctrl-C of the terminal must not reach it."""
    os.setpgid(0, 0)
    setproctitle.setproctitle(f"bow shm_cleaner {name}")
    gc.enable()
    with selectors.DefaultSelector() as selector:
        return _run(SharedFiles(logs), pipe, _inotify(), selector)


def _inotify() -> INotify | None:
    """Return what reports new files in shared memory; None where the system has no inotify instance left."""
    from inotify_simple import INotify, flags  # which runs ldconfig: a sweep need not wait for it

    try:
        inotify = INotify()
        inotify.add_watch(SHARED_MEMORY, flags.CREATE)
    except OSError:
        return None
    return inotify


def _run(files: SharedFiles, pipe: int, inotify: INotify | None, selector: selectors.BaseSelector) -> int:
    """Remove files until the supervisor tells to end, or all processes have exited.

    Returns
    -------
    int
        Exit status: `DONE`, or `FAILED` where processes without a supervisor did not exit in time.
    """
    for source in filter(None, (pipe, inotify)):
        selector.register(source, selectors.EVENT_READ)
    processes = _Processes(selector)
    settled = 0.0  # until then the owners of new lock files can still show up
    deadline = 0.0  # for processes without a supervisor to exit; 0 while there is one
    look_at = 0.0  # for ports that a process that has exited did not finish; 0 where none has
    while processes or not deadline:
        must_poll = inotify is None or deadline or look_at or files.unowned or processes.polled
        ready = {key.fd for key, _ in selector.select(SCAN_S if must_poll else None)}
        now = time.monotonic()
        if deadline and now > deadline:
            return FAILED
        if inotify is not None and inotify.fileno() in ready:
            files.created([event.name for event in inotify.read(timeout=0)])
            settled = now + SETTLE_S
        elif now > settled and files.unowned:  # nobody has locked them
            files.scan()
            files.unowned.clear()
        if pipe in ready:
            numbers = [int(number) for number in os.read(pipe, 1 << 16).split()]
            if CLOSE in numbers:
                break
            if not numbers:  # end of the pipe: the supervisor has exited
                selector.unregister(pipe)
                deadline = now + LEAVE_S
            for pid in numbers:
                files.add(pid)
                if not processes.add(pid):
                    files.exited(pid)
                    look_at = now + 2 * shm_files.MADE_S
        if inotify is None:
            files.scan()
        elif files.unowned:
            files.look()
        for pid in processes.exited(ready):
            files.exited(pid)
            look_at = now + 2 * shm_files.MADE_S
        if look_at and now > look_at:
            shm_files.free_unfinished()
            look_at = 0.0
    files.close()
    return DONE


class _Processes:
    """Running processes: the kernel reports their exit through a pidfd; where it has none, /proc is polled.

    Parameters
    ----------
    selector
        The pidfds are registered here.
    """

    def __init__(self, selector: selectors.BaseSelector) -> None:
        self._selector = selector
        self._pidfds: dict[int, int] = {}  # pidfd -> process number
        self.polled: dict[int, int] = {}
        """Process number -> start, in clock ticks since boot."""

    def __len__(self) -> int:
        return len(self._pidfds) + len(self.polled)

    def add(self, pid: int) -> bool:
        """Take in a process; return whether it is running."""
        try:
            descriptor = os.pidfd_open(pid)
        except ProcessLookupError:
            return False
        except (OSError, AttributeError):  # an old kernel, a sandbox, or a Python built on an old kernel
            started = start_of(pid)
            if started is not None:
                self.polled[pid] = started
            return started is not None
        self._pidfds[descriptor] = pid
        self._selector.register(descriptor, selectors.EVENT_READ)
        return True

    def exited(self, ready: set[int]) -> list[int]:
        """Return and forget the processes that have exited; `ready` are the descriptors that can be read."""
        gone = [pid for pid, started in self.polled.items() if start_of(pid) != started]
        for pid in gone:
            del self.polled[pid]
        for descriptor in ready & self._pidfds.keys():
            gone.append(self._pidfds.pop(descriptor))
            self._selector.unregister(descriptor)
            os.close(descriptor)
        return gone
