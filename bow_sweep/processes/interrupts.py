"""Ctrl-C and SIGTERM: noted when they arrive, raised where the program checks for them."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Iterator
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupts:
    """Context in which SIGINT and SIGTERM are noted; :meth:`check` raises KeyboardInterrupt where one has come.

    An exception raised by a signal handler comes up at any place. In native code that calls Python, as rclpy's
    executor, it may be lost or turned into another exception; so handlers here only take a note.

    Python allows signal handlers in the main thread only. In other threads nothing is noted: signals are the business
    of the thread's caller.

    Parameters
    ----------
    again
        Text to print to stderr when another signal comes before the process has ended.

    Raises
    ------
    KeyboardInterrupt
        On leaving the context, where a signal came that nobody has checked for. The handlers are restored then.
    """

    def __init__(self, again: str) -> None:
        self._again = f"\n{again}\n".encode()
        self._came = False
        self._raises = False

    def __enter__(self) -> Interrupts:
        in_main = threading.current_thread() is threading.main_thread()
        self._before = {number: signal.signal(number, self._note) for number in SIGNALS if in_main}
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        if error is None:
            self.check()

    def _note(self, _number: int, _frame: FrameType | None) -> None:
        if self._came:
            os.write(2, self._again)  # not print: the signal may have interrupted one
        self._came = True
        if self._raises:
            self._raises = False
            raise KeyboardInterrupt

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal has come."""
        if self._came:
            raise KeyboardInterrupt

    @contextlib.contextmanager
    def immediate(self) -> Iterator[None]:
        """Raise KeyboardInterrupt at once in this context: for code that takes long and starts no processes."""
        self._raises = True
        try:
            self.check()
            yield
        finally:
            self._raises = False
