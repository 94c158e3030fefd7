"""Where the runs of a standing graph go: a note for each run, in a folder that only its user can write.

What arrives over the network gives a name, never a path. So a client that sends a goal to a standing graph first writes
a note, named by the run, into this folder; the nodes of the graph look the run up there. Who cannot write the folder
can name no directory.
"""

from __future__ import annotations

import json
import os
import re
from dataclasses import dataclass
from pathlib import Path

from bow_sim.atomic_files import replacing

MOST_BYTES = 1 << 16
"""A larger file is no note."""

_NAME = re.compile(r"[0-9a-f]{16}\.json")


@dataclass(frozen=True)
class Place:
    """Where a run goes, and what it is to leave there.

    Attributes
    ----------
    directory
        Run directory, absolute.
    resume
        Whether it holds this run already, which is to go on.
    dashboard
        Whether the dashboard draws the run.
    """

    directory: Path
    resume: bool = False
    dashboard: bool = True


def write_place(folder: Path, run_id: str, place: Place) -> None:
    """Write the note of a run.

    Raises
    ------
    OSError
        Where it cannot be written.
    """
    content = {"directory": str(place.directory), "resume": place.resume, "dashboard": place.dashboard}
    with replacing(_note(folder, run_id)) as file:
        file.write(json.dumps(content).encode() + b"\n")


def find_place(folder: Path | None, run_id: str) -> Place | None:
    """Return the place of a run; None where it has no note of this user, or there is no folder."""
    if folder is None or not _NAME.fullmatch(f"{run_id}.json"):
        return None
    try:
        descriptor = os.open(_note(folder, run_id), os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(descriptor, "rb") as file:
            if os.fstat(descriptor).st_uid != os.getuid():
                return None
            content = json.loads(file.read(MOST_BYTES))
        directory = Path(str(content["directory"]))
        place = Place(directory, bool(content["resume"]), bool(content["dashboard"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return place if directory.is_absolute() else None


def remove_places(folder: Path, *, but: str = "") -> None:
    """Remove all notes, but for that of one run."""
    for path in folder.glob("*.json"):
        if _NAME.fullmatch(path.name) and path.stem != but:
            path.unlink(missing_ok=True)


def _note(folder: Path, run_id: str) -> Path:
    return folder / f"{run_id}.json"
