"""Run directories are locked where that is possible, and where it is not, it is said what to do."""

import errno
import fcntl
import os
from pathlib import Path

import pytest

from bow_sweep.plan.sweep import Sweep
from bow_sweep.run.directory import Run, RunError
from bow_sweep.run.lock import NO_LOCKS, LockedError, LockError, locked, take

SWEEP = Sweep.from_spec("fig11d", ["x.count=4", "y.count=2", "block_cells=4", "periods=10"])


def test_a_lock_keeps_others_off_and_goes_with_its_holder(tmp_path: Path) -> None:
    held = take(tmp_path, "coordinator")
    with pytest.raises(LockedError, match="another process is at work on this run as its coordinator"):
        take(tmp_path, "coordinator")
    os.close(take(tmp_path, "recorder"))  # another role
    os.close(held)
    os.close(take(tmp_path, "coordinator"))


def test_the_file_of_a_lock_that_nobody_holds_blocks_nobody(tmp_path: Path) -> None:
    (tmp_path / ".coordinator.lock").write_text("12345")
    os.close(take(tmp_path, "coordinator"))


@pytest.mark.parametrize("number", sorted(set(NO_LOCKS)))
def test_a_file_system_without_locks_is_named_and_can_be_used_without(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(fcntl, "flock", refuse)
    with pytest.raises(RunError, match=r"file system has no locks .* --no-lock"):
        Run.create(tmp_path / "run", "a" * 16, SWEEP)
    with pytest.raises(LockError, match=r"^/.* file system has no locks"), locked(tmp_path, "recorder"):
        pass
    Run.create(tmp_path / "run", "a" * 16, SWEEP, locked=False).close()
    with locked(tmp_path, "recorder", lock=False):
        pass


def test_another_error_of_a_lock_is_told_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(fcntl, "flock", refuse)
    with pytest.raises(RunError, match="Input/output error"):
        Run.create(tmp_path, "a" * 16, SWEEP)
