"""Ctrl-C and SIGTERM, taken note of rather than raised in the middle of whatever runs."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Iterator
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Ending:
    """While it is entered, Ctrl-C and SIGTERM are noted for :meth:`check`, and what ends the block ends in order.

    An exception out of a signal handler comes up anywhere: in native code that calls Python, as an executor of rclpy,
    it may be turned into another one or lost.

    In a thread that is not the main one, nothing is noted: signals are for whoever started it.

    Parameters
    ----------
    again
        What to say where they come again.

    Raises
    ------
    KeyboardInterrupt
        Where one came, and nobody has checked for it, at the end of the block; what was there before is restored.
    """

    def __init__(self, again: str) -> None:
        self._again = f"\n{again}\n".encode()
        self._asked = False
        self._at_once = False

    def __enter__(self) -> Ending:
        here = threading.current_thread() is threading.main_thread()  # Python has no handlers elsewhere
        self._before = {number: signal.signal(number, self._note) for number in SIGNALS if here}
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        if error is None:
            self.check()

    def _note(self, _number: int, _frame: FrameType | None) -> None:
        if self._asked:
            os.write(2, self._again)  # a print may be what was interrupted
        self._asked = True
        if self._at_once:
            self._at_once = False
            raise KeyboardInterrupt

    def check(self) -> None:
        """Raise KeyboardInterrupt where the end was asked for."""
        if self._asked:
            raise KeyboardInterrupt

    @contextlib.contextmanager
    def at_once(self) -> Iterator[None]:
        """Raise where it stands: for what takes long and starts no processes."""
        self._at_once = True
        try:
            self.check()
            yield
        finally:
            self._at_once = False
