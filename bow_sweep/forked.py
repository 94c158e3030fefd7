"""A child that starts as a copy of this process: what is imported and compiled here, it need not load again."""

from __future__ import annotations

import contextlib
import gc
import math
import os
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path

LOOK_S = 0.01
"""Between two looks at whether a child has ended."""

ERROR = 1


class Forked:
    """Runs a function in a copy of this process; for the rest as :class:`subprocess.Popen`.

    Begin with it before this process has threads of its own or DDS: a copy has only the thread that made it.

    Parameters
    ----------
    run
        What the child does; its result is the exit status.
    output
        File that gets what the child prints.
    keep
        An open file that the child has too, of all that this process has open.
    """

    def __init__(self, run: Callable[[], int], output: Path, keep: int = 0) -> None:
        self.returncode: int | None = None
        sys.stdout.flush()
        sys.stderr.flush()
        gc.freeze()  # no collection in the child writes to the pages that it shares
        self.pid = os.fork()
        if self.pid == 0:
            _child(run, output, keep)
        gc.unfreeze()

    def poll(self) -> int | None:
        """Return the exit status, negative for a signal; None while it lives."""
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end.

        Raises
        ------
        subprocess.TimeoutExpired
            Where it lives longer than `timeout`, seconds; None waits for ever.
        """
        deadline = time.monotonic() + (math.inf if timeout is None else timeout)
        while (status := self.poll()) is None:
            if timeout is not None and time.monotonic() > deadline:
                raise subprocess.TimeoutExpired(f"process {self.pid}", timeout)
            time.sleep(LOOK_S)
        return status

    def send_signal(self, number: int) -> None:
        """Send a signal, if it lives."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """Kill it."""
        self.send_signal(signal.SIGKILL)


def _child(run: Callable[[], int], output: Path, keep: int) -> None:
    """Live as the child and end there: nothing of the parent's stack is unwound."""
    status = ERROR
    gc.disable()  # a node turns it on again once it has loaded what it needs
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        for descriptor in [int(path.name) for path in Path("/proc/self/fd").iterdir()]:
            if descriptor > 2 and descriptor != keep:
                with contextlib.suppress(OSError):  # the one that listed them is closed already
                    os.close(descriptor)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(os.open(output, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644), 1)
        os.dup2(1, 2)
        sys.stdout = sys.stderr = os.fdopen(1, "w", buffering=1)
        status = run()
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else ERROR
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        os._exit(status)
