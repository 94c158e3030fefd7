"""The folder of a standing graph: its state file, its logs, the notes of its runs. No ROS.

The folder belongs to one user, and nobody else can write it: who can write a note there can name a directory.
"""

from __future__ import annotations

import hashlib
import json
import os
import socket
import stat
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path

from bow_sim.atomic_files import replacing
from bow_sim.graph.process_stat import start_of
from bow_sweep.processes.supervisor import GraphError

FILE = "graph.json"
"""The state file: there as long as the graph is, and longer only where it could not be removed (a power cut)."""

LEFT_OUT = "left_out.json"
"""The nodes that the graph goes on without: name -> reason and log; there only if there are some."""

LOGS, PLACES, TURNS = "log", "places", "turns"
"""Folders in it: logs, notes of runs (:mod:`bow_sweep.run.places`), tickets (:mod:`bow_sweep.standing.turns`)."""

MAIN_LOG = "graph.log"
"""In LOGS: what the process that keeps the graph has to say."""

PACKAGES = ("bow_sim", "bow_classifier", "bow_sweep", "bow")


@dataclass(frozen=True)
class State:
    """A standing graph, as its state file describes it.

    Attributes
    ----------
    pid, started, boot
        Process that keeps it: number, start in clock ticks since boot, and which boot that was. A number alone may
        belong to another process by now.
    since
        When it was ready, seconds since 1970.
    namespace, domain
        Where its nodes are.
    version, sources
        Of the program, see :func:`sources`.
    simulators, dashboard
        How many simulators it has, and whether it has a dashboard.
    root
        Directory of the runs of goals that have no place of their own.
    stations
        Among how many stations its simulators are divided.
    network
        Variables of the environment that extend it to other machines; empty for this machine alone.
    """

    pid: int
    started: int
    boot: str
    since: float
    namespace: str
    domain: str
    version: str
    sources: str
    simulators: int
    dashboard: bool
    root: str
    stations: int = 1
    network: dict[str, str] = field(default_factory=dict)

    @property
    def is_alive(self) -> bool:
        """Whether the process that keeps the graph is there."""
        return self.boot == boot() and start_of(self.pid) == self.started

    def write(self, folder: Path) -> None:
        """Write the state file."""
        with replacing(folder / FILE) as file:
            file.write(json.dumps(asdict(self), indent=2).encode() + b"\n")


def note_left_out(folder: Path, name: str, why: str, log: Path) -> None:
    """Write down a node that the graph goes on without."""
    found = {other: (reason, str(path)) for other, (reason, path) in left_out(folder).items()}
    with replacing(folder / LEFT_OUT) as file:
        file.write(json.dumps({**found, name: (why, str(log))}).encode() + b"\n")


def left_out(folder: Path) -> dict[str, tuple[str, Path]]:
    """Return the nodes that the graph goes on without: name -> reason and log."""
    try:
        content = json.loads((folder / LEFT_OUT).read_bytes())
        return {str(name): (str(why), Path(log)) for name, (why, log) in content.items()}
    except (OSError, ValueError, TypeError, AttributeError):
        return {}


def default_folder() -> Path:
    """Return the folder of the standing graph of this user on this machine; it need not exist.

    A home directory may be shared by several machines, so the name of the machine is in it.
    """
    base = os.environ.get("XDG_STATE_HOME", "")
    home = Path(base) if base.startswith("/") else Path.home() / ".local" / "state"
    return home / "bow" / f"graph-{socket.gethostname()}"


def make_folder(folder: Path) -> None:
    """Create the folder, its logs and its notes, for this user alone.

    Raises
    ------
    GraphError
        Where it belongs to somebody else, or cannot be created.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        for part in (folder, folder / LOGS, folder / PLACES, folder / TURNS):
            part.mkdir(mode=0o700, exist_ok=True)
            part.chmod(0o700)
    except OSError as error:
        raise GraphError(f"{error.filename or folder}: {error.strerror}; should be a folder of this user") from None


def read_state(folder: Path) -> State | None:
    """Return the graph that is there; None where there is none, and where its state file is left from before.

    Raises
    ------
    GraphError
        Where somebody else could write the folder.
    """
    try:
        about = folder.stat()
        content = json.loads((folder / FILE).read_bytes())
    except (OSError, ValueError):
        return None
    if about.st_uid != os.getuid() or about.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise GraphError(f"{folder}: others can write it; should be a folder that only this user can write")
    try:
        state = State(**{each.name: content[each.name] for each in fields(State) if each.name in content})
    except (KeyError, TypeError):
        return None
    return state if state.is_alive else None


def boot() -> str:
    """Return the identity of this boot of the machine; "" where the system has none."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return ""


def sources() -> str:
    """Return a hash of the program's files, by their names, sizes and times: it changes when one is changed."""
    base = Path(__file__).parents[2]
    found = hashlib.sha256()
    for path in sorted(path for name in PACKAGES for path in (base / name).rglob("*.py")):
        about = path.stat()
        found.update(f"{path}|{about.st_size}|{about.st_mtime_ns}\n".encode())
    return found.hexdigest()[:16]
