"""Child processes: copies of this process, which have its modules loaded already, and commands."""

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
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from bow_sweep.processes.exit_status import FAILED

POLL_S = 0.002
"""Interval at which :meth:`Process.wait` checks whether a child has exited."""

STOPS = (signal.SIGINT, signal.SIGTERM)

UNKNOWN = 1000
"""In place of an exit status that another part of this process took."""


class Process:
    """A child process. As :class:`subprocess.Popen`, but its exit status may be taken by others.

    A library that waits for any child takes it; the kernel drops it where our parent had us ignore SIGCHLD.

    Parameters
    ----------
    pid
        Process number.
    """

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Return the exit status, negative for a signal; None while it runs; `UNKNOWN` where others took it."""
        if self.returncode is None:
            try:
                pid, status = os.waitpid(self.pid, os.WNOHANG)
            except ChildProcessError:  # no longer a child: it has exited
                self.returncode = UNKNOWN
            else:
                self.returncode = os.waitstatus_to_exitcode(status) if pid else None
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait until it exits; return the exit status as :meth:`poll` does.

        Raises
        ------
        subprocess.TimeoutExpired
            Where it runs longer than `timeout`, seconds; None waits without a limit.
        """
        deadline = time.monotonic() + (math.inf if timeout is None else timeout)
        while (status := self.poll()) is None:
            if timeout is not None and time.monotonic() > deadline:
                raise subprocess.TimeoutExpired(f"process {self.pid}", timeout)
            time.sleep(POLL_S)
        return status

    def send_signal(self, number: int) -> None:
        """Send a signal, unless it has exited."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def kill(self) -> None:
        """Send SIGKILL, unless it has exited."""
        self.send_signal(signal.SIGKILL)


class Spawned(Process):
    """A command in a process of its own, without input.

    Parameters
    ----------
    command
        Program and arguments.
    output
        File to which its stdout and stderr are appended.
    environment
        All its environment variables.
    prepare
        Called in the child before it becomes the command.
    """

    def __init__(
        self, command: Sequence[str], output: Path, environment: Mapping[str, str], prepare: Callable[[], None]
    ) -> None:
        with open(output, "ab") as log:
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=environment,
                preexec_fn=prepare,  # noqa: PLW1509  # no threads of ours hold locks that a child needs
            )
        super().__init__(process.pid)
        process.returncode = UNKNOWN  # Popen must not wait for it too: it takes a status that others took for success


class Forked(Process):
    """A function that runs in a copy of this process.

    Call before creating threads or DDS entities; fork copies only the calling thread.

    Parameters
    ----------
    run
        Called in the child; its result is the exit status.
    output
        File to which stdout and stderr of the child are appended.
    keep
        The one open file, besides stdin, stdout and stderr, that the child keeps of ours; 0 for none.
    """

    def __init__(self, run: Callable[[], int], output: Path, keep: int = 0) -> None:
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError, AttributeError):  # full, closed, or None: only text is lost
                stream.flush()
        gc.freeze()  # no collection in the child writes to memory pages that it shares with us
        before = signal.pthread_sigmask(signal.SIG_BLOCK, STOPS)  # the child must not take one with a handler of ours
        try:
            pid = os.fork()
            if pid == 0:
                _run_child(run, output, keep, before)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            gc.unfreeze()
        super().__init__(pid)


def _run_child(run: Callable[[], int], output: Path, keep: int, mask: Iterable[int]) -> None:
    """Run the child and exit: it must not return into the stack that it copied from its parent."""
    status = FAILED
    gc.disable()  # a node enables it when it has loaded its modules
    try:
        for number in STOPS:
            signal.signal(number, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        nothing = os.open(os.devnull, os.O_RDONLY)
        # Not closed: the number would be given to another file, which an object of ours, when it goes, would close.
        for descriptor in [int(path.name) for path in Path("/proc/self/fd").iterdir()]:
            if descriptor not in (1, 2, keep, nothing):
                os.dup2(nothing, descriptor, inheritable=descriptor == 0)
        os.dup2(os.open(output, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644), 1)
        os.dup2(1, 2)
        sys.stdout = sys.stderr = os.fdopen(1, "w", buffering=1)
        _forget_formulas()
        status = run()
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else FAILED
    except BaseException:
        traceback.print_exc()
    finally:
        with contextlib.suppress(BaseException):  # even then, os._exit must be reached
            sys.stdout.flush()
        os._exit(status)


def _forget_formulas() -> None:
    """Have Matplotlib set formulas anew: those that it keeps are set in fonts whose files are not open here.

    It forgets the fonts themselves at a fork.
    """
    parser = getattr(sys.modules.get("matplotlib.mathtext"), "MathTextParser", None)
    kept = getattr(parser, "_parse_cached", None)
    if kept is not None:
        kept.cache_clear()
