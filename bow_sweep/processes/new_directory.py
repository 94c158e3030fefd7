"""The directory of a run: created and locked before a process is started, and removed where no run begins in it."""

from __future__ import annotations

import contextlib
import os
import shlex
import time
from dataclasses import dataclass
from pathlib import Path

from bow_sweep.processes.run_graph import LOGS
from bow_sweep.processes.shm_cleaner import NOTE
from bow_sweep.run.directory import CAMPAIGN, LEDGER, SEARCH, STUDY, RunError
from bow_sweep.run.lock import name_of, take

RUNS = Path("runs")
"""Parent of run directories with a default name."""

TRIES = 1000
"""Default names that are tried, where other processes take them at the same time."""

SUPERVISOR = "supervisor"

_START = (*map(name_of, (SUPERVISOR, "coordinator", "recorder")), f".{LEDGER}.part")
"""Files, beside logs, of a start that was interrupted before the run began."""

DASHBOARD = "dashboard.rrd"

_PROBE = ".writable"


@dataclass
class OwnedDirectory:
    """A directory in which only this process runs sweeps.

    Attributes
    ----------
    directory
        Absolute path.
    made
        Directories that were created for it, the innermost first.
    lock
        File descriptor of its lock; None where it is not locked.
    new
        Whether it is for a new run.
    """

    directory: Path
    made: list[Path]
    lock: int | None
    new: bool

    def release(self, *runs: Path) -> bool:
        """Release the lock. Where no new run has begun, remove everything: the same command can be given again.

        Parameters
        ----------
        *runs
            Run directories below it; for a study.

        Returns
        -------
        bool
            Whether a run has begun in it.
        """
        begun = not self.new or any((run / LEDGER).exists() for run in (self.directory, *runs))
        if not begun:
            for name in (STUDY, SEARCH, CAMPAIGN):
                (self.directory / name).unlink(missing_ok=True)
            for run in (*runs, self.directory):
                _remove_start(run)
            _remove_empty(*(run for run in runs if run != self.directory), *self.made)
        if self.lock is not None:
            os.close(self.lock)
        return begun


def create_directory(out: Path | None, name: str, locked: bool = True) -> OwnedDirectory:
    """Create the directory of a new run.

    Parameters
    ----------
    out
        As the user gave it; may exist, if it is empty. None for a new one with a default name in runs/.
    name
        First part of the default name.
    locked
        Lock it; not possible on file systems that have no locks.

    Raises
    ------
    RunError
        Where it cannot be created or used; the message names what the user gave.
    """
    made: list[Path] = []
    given = f"--out {out}" if out is not None else f"{RUNS}/"
    remedy = "" if out is not None else "; --out DIR puts the run somewhere else"
    owned = None
    try:
        _check_name(str(out or ""))
        directory = _given(out.absolute(), made) if out is not None else _next(name, made)
        owned = OwnedDirectory(directory, made, take(directory, SUPERVISOR) if locked else None, new=True)
        probe = directory / _PROBE
        probe.touch()
        probe.unlink()
    except RunError as error:
        raise RunError(f"{given}: {error}") from None
    except FileExistsError as error:
        raise RunError(f"{given}: {error.filename} is a file; should be a directory that is new or empty") from None
    except OSError as error:
        _remove_empty(*made)
        if owned is not None:
            owned.release()
        raise RunError(f"{given}: cannot be written: {error.strerror}{remedy}") from None
    return owned


def open_directory(directory: Path, locked: bool = True) -> OwnedDirectory:
    """Open the directory of a run that is to be resumed.

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
    return OwnedDirectory(directory, [], take(directory, SUPERVISOR) if locked else None, new=False)


def _check_name(name: str) -> None:
    try:
        name.encode()
    except UnicodeEncodeError:
        raise RunError("the name is not UTF-8, as the names and parameters of ROS are") from None


def never_began(directory: Path) -> bool:
    """Return whether a directory holds at most the files of a start that was interrupted before its run began."""
    logs = directory / LOGS
    return all(path.name in _START or path == logs for path in directory.iterdir()) and (
        not logs.exists() or all(map(_is_log, logs.iterdir()))
    )


def _is_log(path: Path) -> bool:
    return path.suffix == ".log" or path.name.startswith(f"{NOTE}.")


def _given(directory: Path, made: list[Path]) -> Path:
    """Create the directory that the user named, or use it where it is empty."""
    _make(directory, made)
    if not never_began(directory):
        begun = any((directory / name).exists() for name in (LEDGER, STUDY, SEARCH, CAMPAIGN))
        go_on = f"go on with --resume {shlex.quote(str(directory))}" if begun else "an empty one"
        raise RunError(f"is not empty; choose a new one, or {go_on}")
    return directory.resolve()


def _next(name: str, made: list[Path]) -> Path:
    """Create a directory with a default name, with a number after it where the name is taken."""
    parent = RUNS.absolute()
    _make(parent, made)
    stem = f"{name}-{time.strftime('%Y%m%d-%H%M%S')}"
    for number in range(1, TRIES):
        directory = parent / (stem if number == 1 else f"{stem}-{number}")
        try:
            directory.mkdir()
        except FileExistsError:
            continue
        made.insert(0, directory)
        return directory.resolve()
    raise RunError(f"{stem} and {TRIES - 2} names like it are taken")


def _make(directory: Path, made: list[Path]) -> None:
    """Create a directory and the missing ones above it; insert these into `made`."""
    if directory.is_dir():
        return
    if directory.parent != directory:
        _make(directory.parent, made)
    try:
        directory.mkdir()
    except FileExistsError:  # another process has created it in the meantime
        if not directory.is_dir():
            raise
    else:
        made.insert(0, directory)


def _remove_empty(*directories: Path) -> None:
    for directory in directories:
        with contextlib.suppress(OSError):  # not empty: it holds files that are not ours
            directory.rmdir()


def _remove_start(directory: Path) -> None:
    """Remove the files of an interrupted start."""
    logs = directory / LOGS
    with contextlib.suppress(OSError):
        for name in (*_START, DASHBOARD):
            (directory / name).unlink(missing_ok=True)
        for path in filter(_is_log, logs.iterdir()):
            path.unlink(missing_ok=True)
        logs.rmdir()
