"""The directory of a new run: claimed before there is a process, given back where no run begins."""

from __future__ import annotations

import contextlib
import os
import shlex
import time
from dataclasses import dataclass
from pathlib import Path

from bow_sweep.processes.run_graph import LOGS
from bow_sweep.processes.shm_cleaner import NOTE
from bow_sweep.run.campaign import FILE as CAMPAIGN
from bow_sweep.run.directory import LEDGER, RunError, lock

RUNS = Path("runs")

AGAIN = 1000
"""Names that are tried, where others take them at the same time."""

SUPERVISOR = "supervisor"

_START = (f".{SUPERVISOR}.lock", ".coordinator.lock", ".recorder.lock", f".{LEDGER}.part")
"""What a start leaves, beside logs, that was cut off before the run began."""

DASHBOARD = "dashboard.rrd"

_PROBE = ".writable"


@dataclass
class Claim:
    """A directory that this process alone works on.

    Attributes
    ----------
    directory
        Where it is, absolute.
    made
        Directories that were made for it, the innermost first.
    lock
        Descriptor of its lock, None where it is not to be locked.
    new
        Whether it is for a new run.
    """

    directory: Path
    made: list[Path]
    lock: int | None
    new: bool

    def release(self, *runs: Path) -> bool:
        """Let go of it; return whether a run has begun in it, or in the directories `runs` below it.

        Where a new one has not, nothing is left of the attempt: the same command can be given again.
        """
        begun = not self.new or any((run / LEDGER).exists() for run in (self.directory, *runs))
        if not begun:
            (self.directory / CAMPAIGN).unlink(missing_ok=True)
            for run in (*runs, self.directory):
                _remove_start(run)
            for place in (*(run for run in runs if run != self.directory), *self.made):
                with contextlib.suppress(OSError):  # not empty: something else is in it
                    place.rmdir()
        if self.lock is not None:
            os.close(self.lock)
        return begun


def claim(out: Path | None, name: str, locked: bool = True) -> Claim:
    """Make the directory of a new run, for this process alone.

    Parameters
    ----------
    out
        What the user named; None for a new one of the default name in runs/.
    name
        What the default name begins with.
    locked
        Keep others off it; not on file systems that have no locks.

    Raises
    ------
    RunError
        Where that cannot be; names what the user gave, or nothing that the user did not.
    """
    made: list[Path] = []
    called = f"--out {out}" if out is not None else f"{RUNS}/"
    remedy = "" if out is not None else "; --out DIR puts the run somewhere else"
    held = None
    try:
        _check_name(str(out or ""))
        directory = _given(out.absolute(), made) if out is not None else _next(name, made)
        held = Claim(directory, made, lock(directory, SUPERVISOR) if locked else None, new=True)
        probe = directory / _PROBE
        probe.touch()
        probe.unlink()
    except RunError as error:
        raise RunError(f"{called}: {error}") from None
    except FileExistsError as error:
        raise RunError(f"{called}: {error.filename} is a file; should be a directory that is new or empty") from None
    except OSError as error:
        for place in made:
            with contextlib.suppress(OSError):
                place.rmdir()
        if held is not None:
            held.release()
        raise RunError(f"{called}: cannot be written: {error.strerror}{remedy}") from None
    return held


def take_up(directory: Path, locked: bool = True) -> Claim:
    """Take a directory with a run for this process alone, to go on with it.

    Raises
    ------
    RunError
        Where another process is at work on it, or no run was begun in it.
    """
    _check_name(str(directory))
    if not directory.is_dir():
        raise RunError(f"{directory}: is no directory; should be a run directory of `bow sweep`")
    if never_began(directory):
        raise RunError(
            f"{directory}: no run was begun here; give the sweep anew, with --out {shlex.quote(str(directory))}"
        )
    return Claim(directory, [], lock(directory, SUPERVISOR) if locked else None, new=False)


def _check_name(name: str) -> None:
    try:
        name.encode()
    except UnicodeEncodeError:
        raise RunError("the name is not UTF-8, as the names and parameters of ROS are") from None


def never_began(directory: Path) -> bool:
    """Return whether a directory holds nothing but what a start leaves that was cut off before its run began."""
    logs = directory / LOGS
    return all(path.name in _START or path == logs for path in directory.iterdir()) and (
        not logs.exists() or all(map(_is_log, logs.iterdir()))
    )


def _is_log(path: Path) -> bool:
    return path.suffix == ".log" or path.name.startswith(f"{NOTE}.")


def _given(directory: Path, made: list[Path]) -> Path:
    """Make the directory that the user named, or use it where it is empty."""
    _make(directory, made)
    if not never_began(directory):
        begun = (directory / LEDGER).exists() or (directory / CAMPAIGN).exists()
        go_on = f"go on with --resume {shlex.quote(str(directory))}" if begun else "an empty one"
        raise RunError(f"is not empty; choose a new one, or {go_on}")
    return directory.resolve()


def _next(name: str, made: list[Path]) -> Path:
    """Make a directory of the default name, with a number behind it where others have it already."""
    parent = RUNS.absolute()
    _make(parent, made)
    stem = f"{name}-{time.strftime('%Y%m%d-%H%M%S')}"
    for number in range(1, AGAIN):
        directory = parent / (stem if number == 1 else f"{stem}-{number}")
        try:
            directory.mkdir()
        except FileExistsError:
            continue
        made.insert(0, directory)
        return directory.resolve()
    raise RunError(f"{stem} and {AGAIN - 2} names like it are taken")


def _make(directory: Path, made: list[Path]) -> None:
    """Make a directory and those above it, as far as they are missing; add these to `made`."""
    if directory.is_dir():
        return
    if directory.parent != directory:
        _make(directory.parent, made)
    try:
        directory.mkdir()
    except FileExistsError:  # another process has made it meanwhile
        if not directory.is_dir():
            raise
    else:
        made.insert(0, directory)


def _remove_start(directory: Path) -> None:
    """Remove what a start has left in a directory."""
    logs = directory / LOGS
    with contextlib.suppress(OSError):
        for name in (*_START, DASHBOARD):
            (directory / name).unlink(missing_ok=True)
        for path in filter(_is_log, logs.iterdir()):
            path.unlink(missing_ok=True)
        logs.rmdir()
