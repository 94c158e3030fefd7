"""Shared memory that a killed process of ours leaves behind: 9 MB in /dev/shm each, until the next boot.

Where the supervisor is killed too, a note beside its logs says what there was, and the next one of that run sees to it.

Fast DDS keeps its messages in a segment ``fastrtps_<16 digits>`` and, as long as it lives, holds a lock on the file
``fastrtps_<16 digits>_el`` beside it. A segment is removed only if a child of ours had its lock file open while it
lived, and nobody holds the lock any more.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
from collections.abc import Iterable
from pathlib import Path

SHARED_MEMORY = Path("/dev/shm")
_LOCK = re.compile(re.escape(str(SHARED_MEMORY)) + r"/fastrtps_[0-9a-f]{16}_el")


def locks_of(pid: int) -> set[Path]:
    """Return the lock files of the segments that a living process has open; none where it is gone."""
    found = set()
    with contextlib.suppress(OSError):
        for descriptor in Path(f"/proc/{pid}/fd").iterdir():
            with contextlib.suppress(OSError):
                target = descriptor.readlink()
                if _LOCK.fullmatch(str(target)):
                    found.add(target)
    return found


def note(path: Path, locks: Iterable[Path]) -> None:
    """Add lock files to a note; where the disk does not take it, there is none."""
    with contextlib.suppress(OSError), open(path, "a", encoding="utf-8") as file:
        file.writelines(f"{lock}\n" for lock in sorted(locks))


def noted(path: Path) -> set[Path]:
    """Return the lock files that a note names; what is none is left out."""
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return set()
    return {Path(line) for line in lines if _LOCK.fullmatch(line)}


def remove(locks: Iterable[Path]) -> int:
    """Remove those segments whose lock nobody holds; return how many."""
    removed = 0
    for lock in locks:
        with contextlib.suppress(OSError):  # gone already, or still locked
            descriptor = os.open(lock, os.O_RDWR)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                lock.with_name(lock.name.removesuffix("_el")).unlink(missing_ok=True)
                lock.unlink()
                removed += 1
            finally:
                os.close(descriptor)
    return removed
