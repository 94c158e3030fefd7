"""The end of a child process with its parent."""

from __future__ import annotations

import ctypes
import signal

_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_LIBC = ctypes.CDLL(None)  # here, because a child that was just forked should load nothing


def end_with_parent() -> None:
    """Have this process, a child, receive SIGTERM when its parent ends, however that does; calls the C library only."""
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
