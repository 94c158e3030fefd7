"""rerun as a process of its own: the window of a viewer, or a server for windows that are opened elsewhere.

Both listen on the loopback for what dashboards send, keep it, and pass it on to every `rerun --connect`: so a viewer
that comes late gets everything, and a dashboard may end, or be started again, while the picture stays.
"""

from __future__ import annotations

import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from bow_sim.graph.parent import end_with_parent
from bow_sim.graph.process_stat import read_stat
from bow_sweep.view.wanted import LOOPBACK, free_port

MEMORY = "256MiB"
"""What a process keeps for viewers that connect late, unless told otherwise."""

PROGRAM = "RERUN_CLI_PATH"
"""Environment variable of rerun: a program to run in place of its own."""

DELIVERED_S, LOOK_S = 1.0, 0.1
"""Viewers have everything when nothing was sent to them for so long; how often this is looked at."""

IDLE_S = 0.015
"""CPU time between two looks of a server that passes nothing on: one clock tick of 0.01 s, and no more."""

LINGER_S = 20.0
"""Connected viewers have this time at most to receive what was drawn last."""

ESTABLISHED = "01"
"""State of a TCP socket with a peer in /proc/net/tcp."""


class RerunProcess:
    """A process of rerun that shows, or passes on, what is sent to it. Ctrl-C in the terminal does not reach it.

    Parameters
    ----------
    options
        Words for rerun's command.
    port
        Of 127.0.0.1; 0 = a free one.
    memory
        What it keeps for viewers that connect late, such as "256MiB".
    program
        Command that stands for rerun; rerun's own if empty.

    Attributes
    ----------
    port, uri
        Where it listens: recordings are sent to this address, and viewers connect to it.

    Raises
    ------
    OSError
        Where there is no such program, or it cannot be started.
    """

    def __init__(self, *options: str, port: int = 0, memory: str = MEMORY, program: Sequence[str] = ()) -> None:
        command = program or _program()
        self.port = port or free_port()
        self.uri = uri_of(self.port)
        self._output = tempfile.TemporaryFile()  # noqa: SIM115  # until the process has ended
        listen = ["--bind", LOOPBACK, "--port", str(self.port), "--server-memory-limit", memory]
        self._process = subprocess.Popen(
            [*command, *options, *listen],  # its default is to listen on all addresses
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            env={**os.environ, "RERUN_APP_ONLY": "true"},  # no questions about usage statistics
            preexec_fn=self._prepare,  # noqa: PLW1509  # it calls the C library only
        )

    def _prepare(self) -> None:
        """Set up the process before its program starts."""

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    def ended(self) -> str | None:
        """Return None while it runs. When it has ended, return once the reason of a failure, or "" if it was closed."""
        status = self._process.poll()
        if status is None:
            return None
        lines: list[str] = []
        if not self._output.closed:
            with self._output as output:
                output.seek(0)
                lines = output.read().decode(errors="replace").splitlines()
        last = next((line.strip() for line in map(_bare, reversed(lines)) if line.strip()), "")
        if not status and not last.startswith("Error"):  # without a display it prints an error and exits with 0
            return ""
        return f"{self.what} ended (exit status {status})" + (f": {last}" if last else "")

    what = "rerun"
    """The process in messages for people."""


class Viewer(RerunProcess):
    """The window of a viewer. It goes on when this process ends.

    Parameters
    ----------
    opens
        Recordings that it opens at once: files or addresses.
    port, memory, program
        As for :class:`RerunProcess`.
    """

    what = "the viewer"

    def __init__(self, *opens: str | Path, port: int = 0, memory: str = MEMORY, program: Sequence[str] = ()) -> None:
        super().__init__(*map(str, opens), "--hide-welcome-screen", port=port, memory=memory, program=program)


class Server(RerunProcess):
    """A server for viewers, without a window. It ends with the process that started it."""

    what = "the server for viewers"

    def __init__(self, port: int, memory: str = MEMORY, program: Sequence[str] = ()) -> None:
        super().__init__("--serve-grpc", port=port, memory=memory, program=program)

    def _prepare(self) -> None:
        end_with_parent()

    def linger(self, seconds: float, going_on: Callable[[], bool] = lambda: True) -> None:
        """Return when all connected viewers have everything, after `seconds`, or when `going_on` returns False."""
        deadline = time.monotonic() + seconds
        used, quiet = self._cpu_s(), 0.0
        while time.monotonic() < deadline and quiet < DELIVERED_S and self._process.poll() is None and going_on():
            queues = connections(self.port)
            if not queues:
                return
            time.sleep(LOOK_S)
            now = self._cpu_s()
            quiet = 0.0 if any(queues) or now - used > IDLE_S else quiet + LOOK_S
            used = now

    def _cpu_s(self) -> float:
        """Return the CPU time of the process: it passes data on as long as it uses any."""
        stat = read_stat(self.pid)
        return 0.0 if stat is None else stat.cpu_s

    def stop(self) -> None:
        """End it."""
        with contextlib.suppress(OSError):
            os.killpg(self.pid, signal.SIGTERM)
        try:
            self._process.wait(2.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._output.close()


@dataclass
class Screen:
    """Where a dashboard is seen live.

    Attributes
    ----------
    process
        The viewer, or the server for viewers; None where there is neither.
    notes
        Lines for people.
    """

    process: RerunProcess | None = None
    notes: list[str] = field(default_factory=list)

    @classmethod
    def open(cls, window: bool, port: int, memory: str = MEMORY) -> Screen:
        """Open a viewer, or serve viewers on a port; neither if `window` is false and `port` is 0."""
        if not window and not port:
            return cls()
        try:
            process = Viewer(port=port, memory=memory) if window else Server(port, memory)
        except OSError as error:
            return cls(notes=[f"the map is not shown live: {error}"])
        if window and not port:
            return cls(process)
        return cls(process, [f"watch the map grow with: rerun --connect {process.uri}"])

    @property
    def uri(self) -> str:
        """Address that recordings are sent to; "" for none."""
        return self.process.uri if self.process else ""

    def problem(self) -> str:
        """Return once why the process has failed, as text for people."""
        if self.process is None or (what := self.process.ended()) is None:
            return ""
        self.process = None
        return what

    def close(self, say: Callable[[str], object], going_on: Callable[[], bool] = lambda: True) -> None:
        """Stop a server when its viewers have everything, or by Ctrl-C; the window of a viewer stays."""
        if not isinstance(self.process, Server):
            return
        server, self.process = self.process, None
        with contextlib.suppress(KeyboardInterrupt):
            if connections(server.port):
                say(f"still serving viewers for up to {LINGER_S:g} s; Ctrl-C ends it")
                server.linger(LINGER_S, going_on)
        server.stop()


def _bare(line: str) -> str:
    """Return a line without the codes of colours, and without time, level and module that rerun's log begins with."""
    line = re.sub(r"\x1b\[[0-9;]*m", "", line)
    return re.sub(r"^\S+Z +[A-Z]+ \S+: ", "", line)


def uri_of(port: int) -> str:
    """Return the address of what listens on a port of this machine."""
    return f"rerun+http://{LOOPBACK}:{port}/proxy"


def port_of(uri: str) -> int:
    """Return the port of such an address, 0 for another one."""
    head, _, tail = uri.partition(f"rerun+http://{LOOPBACK}:")
    number = tail.removesuffix("/proxy")
    return int(number) if not head and number.isdecimal() else 0


def connections(port: int) -> list[int]:
    """Return the bytes that are still under way on each connection to a port of 127.0.0.1."""
    local = f"0100007F:{port:04X}"
    found = []
    for line in Path("/proc/net/tcp").read_text().splitlines()[1:]:
        words = line.split()
        if words[1] == local and words[3] == ESTABLISHED:
            found.append(int(words[4].partition(":")[0], 16))
    return found


def answers(uri: str, seconds: float) -> bool:
    """Return whether something listens at an address, at the latest after `seconds`."""
    deadline = time.monotonic() + seconds
    while True:
        try:
            socket.create_connection((LOOPBACK, port_of(uri)), 1.0).close()
        except OSError:
            if time.monotonic() >= deadline:
                return False
            time.sleep(0.02)
        else:
            return True


def _program() -> list[str]:
    """Return the command of rerun: the path of its program, which imports nothing from the working directory."""
    import importlib.util

    if stand_in := os.environ.get(PROGRAM):
        return [stand_in]
    found = importlib.util.find_spec("rerun_cli")
    if found is None or not found.submodule_search_locations:
        raise FileNotFoundError("the package rerun_cli, a part of rerun-sdk, is not installed")
    folder = Path(found.submodule_search_locations[0])
    return [str(folder / "rerun")] if (folder / "rerun").exists() else [sys.executable, str(folder / "__main__.py")]
