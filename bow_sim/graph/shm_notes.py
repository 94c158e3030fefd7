"""Notes on the shared memory of nodes without a supervisor: the next node that starts removes what a killed one left.

`bow sweep` starts a process for that, :mod:`bow_sweep.processes.shm_cleaner`. A node that is started by hand, or by
`ros2 launch`, writes a note instead: a file in shared memory that lists its other files there. The name of the note
encodes the user, the namespace of process numbers, the process number and the start of the process. If that process is
gone, the listed files are removed unless other processes use them.
"""

from __future__ import annotations

import contextlib
import os
import re
import stat
import time
from pathlib import Path

from bow_sim.graph import shm_files
from bow_sim.graph.discovery import SHARED_MEMORY
from bow_sim.graph.process_stat import start_of

SUPERVISED = "BOW_SUPERVISED"
"""Set in the environment of processes that have a supervisor: they write no notes."""

UPDATE_S = 0.5
"""Between two updates of a note; one takes 0.2 ms."""

MOST_BYTES = 1 << 20
"""Larger files are not notes."""

_NAME = re.compile(r"bow_([0-9]+)_([0-9]+)_([0-9]+)_([0-9]+)")


def _name(pid: int) -> str:
    return f"bow_{os.getuid()}_{_namespace()}_{pid}_{start_of(pid)}"


def _namespace() -> int:
    """Return the namespace of this process's number: containers may share memory without sharing process numbers."""
    return Path("/proc/self/ns/pid").stat().st_ino


class Note:
    """The note of this process; there is none if it cannot be written.

    Parameters
    ----------
    place
        Directory of the notes.
    """

    def __init__(self, place: Path = SHARED_MEMORY) -> None:
        remove_leftovers(place)
        self._files: set[str] = set()
        self._next_update = 0.0
        self._path: Path | None = None
        if not os.environ.get(SUPERVISED):
            with contextlib.suppress(OSError):
                self._path = place / _name(os.getpid())

    def update(self) -> None:
        """Add new files to the note; to be called often."""
        now = time.monotonic()
        if self._path is None or now < self._next_update:
            return
        self._next_update = now + UPDATE_S
        new = shm_files.files_of(os.getpid(), self._files)
        if new:
            self._files |= new
            self._write("".join(f"{file}\n" for file in sorted(new)))

    def _write(self, lines: str) -> None:
        assert self._path is not None
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW
        with contextlib.suppress(OSError), os.fdopen(os.open(self._path, flags, 0o600), "w") as out:
            out.write(lines)

    def close(self) -> None:
        """Remove the note: the process has released all files in it."""
        if self._path is not None:
            self._path.unlink(missing_ok=True)


def remove_leftovers(place: Path = SHARED_MEMORY) -> None:
    """Remove what the notes of processes of this user list that are gone, and ports that a process did not finish."""
    shm_files.free_unfinished(place)
    with contextlib.suppress(OSError):
        mine = (str(os.getuid()), str(_namespace()))
        for path in place.iterdir():
            found = _NAME.fullmatch(path.name)
            if found and found.groups()[:2] == mine and start_of(int(found[3])) != int(found[4]):
                _remove_leftovers_of(path)


def _remove_leftovers_of(path: Path) -> None:
    """Remove the files listed in a note, then the note, unless files are left; ports stay for the next process."""
    with contextlib.suppress(OSError):
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        with os.fdopen(descriptor, errors="replace") as file:
            about = os.fstat(descriptor)
            if not stat.S_ISREG(about.st_mode) or about.st_uid != os.getuid() or about.st_size > MOST_BYTES:
                return
            files = shm_files.named(file.read())
        if all(shm_files.is_port(left) for left in shm_files.remove(files)):
            path.unlink()
