"""Shared memory that a killed process of ours leaves behind: 9 MB in /dev/shm each, until the next boot.

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
