"""What a node without a supervisor leaves in shared memory when it is killed: the next node that starts removes it.

Under `bow sweep` a process sees to that, :mod:`bow_sweep.processes.shm_cleaner`. A node that somebody starts by hand,
or `ros2 launch`, has a note instead, in shared memory too: a file that lists what it has there. Its name says whose it
is: user, process, when that started, and the namespace of process numbers. A note of ours whose process is gone is
worked off; what others hold by now stays theirs.
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

LOOK_S = 0.5
"""Between two looks at what this process has; one takes 0.2 ms."""

MOST_BYTES = 1 << 20
"""A note is smaller."""

_NAME = re.compile(r"bow_([0-9]+)_([0-9]+)_([0-9]+)_([0-9]+)")


def _name(pid: int) -> str:
    return f"bow_{os.getuid()}_{_namespace()}_{pid}_{start_of(pid)}"


def _namespace() -> int:
    """Return the namespace of process numbers that this process lives in: containers may share memory alone."""
    return Path("/proc/self/ns/pid").stat().st_ino


class Note:
    """The note of this process; where it cannot be written, there is none.

    Parameters
    ----------
    place
        Directory of the notes.
    """

    def __init__(self, place: Path = SHARED_MEMORY) -> None:
        work_off(place)
        self._files: set[str] = set()
        self._next_look = 0.0
        self._path: Path | None = None
        if not os.environ.get(SUPERVISED):
            with contextlib.suppress(OSError):
                self._path = place / _name(os.getpid())

    def update(self) -> None:
        """Add what is new; call it often."""
        now = time.monotonic()
        if self._path is None or now < self._next_look:
            return
        self._next_look = now + LOOK_S
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
        """Remove it: the process has let go of all that it names."""
        if self._path is not None:
            self._path.unlink(missing_ok=True)


def work_off(place: Path = SHARED_MEMORY) -> None:
    """Remove what processes of this user have left that noted it and are gone."""
    with contextlib.suppress(OSError):
        mine = (str(os.getuid()), str(_namespace()))
        for path in place.iterdir():
            found = _NAME.fullmatch(path.name)
            if found and found.groups()[:2] == mine and start_of(int(found[3])) != int(found[4]):
                _work_off(path)


def _work_off(path: Path) -> None:
    """Remove what a note lists; the note itself once nothing of it is left but ports, which the next process takes."""
    with contextlib.suppress(OSError):
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        with os.fdopen(descriptor, errors="replace") as file:
            about = os.fstat(descriptor)
            if not stat.S_ISREG(about.st_mode) or about.st_uid != os.getuid() or about.st_size > MOST_BYTES:
                return
            files = shm_files.named(file.read())
        if all(shm_files.is_port(left) for left in shm_files.remove(files)):
            path.unlink()
