"""Runs for the page, and `bow explore` as a process."""

from __future__ import annotations

import contextlib
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import recording

SETTINGS = ("x.count=8", "y.count=6", "block_cells=20", "periods=30", "x.first=2", "y.first=0.5")
"""48 cells, a third of them in Helmholtz motion by the end."""


def make_run(directory: Path, *settings: str) -> Path:
    """Make a whole run with bag and map."""
    sweep = recording.small_sweep(*SETTINGS, *settings)
    return recording.leave_all(recording.record(directory, sweep, commit_every=20), sweep)


class Serving:
    """A `bow explore` that serves.

    Attributes
    ----------
    address
        URL that it printed.
    """

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process
        self.lines: list[str] = []
        assert process.stdout is not None
        line = process.stdout.readline()
        found = re.search(r"http://127\.0\.0\.1:(\d+)/", line)
        assert found, f"printed {line!r}; status {process.poll()}"
        self.address, self.port = found[0], int(found[1])

    def interrupt(self) -> int:
        """Press Ctrl-C; return the exit status."""
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(60)


def command(*words: str | Path) -> list[str]:
    """Return the command `bow explore`."""
    return [sys.executable, "-m", "bow_sweep", "explore", *map(str, words)]


@contextlib.contextmanager
def served(*words: str | Path) -> Iterator[Serving]:
    """Serve runs; the process ends with the block."""
    process = subprocess.Popen(command(*words, "--no-browser"), stdout=subprocess.PIPE, text=True)
    late = threading.Timer(120, process.kill)  # a start that hangs ends as a failed test
    late.start()
    try:
        serving = Serving(process)
        late.cancel()
        yield serving
    finally:
        late.cancel()
        if process.poll() is None:
            process.terminate()
            process.wait(60)
        assert process.stdout is not None
        process.stdout.close()
