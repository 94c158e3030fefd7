"""The rerun viewer as a process of its own."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from bow_sweep.view.wanted import LOOPBACK, free_port


class Viewer:
    """A viewer connected to a served recording. It goes on when this process ends, and Ctrl-C does not reach it.

    Parameters
    ----------
    what
        Address of the recording, or its file.
    program
        Command that opens a viewer; rerun's own if empty.

    Raises
    ------
    OSError
        Where there is no such program, or it cannot be started.
    """

    def __init__(self, what: str, program: Sequence[str] = ()) -> None:
        command = program or _program()
        self._output = tempfile.TemporaryFile()  # noqa: SIM115  # until the viewer has ended
        options = [
            *(["--connect", what] if "://" in what else [what]),
            "--bind",
            LOOPBACK,
            "--port",
            str(free_port()),
        ]  # default: all addresses
        self._process = subprocess.Popen(
            [*command, *options],
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )

    def ended(self) -> str | None:
        """Return None while it runs. When it has ended, return once the reason of a failure, or "" if it was closed."""
        status = self._process.poll()
        if status is None:
            return None
        with self._output as output:
            output.seek(0)
            lines = output.read().decode(errors="replace").splitlines()
        last = next((line.strip() for line in reversed(lines) if line.strip()), "")
        if not status and not last.startswith("Error"):  # without a display it prints an error and exits with 0
            return ""
        return f"the viewer ended (exit status {status})" + (f": {last}" if last else "")


def _program() -> list[str]:
    """Return the command of rerun: the path of a script, because `-m` would also import from the working directory."""
    found = importlib.util.find_spec("rerun_cli")
    if found is None or not found.submodule_search_locations:
        raise FileNotFoundError("the package rerun_cli, a part of rerun-sdk, is not installed")
    return [sys.executable, str(Path(found.submodule_search_locations[0]) / "__main__.py")]
