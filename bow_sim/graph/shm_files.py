"""Shared memory that a killed process of ours leaves behind: up to 40 MB in /dev/shm each, until the next boot.

Fast DDS keeps its messages in a segment ``fastrtps_<16 digits>``, and hears of them at ``fastrtps_port<number>``; as
long as it lives, it holds a lock on the file ``..._el`` beside each: such a file goes when nobody holds the lock any
more. What it lends to readers lies in ``fast_datasharing_<GUID>``, whose owner's process number, or the end of it, is
in the GUID: that goes when no such process has it in its memory any more. Nothing of this is touched that a process of
ours did not have while it lived; which it had, the shared-memory cleaner sees
(:mod:`bow_sweep.processes.shm_cleaner`), or notes say (:mod:`bow_sim.graph.shm_notes`).
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
from collections.abc import Container, Iterable
from pathlib import Path

from bow_sim.graph.discovery import SHARED_MEMORY

_LOCK = re.compile(rf"{SHARED_MEMORY}/fastrtps_(?:[0-9a-f]{{16}}|(port[0-9]+))_el")
_LENT = re.compile(
    rf"{SHARED_MEMORY}/fast_datasharing_(?:[0-9a-f]{{2}}\.){{4}}([0-9a-f]{{2}})\.([0-9a-f]{{2}})\.[0-9a-f._]+"
)

OWNERS = 1 << 16
"""A GUID has the lowest two bytes of a process number."""


def files_of(pid: int, known: Container[str] = ()) -> set[str]:
    """Return what a living process has in shared memory that is its own, but for what is `known`.

    These are the locks of its segments and ports, and what it lends. It is asked often, and Path objects take ten
    times as long.
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


def is_lock(file: str) -> bool:
    """Return whether a file is the lock of a segment or port."""
    return _LOCK.fullmatch(file) is not None


def is_port(file: str) -> bool:
    """Return whether a file is the lock of a port, which any process of that number takes over."""
    lock = _LOCK.fullmatch(file)
    return lock is not None and lock[1] is not None


def owner(file: str) -> int | None:
    """Return the lowest two bytes of the number of the process that lends a file; None where it is no such file."""
    lent = _LENT.fullmatch(file)
    return int(lent[2] + lent[1], 16) if lent else None


def _mapped(pid: int, files: Iterable[str]) -> set[str]:
    """Return which of some files a process has in its memory."""
    try:
        memory = Path(f"/proc/{pid}/maps").read_text(errors="replace")
    except OSError:
        return set()
    return {file for file in files if f"{file}\n" in memory}


def note(path: Path, files: Iterable[str]) -> None:
    """Add files to a note; where the disk does not take it, there is none."""
    with contextlib.suppress(OSError), open(path, "a", encoding="utf-8") as out:
        out.writelines(f"{file}\n" for file in sorted(files))


def noted(path: Path) -> set[str]:
    """Return the files that a note names; what is none of Fast DDS's is left out."""
    try:
        return named(path.read_text(encoding="utf-8", errors="replace"))
    except OSError:
        return set()


def named(text: str) -> set[str]:
    """Return the files that the text of a note names; what is none of Fast DDS's is left out."""
    return {line for line in text.splitlines() if _LOCK.fullmatch(line) or _LENT.fullmatch(line)}


def remove(files: Iterable[str], *, ports: bool = False) -> set[str]:
    """Remove what nobody has any more: segments with their locks, and what was lent; return what is left.

    Ports only where told, when no other process of ours may come that takes over a dead one's.
    """
    return {file for file in files if not _is_removed(file, ports)}


def _is_removed(file: str, ports: bool) -> bool:
    """Remove a file if nobody has it any more; return whether it is gone."""
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
    except OSError:  # still locked
        return False
    return True


def _remove_unlocked(lock: str, *others: str, flags: int = 0) -> None:
    """Remove a segment or port, its lock and other files, or raise OSError where the lock is held.

    Who sends to a port makes it again where it was removed, without a lock.
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
