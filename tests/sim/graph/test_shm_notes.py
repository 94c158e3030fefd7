"""The shared memory of a killed node without a supervisor is removed by the next node; files in use stay."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from bow_sim.graph import process_stat, shm_files, shm_notes
from bow_sim.graph.discovery import SHARED_MEMORY

SEGMENT = f"{SHARED_MEMORY}/fastrtps_{'0' * 8}{os.getpid():08x}"


@pytest.fixture
def segment() -> Iterator[tuple[Path, Path]]:
    """A segment of Fast DDS and its lock, which no process holds."""
    files = Path(SEGMENT), Path(f"{SEGMENT}_el")
    for file in files:
        file.touch()
    yield files
    for file in files:
        file.unlink(missing_ok=True)


@pytest.fixture
def dead() -> int:
    """The number of a process that is gone."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def note(place: Path, *files: object, uid: int | None = None, space: int | None = None, pid: int, since: int) -> Path:
    owner = os.getuid() if uid is None else uid
    path = place / f"bow_{owner}_{shm_notes._namespace() if space is None else space}_{pid}_{since}"
    path.write_text("".join(f"{file}\n" for file in files))
    return path


def test_what_a_dead_process_noted_is_removed_with_its_note(
    tmp_path: Path, segment: tuple[Path, Path], dead: int
) -> None:
    mine = note(tmp_path, segment[1], pid=dead, since=1)
    shm_notes.remove_leftovers(tmp_path)
    assert not any(file.exists() for file in (*segment, mine))


def test_a_reused_process_number_is_recognised_by_the_start_of_the_process(
    tmp_path: Path, segment: tuple[Path, Path]
) -> None:
    note(tmp_path, segment[1], pid=os.getpid(), since=1)
    shm_notes.remove_leftovers(tmp_path)
    assert not any(file.exists() for file in segment)


def test_a_zombie_process_counts_as_gone(tmp_path: Path, segment: tuple[Path, Path]) -> None:
    process = subprocess.Popen(["sleep", "60"])
    since = process_stat.start_of(process.pid)
    assert since
    note(tmp_path, segment[1], pid=process.pid, since=since)
    shm_notes.remove_leftovers(tmp_path)
    assert segment[0].exists(), "it lives"
    process.kill()
    os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
    shm_notes.remove_leftovers(tmp_path)
    assert not segment[0].exists()
    process.wait()


def test_files_in_use_stay_and_the_note_with_them(tmp_path: Path, segment: tuple[Path, Path], dead: int) -> None:
    mine = note(tmp_path, segment[1], pid=dead, since=1)
    with open(segment[1]) as held:
        fcntl.flock(held, fcntl.LOCK_SH)
        shm_notes.remove_leftovers(tmp_path)
        assert all(file.exists() for file in (*segment, mine))
    shm_notes.remove_leftovers(tmp_path)
    assert not any(file.exists() for file in (*segment, mine))


@pytest.mark.parametrize("whose", [{"uid": os.getuid() + 1}, {"space": 1}], ids=["another user", "another container"])
def test_notes_of_others_are_left_alone(
    tmp_path: Path, segment: tuple[Path, Path], dead: int, whose: dict[str, int]
) -> None:
    other = note(tmp_path, segment[1], pid=dead, since=1, **whose)
    shm_notes.remove_leftovers(tmp_path)
    assert all(file.exists() for file in (*segment, other))


def test_a_note_is_no_link_and_names_nothing_but_what_fast_dds_makes(
    tmp_path: Path, segment: tuple[Path, Path], dead: int
) -> None:
    letter = tmp_path / "letter"
    letter.write_text("mine")
    listed = tmp_path / "listed"
    listed.write_text(f"{segment[1]}\n")
    link = note(tmp_path, pid=dead, since=1)
    link.unlink()
    link.symlink_to(listed)
    note(tmp_path, letter, f"{SEGMENT}/../../../{letter}", "\0", pid=dead, since=2)
    (tmp_path / f"bow_{os.getuid()}_{shm_notes._namespace()}_{dead}_3").mkdir()
    os.mkfifo(tmp_path / f"bow_{os.getuid()}_{shm_notes._namespace()}_{dead}_4")
    shm_notes.remove_leftovers(tmp_path)
    assert letter.read_text() == "mine"
    assert all(file.exists() for file in segment), "a link is not followed"


def test_without_shared_memory_there_are_no_notes(tmp_path: Path) -> None:
    nowhere = tmp_path / "nowhere"
    mine = shm_notes.Note(nowhere)
    mine.update()
    mine.close()
    assert not nowhere.exists()


def test_a_note_lists_all_files_of_the_process_until_it_ends(
    tmp_path: Path, segment: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shm_notes, "UPDATE_S", 0.0)
    monkeypatch.delenv(shm_notes.SUPERVISED, raising=False)
    mine = shm_notes.Note(tmp_path)
    before = shm_files.files_of(os.getpid())
    with open(segment[1]):
        mine.update()
        (path,) = tmp_path.iterdir()
        assert path.name == shm_notes._name(os.getpid())
        assert shm_files.noted(path) == before | {str(segment[1])}
        assert path.stat().st_mode & 0o777 == 0o600
        shm_notes.remove_leftovers(tmp_path)
        assert path.exists(), "a living process's"
    mine.close()
    assert list(tmp_path.iterdir()) == []


def test_a_process_with_a_supervisor_writes_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(shm_notes.SUPERVISED, "1")
    mine = shm_notes.Note(tmp_path)
    mine.update()
    assert list(tmp_path.iterdir()) == []
    mine.close()


def test_a_port_that_nobody_finishes_keeps_nobody_waiting(tmp_path: Path) -> None:
    """Fast DDS waits for the size of the file; Boost's first word says then that the port is of no use."""
    names = ("fastrtps_port7001", "fastrtps_port7002", "fastrtps_port7003", "fastrtps_port7003_el")
    dead, young, whole, lock = (tmp_path / name for name in names)
    for file in (dead, young, whole, lock):
        file.touch()
    whole.write_bytes(b"2")
    for file in (dead, whole, lock):
        os.utime(file, (0, 0))
    with open(dead, "rb") as waits:
        shm_notes.remove_leftovers(tmp_path)
        assert waits.read() == (3).to_bytes(4, "little")
    assert [file.exists() for file in (dead, young, whole, lock)] == [False, True, True, True]
