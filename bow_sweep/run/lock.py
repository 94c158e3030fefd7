"""File locks of a run directory, one for each role. A lock is released when its process exits, however that happens."""

from __future__ import annotations

import errno
import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bow_sweep.run.errors import RunError

NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOTSUP, errno.EINVAL)
"""Error numbers of flock(2) on file systems that have no locks."""


class LockError(RunError):
    """A lock cannot be taken; the message states why, and what to do."""


class LockedError(LockError):
    """Another process holds the lock."""


def name_of(role: str) -> str:
    """Return the name of a role's lock file in a run directory."""
    return f".{role}.lock"


def recorder_of(station: str) -> str:
    """Return the role of a station's recorder: each station has one that records into a bag of its own."""
    return f"recorder-{station}" if station else "recorder"


def take(directory: Path, role: str) -> int:
    """Lock a run directory for a role.

    The file of a lock stays when the lock is released; that it exists has no meaning.

    Parameters
    ----------
    directory
        Run directory; exists.
    role
        ``"supervisor"``, ``"coordinator"``, ``"recorder"``, or as :func:`recorder_of` gives it.

    Returns
    -------
    int
        File descriptor. The lock is released when it is closed, or this process exits.

    Raises
    ------
    LockedError
        Where another process holds the lock.
    LockError
        Where the lock cannot be taken for another reason, as on a file system without locks.
    """
    path = directory / name_of(role)
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise LockError(f"{path}: {error.strerror}") from None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(descriptor)
        if isinstance(error, BlockingIOError):
            raise LockedError(
                f"{directory}: another process is at work on this run as its {role} ({path.name} is locked)"
            ) from None
        if error.errno not in NO_LOCKS:
            raise LockError(f"{path}: {error.strerror}") from None
        raise LockError(
            f"{path}: its file system has no locks ({error.strerror}), so another {role} at work on this run would go "
            "unnoticed; where you know that there is none: --no-lock, or -p lock:=false for a node"
        ) from None
    return descriptor


@contextmanager
def locked(directory: Path, role: str, lock: bool = True) -> Iterator[None]:
    """Hold the lock of a role on a run directory in this context; without `lock` nothing is held.

    Raises
    ------
    LockError
        As :func:`take`.
    """
    descriptor = take(directory, role) if lock else None
    try:
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)
