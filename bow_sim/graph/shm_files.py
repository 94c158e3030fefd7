"""Shared-memory files that a killed process leaves in /dev/shm: up to 40 MB for each, until the next boot.

Fast DDS keeps its messages in a segment ``fastrtps_<16 digits>`` and receives notifications at
``fastrtps_port<number>``. A living process holds a lock on the file ``..._el`` beside each of them, so these are
removed if no process holds the lock. Data-sharing files ``fast_datasharing_<GUID>`` have no lock, but the GUID encodes
the lowest two bytes of the owner's process number: they are removed if no process with such a number has mapped them.

Only files that a process of ours has used are removed. The shared-memory cleaner records them
(:mod:`bow_sweep.processes.shm_cleaner`), or a note does (:mod:`bow_sim.graph.shm_notes`).
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import stat
import time
from collections.abc import Container, Iterable
from pathlib import Path

from bow_sim.graph.discovery import SHARED_MEMORY

_LOCK = re.compile(rf"{SHARED_MEMORY}/fastrtps_(?:[0-9a-f]{{16}}|(port[0-9]+))_el")
_LENT = re.compile(
    rf"{SHARED_MEMORY}/fast_datasharing_(?:[0-9a-f]{{2}}\.){{4}}([0-9a-f]{{2}})\.([0-9a-f]{{2}})\.[0-9a-f._]+"
)

_PORT = re.compile("fastrtps_port[0-9]+")

MADE_S = 1.0
"""A process has given the file of a port its size by then; otherwise it was killed before."""

_CORRUPTED = (3).to_bytes(4, "little")
"""At the beginning of a port, Boost's word for one that is of no use."""

OWNERS = 1 << 16
"""A GUID encodes the process number modulo this."""


def files_of(pid: int, known: Container[str] = ()) -> set[str]:
    """Return the shared-memory files that a living process owns, without those in `known`.

    These are the locks of its segments and ports, and its data-sharing files. The function is called often; with Path
    objects it would take ten times as long.
    """
    locks, lent = set(), set()
    with contextlib.suppress(OSError):
        for descriptor in os.listdir(f"/proc/{pid}/fd"):
            with contextlib.suppress(OSError):
                target = os.readlink(f"/proc/{pid}/fd/{descriptor}")
                if _LOCK.fullmatch(target) and target not in known:
                    locks.add(target)
        lent = {f"{SHARED_MEMORY}/{name}" for name in os.listdir(SHARED_MEMORY)}
        lent = {file for file in lent if owner(file) == pid % OWNERS and file not in known}
    return locks | (_mapped(pid, lent) if lent else lent)


def holders() -> dict[tuple[int, int, int], set[int]] | None:
    """Return which processes hold a lock on a file, by major and minor number of its device and its inode.

    One look for all processes and files; None where the kernel does not tell.
    """
    try:
        lines = Path("/proc/locks").read_text().splitlines()
    except OSError:
        return None
    found: dict[tuple[int, int, int], set[int]] = {}
    for _, kind, _, _, pid, place, *_ in map(str.split, lines):
        if kind == "FLOCK":  # not "->", who waits for one
            major, minor, inode = place.split(":")
            found.setdefault((int(major, 16), int(minor, 16), int(inode)), set()).add(int(pid))
    return found


def place_of(file: str) -> tuple[int, int, int] | None:
    """Return device and inode of a file, as :func:`holders` has them; None where it is gone."""
    try:
        found = os.stat(file)
    except OSError:
        return None
    return os.major(found.st_dev), os.minor(found.st_dev), found.st_ino


def is_lock(file: str) -> bool:
    """Return whether a file is the lock of a segment or port."""
    return _LOCK.fullmatch(file) is not None


def is_port(file: str) -> bool:
    """Return whether a file is the lock of a port; a new process may use the port of a dead one."""
    lock = _LOCK.fullmatch(file)
    return lock is not None and lock[1] is not None


def owner(file: str) -> int | None:
    """Return the lowest two bytes of the owner's process number; None if the file is not a data-sharing file."""
    lent = _LENT.fullmatch(file)
    return int(lent[2] + lent[1], 16) if lent else None


def _mapped(pid: int, files: Iterable[str]) -> set[str]:
    """Return which of some files a process has mapped into its memory."""
    try:
        memory = Path(f"/proc/{pid}/maps").read_text(errors="replace")
    except OSError:
        return set()
    return {file for file in files if f"{file}\n" in memory}


def note(path: Path, files: Iterable[str]) -> None:
    """Add files to a note; errors of writing are ignored."""
    with contextlib.suppress(OSError), open(path, "a", encoding="utf-8") as out:
        out.writelines(f"{file}\n" for file in sorted(files))


def noted(path: Path) -> set[str]:
    """Return the files that a note lists, without those that are not files of Fast DDS."""
    try:
        return named(path.read_text(encoding="utf-8", errors="replace"))
    except OSError:
        return set()


def named(text: str) -> set[str]:
    """Return the files that the text of a note lists, without those that are not files of Fast DDS."""
    return {line for line in text.splitlines() if _LOCK.fullmatch(line) or _LENT.fullmatch(line)}


def remove(files: Iterable[str], *, ports: bool = False) -> set[str]:
    """Remove files that no process uses: segments with their locks, and data-sharing files; return those that are left.

    Ports are removed only if `ports` is set, when no other process of ours can start and use them again.
    """
    return {file for file in files if not _is_removed(file, ports)}


def free_unfinished(place: Path = SHARED_MEMORY) -> None:
    """Remove the files of ports that a process was killed in making: they have no size, for which all others wait.

    Fast DDS waits for ever. Who waits already reads that the port is of no use, and takes another one.
    """
    with contextlib.suppress(OSError):
        for port in place.glob("fastrtps_port*"):
            if _PORT.fullmatch(port.name):
                _free_unfinished(port)


def _free_unfinished(port: Path) -> None:
    with contextlib.suppress(OSError):
        descriptor = os.open(port, os.O_WRONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        try:
            about = os.fstat(descriptor)
            old = time.time() - about.st_mtime > MADE_S
            if old and about.st_size == 0 and about.st_uid == os.getuid() and stat.S_ISREG(about.st_mode):
                os.write(descriptor, _CORRUPTED)
                os.unlink(port)
        finally:
            os.close(descriptor)


def _is_removed(file: str, ports: bool) -> bool:
    """Remove a file if no process uses it; return whether it is gone."""
    lock, pid = _LOCK.fullmatch(file), owner(file)
    try:
        if lock is not None and lock[1]:
            if not ports:
                return False
            _remove_unlocked(file, f"{SHARED_MEMORY}/sem.fastrtps_{lock[1]}_mutex", flags=os.O_CREAT)
        elif lock is not None:
            _remove_unlocked(file)
        elif pid is not None:
            if os.path.exists(file) and any(_mapped(living, [file]) for living in range(pid, _last_pid() + 1, OWNERS)):
                return False
            os.unlink(file)
    except FileNotFoundError:
        return True
    except OSError:  # locked by a living process
        return False
    return True


def _remove_unlocked(lock: str, *others: str, flags: int = 0) -> None:
    """Remove a segment or port, its lock and other files; raise OSError if the lock is held.

    A process that sends to a removed port creates it again, without a lock file.
    """
    descriptor = os.open(lock, os.O_RDONLY | flags, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        for file in (lock.removesuffix("_el"), *others, lock):
            with contextlib.suppress(FileNotFoundError):
                os.unlink(file)
    finally:
        os.close(descriptor)


def _last_pid() -> int:
    return int(Path("/proc/sys/kernel/pid_max").read_text())
