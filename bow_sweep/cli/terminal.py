"""Messages of the command `bow` to its user, on stderr: stdout is for results."""

from __future__ import annotations

import contextlib
import shutil
import sys

from bow_sim.graph import environment
from bow_sweep.processes.exit_status import USAGE


def fail(message: str, status: int = USAGE) -> int:
    """Print what is wrong; return the exit status."""
    warn(message)
    return status


def warn(message: str) -> None:
    """Print a message; nothing happens where stderr is closed."""
    with contextlib.suppress(OSError):
        print(f"bow: {message}", file=sys.stderr)


def width() -> int:
    """Return the width of tables, in characters: that of the terminal, 60 to 140."""
    return min(max(shutil.get_terminal_size((120, 24)).columns, 60), 140)


def environment_is_ready() -> bool:
    """Prepare the environment for a graph; print what is wrong with it, or what of it is ignored.

    Returns
    -------
    bool
        Whether a graph can start.
    """
    try:
        ignored = environment.clean()
    except environment.EnvironmentProblem as error:
        fail(str(error))
        return False
    if ignored:
        warn(ignored)
    return True
