"""Leaving DDS: the last thing that a process does, within bounds, and with the exit status of its work.

Fast DDS sometimes waits for ever when its entities are destroyed: where many nodes end at once, or where a process was
killed while it held a shared-memory lock. It does so in native code, and holds Python's interpreter lock: no Python
code can end the process then, and a signal would hide its exit status. Two timers of the C library can: the first
prints a line, the second calls ``_exit``.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from functools import cache

from bow_sim.graph.shm_files import files_of

LEAVE_S = 10.0
"""Seconds that DDS has to destroy its entities."""

TO_READ_S = 2.0
"""From the line to the end: the two timers have threads of their own, and one may start late on a busy machine."""

HANGS = "DDS does not shut down: this process ends without that"
"""Printed then."""

UNFINISHED = 1
"""Exit status of a command that did not return."""

_SIGEV_THREAD = 2


class _Event(ctypes.Structure):
    """C's ``struct sigevent``: when the timer expires, call `function` with `value` in a new thread."""

    _fields_ = (
        ("value", ctypes.c_void_p),
        ("signal", ctypes.c_int),
        ("notify", ctypes.c_int),
        ("function", ctypes.c_void_p),
        ("attributes", ctypes.c_void_p),
        ("padding", ctypes.c_char * 32),
    )


_Times = ctypes.c_long * 4
"""C's ``struct itimerspec``: interval and first expiry, each in s and ns."""

_timers: list[ctypes.c_void_p] = []


@cache
def _libc() -> ctypes.CDLL:
    libc = ctypes.CDLL(None, use_errno=True)
    ctypes.c_char_p.in_dll(libc, "program_invocation_short_name").value = b"bow"  # begins the line of warnx
    return libc


@cache
def _format(text: str) -> ctypes.Array[ctypes.c_char]:
    """Return a format of C's printf; the cache keeps its memory."""
    return ctypes.create_string_buffer(text.replace("%", "%%").encode())


def _call_after(seconds: float, function: object, value: int | None) -> None:
    """Have a function of the C library called with one value, a number or a pointer, whoever holds Python's lock."""
    event = _Event(value, 0, _SIGEV_THREAD, ctypes.cast(function, ctypes.c_void_p).value)  # type: ignore[arg-type]
    timer = ctypes.c_void_p()
    if _libc().timer_create(time.CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)):
        return  # the system has no timer left: the process ends when DDS lets it
    _timers.append(timer)
    _libc().timer_settime(timer, 0, ctypes.byref(_Times(0, 0, int(seconds), int(seconds % 1 * 1e9))), None)


def exit_after(seconds: float, status: int, line: str = HANGS) -> None:
    """End this process after so many seconds, whatever it waits for, with an exit status and a line on stderr.

    Replaces an earlier call; :func:`cancel_exit` takes it back. Does nothing outside the main thread: such a process
    runs more than the command or the node.
    """
    cancel_exit()
    if threading.current_thread() is not threading.main_thread():
        return
    _call_after(seconds, _libc().warnx, ctypes.addressof(_format(line)))
    _call_after(seconds + TO_READ_S, _libc()._exit, status)


def cancel_exit() -> None:
    """Take back :func:`exit_after`."""
    while _timers:
        _libc().timer_delete(_timers.pop())


def destroy_entities() -> None:
    """Destroy the DDS entities of nodes that are destroyed: call it when nothing refers to node and executor.

    A process that ends without it may exit holding a shared-memory lock and block other processes. A collection takes
    some hundredths of a second where libraries were loaded; most nodes have destroyed everything themselves.
    """
    if files_of(os.getpid()):
        gc.collect()


_commands: list[list[Callable[[], object]]] = []
"""For each command in progress, one within the other, what it closes at its end."""


def at_end(close: Callable[[], object]) -> None:
    """Have something closed when the work of this command is done, in the order of these calls.

    Where no command is in progress, as in a program that uses the library, it is closed at once.
    """
    if _commands:
        _commands[-1].append(close)
    else:
        close()


def close_all(status: int, hint: str = "") -> None:
    """Close what this command has left to :func:`at_end`; end the process if that takes more than `LEAVE_S`.

    Parameters
    ----------
    status
        Exit status of the process then.
    hint
        Told to the user then.
    """
    closers = _commands[-1] if _commands else []
    if not closers:
        return
    exit_after(LEAVE_S, status, f"{HANGS}; {hint}" if hint else HANGS)
    try:
        with _ignored(signal.SIGINT, signal.SIGTERM), contextlib.ExitStack() as stack:  # the work is done
            while closers:
                stack.callback(closers.pop())  # the first is called first; the others also where one raises
    finally:
        cancel_exit()


def run_command(work: Callable[[], int]) -> int:
    """Return the exit status of the work of a command, when all is closed that it has left to :func:`at_end`."""
    _commands.append([])
    status = UNFINISHED
    try:
        status = work()
        return status
    finally:
        try:
            close_all(status)
        finally:
            _commands.pop()


@contextlib.contextmanager
def _ignored(*signals: signal.Signals) -> Iterator[None]:
    in_main = threading.current_thread() is threading.main_thread()
    before = {number: signal.signal(number, signal.SIG_IGN) for number in signals if in_main}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
