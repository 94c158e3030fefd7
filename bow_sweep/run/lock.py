"""Who is at work on a run directory: a lock for each role, which goes with its holder, however that ends."""

from __future__ import annotations

import errno
import fcntl
import os
from pathlib import Path

NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOTSUP, errno.EINVAL)
"""What file systems say that have no locks."""


class HeldError(Exception):
    """Another process has the lock."""


def take(directory: Path, role: str) -> int:
    """Take the lock of a role on a run directory; return its descriptor: closed, or its process ended, it is free.

    The file of the lock stays; that it is there says nothing.

    Raises
    ------
    HeldError
        Where another process holds it.
    OSError
        Where there can be none; says what to do on a file system without locks.
    """
    path = directory / f".{role}.lock"
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise HeldError(f"{directory}: another {role} is at work on this run ({path.name} is locked)") from None
    except OSError as error:
        os.close(descriptor)
        if error.errno not in NO_LOCKS:
            raise
        what = (
            f"its file system has no locks ({error.strerror}), so nothing tells whether another {role} is at work on "
            "it; where you know that none is: --no-lock, or -p lock:=false for a node"
        )
        raise OSError(error.errno, what, str(path)) from None
    return descriptor
