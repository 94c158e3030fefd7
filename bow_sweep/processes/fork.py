"""Children: copies of this process, which need not load again what it has, and commands."""

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
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

LOOK_S = 0.01
"""Between two looks at whether a child has ended."""

ERROR = 1

UNKNOWN = 1000
"""In place of an exit status that somebody else took."""


class Process:
    """A child of this process, as :class:`subprocess.Popen`; but it may be that somebody else takes its exit status.

    A library that waits for any child does that, or a parent that had us ignore SIGCHLD.

    Parameters
    ----------
    pid
        Its number.
    """

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Return the exit status, negative for a signal; None while it lives; UNKNOWN where somebody else took it."""
        if self.returncode is None:
            try:
                pid, status = os.waitpid(self.pid, os.WNOHANG)
            except ChildProcessError:  # no longer a child: it has ended
                self.returncode = UNKNOWN
            else:
                self.returncode = os.waitstatus_to_exitcode(status) if pid else None
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
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def kill(self) -> None:
        """Kill it."""
        self.send_signal(signal.SIGKILL)


class Started(Process):
    """A command in a process of its own, without input.

    Parameters
    ----------
    command
        Program and arguments.
    output
        File that gets what it prints.
    environment
        All its variables.
    first
        What it does before it becomes the command.
    """

    def __init__(
        self, command: Sequence[str], output: Path, environment: Mapping[str, str], first: Callable[[], None]
    ) -> None:
        with open(output, "ab") as log:
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=environment,
                preexec_fn=first,  # noqa: PLW1509  # no threads of ours hold locks that a child needs
            )
        super().__init__(process.pid)
        process.returncode = UNKNOWN  # it is ours to wait for: Popen takes one that others waited for as a success


class Forked(Process):
    """Runs a function in a copy of this process.

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
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError, AttributeError):  # full, closed, or none: only words are lost
                stream.flush()
        gc.freeze()  # no collection in the child writes to the pages that it shares
        pid = os.fork()
        if pid == 0:
            _child(run, output, keep)
        gc.unfreeze()
        super().__init__(pid)


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
        with contextlib.suppress(BaseException):  # whatever comes, nothing of the parent's runs here
            sys.stdout.flush()
        os._exit(status)
