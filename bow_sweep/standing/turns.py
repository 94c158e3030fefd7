"""Whose turn it is among the clients of a standing graph: they come first, they are served first. No ROS.

Each client has a ticket, a file in the folder of the graph. Its name begins with the time, so that the first name is
the client whose turn it is. A ticket of a process that has ended is removed by the others.
"""

from __future__ import annotations

import contextlib
import os
import re
import time
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

from bow_sim.graph.process_stat import start_of

_TICKET = re.compile(r"([0-9]{20})-([0-9]+)-([0-9]+)-([0-9]+)")


class Ticket(NamedTuple):
    """A ticket of a client: when it came, its process, and where it wants its run."""

    name: str
    pid: int
    directory: str


def tickets(folder: Path) -> list[Ticket]:
    """Return the tickets of the clients that are there, in their order. Tickets of others are removed."""
    found = []
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        match = _TICKET.fullmatch(path.name)
        if match is None:
            continue
        with contextlib.suppress(OSError):
            if start_of(int(match[2])) != int(match[3]):
                path.unlink()
                continue
            found.append(Ticket(path.name, int(match[2]), path.read_text(errors="replace")))
    return found


class Turn:
    """A ticket, for as long as this context lasts.

    Parameters
    ----------
    folder
        Folder of the tickets.
    directory
        Where the client wants its run, to be shown to others.
    """

    def __init__(self, folder: Path, directory: Path) -> None:
        pid = os.getpid()
        number = sum(1 for _ in folder.glob(f"*-{pid}-*"))  # two clients of one process
        self._path = folder / f"{time.time_ns():020}-{pid}-{start_of(pid)}-{number}"
        self._directory = directory

    def __enter__(self) -> Turn:
        aside = self._path.with_name(f".{self._path.name}")
        aside.write_text(f"{self._directory}")
        os.replace(aside, self._path)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._path.unlink(missing_ok=True)

    def before(self) -> list[Ticket]:
        """Return the tickets of the clients that are served before this one; empty when it is its turn."""
        return [ticket for ticket in tickets(self._path.parent) if ticket.name < self._path.name]
