"""Shared-memory files of processes that have exited are removed, and no others, whichever process is killed."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import inotify_simple
import pytest

from bow_sim.graph import shm_files
from bow_sweep.processes.shm_cleaner import NOTE, SharedFiles, ShmCleaner

SHARED = Path("/dev/shm")

SEGMENT = SHARED / f"fastrtps_0123{os.getpid():012x}"
PORT = SHARED / f"fastrtps_port{10**9 + os.getpid()}"
SEMAPHORE = SHARED / f"sem.{PORT.name}_mutex"

HOLDS = """
import fcntl, mmap, os, sys
kept = []
for name in sys.argv[1:]:
    name = name.replace("PID", f"{os.getpid() % 256:02x}.{os.getpid() // 256 % 256:02x}")
    kept.append(os.open(name, os.O_RDWR | os.O_CREAT))
    if name.endswith("_el"):
        fcntl.flock(kept[-1], fcntl.LOCK_EX)
    else:
        os.truncate(name, 4096)
        kept.append(mmap.mmap(kept[-1], 0))
print("holds", flush=True)
sys.stdin.read()
"""
"""A process with shared memory as Fast DDS uses it: locked files, and mapped files."""


def lowest(number: int) -> str:
    """Return the lowest two bytes of a number as Fast DDS writes them."""
    return f"{number % 256:02x}.{number // 256 % 256:02x}"


LENT = SHARED / f"fast_datasharing_01.0f.{lowest(os.getpid())}.PID.f1.4e.00.00.00.00_0.0.14.3"


def lock(file: Path) -> Path:
    return file.with_name(f"{file.name}_el")


@contextlib.contextmanager
def holding(*files: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Start a process that holds these files."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLDS, *files], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == b"holds\n"
            yield process
        finally:
            process.kill()


def lent_by(pid: int) -> Path:
    """Return the file, as Fast DDS names it, that a process lends."""
    return Path(str(LENT).replace("PID", lowest(pid)))


def wait_until(what: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 20
    while not what():
        assert time.monotonic() < deadline, "timed out"
        time.sleep(0.01)


def notes(folder: Path) -> list[Path]:
    return list(folder.glob(f"{NOTE}.*"))


def is_noted(file: Path, folder: Path) -> bool:
    """Return whether a note names the file: a note is made first and written then."""
    return any(f"{file}\n" in note.read_text() for note in notes(folder))


@contextlib.contextmanager
def watched(cleaner: ShmCleaner, folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Start a process with a segment; yield it once the cleaner has noted that."""
    SEGMENT.touch()
    with holding(lock(SEGMENT)) as process:
        cleaner.watch(process.pid)
        wait_until(lambda: is_noted(lock(SEGMENT), folder))
        yield process


@pytest.fixture(autouse=True)
def nothing_stays() -> Iterator[None]:
    """Also after a test that fails."""
    yield
    lent = SHARED.glob(LENT.name.replace("PID.f1.4e", "*"))
    for file in (SEGMENT, PORT, lock(SEGMENT), lock(PORT), SEMAPHORE, *lent):
        file.unlink(missing_ok=True)


# ---- files


def test_a_note_names_segments_ports_and_what_is_lent_and_nothing_else(tmp_path: Path) -> None:
    files = {str(lock(SEGMENT)), str(lock(PORT)), str(lent_by(1234))}
    note = tmp_path / "note"
    assert shm_files.noted(note) == set()
    shm_files.note(note, files)
    with open(note, "a") as file:
        file.write(f"/etc/passwd\n{lock(SEGMENT)}/../x\n/tmp/fast_datasharing_01\n{SEGMENT}\n\n\x00")
    assert shm_files.noted(note) == files
    shm_files.note(tmp_path / "nowhere" / "note", files)


def test_the_files_of_a_process_are_found_and_removed_after_its_exit() -> None:
    SEGMENT.touch()
    with holding(lock(SEGMENT), LENT) as process:
        others = lent_by(process.pid).with_name(lent_by(process.pid).name.replace("f1.4e", "00.00"))
        others.write_bytes(b"x")  # by a process of the same number, elsewhere
        files = shm_files.files_of(process.pid)
        assert files == {str(lock(SEGMENT)), str(lent_by(process.pid))}
        assert shm_files.files_of(process.pid, files) == set()
        assert shm_files.remove(files) == files
        process.kill()
        process.wait()
        assert shm_files.files_of(process.pid) == set()
        assert shm_files.remove(files) == set()
        assert shm_files.remove(files) == set()
        assert not SEGMENT.exists()
        assert others.exists()


def test_a_port_is_removed_last_with_its_semaphore_even_where_it_was_made_again() -> None:
    files = {str(lock(PORT))}
    for made in ((PORT, SEMAPHORE, lock(PORT)), (PORT, SEMAPHORE)):
        for file in made:
            file.touch()
        assert shm_files.remove(files) == files
        with open(lock(PORT), "a") as held:
            fcntl.flock(held, fcntl.LOCK_EX)
            assert shm_files.remove(files, ports=True) == files
            assert PORT.exists()
        if lock(PORT) not in made:
            lock(PORT).unlink()
        assert shm_files.remove(files, ports=True) == set()
        assert not [file for file in (PORT, SEMAPHORE, lock(PORT)) if file.exists()]


# ---- the files of processes


def test_a_new_file_belongs_to_the_process_in_its_name(tmp_path: Path) -> None:
    files = SharedFiles(tmp_path)
    files.add(4711)
    for pid in (4711, 4712):
        lent_by(pid).touch()
    files.created([lent_by(4711).name, lent_by(4712).name, "another", "fastrtps_0123456789abcdef_el"])
    files.exited(4711)
    assert not lent_by(4711).exists()
    assert lent_by(4712).exists()
    files.close()
    assert lent_by(4712).exists()


@pytest.mark.parametrize("kernel_tells", [True, False])
def test_a_new_lock_belongs_to_the_process_that_holds_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kernel_tells: bool
) -> None:
    if not kernel_tells:
        monkeypatch.setattr(shm_files, "holders", lambda: None)
    files = SharedFiles(tmp_path)
    files.add(os.getpid())
    ours, of_others = str(lock(SEGMENT)), str(lock(PORT))
    with holding(lock(PORT)):
        with open(ours, "w") as held:
            files.created([lock(SEGMENT).name, lock(PORT).name])
            files.look()
            assert (of_others in files.unowned) is not kernel_tells  # it is not looked for any more
            assert (ours in files.unowned) is kernel_tells  # nobody has locked it yet
            fcntl.flock(held, fcntl.LOCK_EX)
            files.look()
            assert ours not in files.unowned
        files.exited(os.getpid())
        assert not lock(SEGMENT).exists()
        assert lock(PORT).exists()


def test_the_files_noted_by_a_killed_cleaner_are_removed_by_the_next_one(tmp_path: Path) -> None:
    (tmp_path / f"{NOTE}.1").write_text(f"{lock(SEGMENT)}\n{lent_by(4711)}\n")
    for file in (lock(SEGMENT), SEGMENT, lent_by(4711)):
        file.touch()
    with open(lock(SEGMENT)) as held:  # a process of the run before is still ending
        fcntl.flock(held, fcntl.LOCK_EX)
        files = SharedFiles(tmp_path)
        assert not lent_by(4711).exists()
        assert SEGMENT.exists()
    files.close()
    assert not SEGMENT.exists()
    assert list(tmp_path.iterdir()) == []


# ---- its process


def test_it_removes_the_files_of_a_killed_process_and_ends_when_it_is_closed(tmp_path: Path) -> None:
    cleaner = ShmCleaner(tmp_path, "/bow/x", [])
    with watched(cleaner, tmp_path) as process:
        process.kill()
        wait_until(lambda: not SEGMENT.exists() and not lock(SEGMENT).exists())
    assert not cleaner.has_exited
    cleaner.close(20)
    assert notes(tmp_path) == []
    assert (tmp_path / "shm_cleaner.log").read_text() == ""


def test_it_notices_files_that_are_made_later(tmp_path: Path) -> None:
    cleaner = ShmCleaner(tmp_path, "/bow/x", [])
    with holding() as process:
        cleaner.watch(process.pid)
        time.sleep(0.3)  # nothing is made now, so it does not scan
        lent_by(process.pid).touch()
        wait_until(lambda: is_noted(lent_by(process.pid), tmp_path))
        process.kill()
        wait_until(lambda: not lent_by(process.pid).exists())
    cleaner.close(20)


def test_it_frees_a_port_that_a_killed_process_did_not_finish(tmp_path: Path) -> None:
    cleaner = ShmCleaner(tmp_path, "/bow/x", [])
    with holding() as process:
        cleaner.watch(process.pid)
        PORT.touch()
        with open(PORT, "rb") as waits:
            process.kill()
            wait_until(lambda: not PORT.exists())
            assert waits.read() == (3).to_bytes(4, "little")
    cleaner.close(20)


def test_where_it_was_killed_the_supervisor_does_its_work_in_the_end(tmp_path: Path) -> None:
    cleaner = ShmCleaner(tmp_path, "/bow/x", [])
    with watched(cleaner, tmp_path) as process:
        cleaner._process.kill()
        cleaner._process.wait()
        assert cleaner.has_exited
        cleaner.watch(process.pid)  # it does not arrive
        process.kill()
        process.wait()
    assert SEGMENT.exists()
    cleaner.close(20)
    assert not SEGMENT.exists()
    assert notes(tmp_path) == []


SUPERVISES = """
import os, signal, sys
from pathlib import Path
from bow_sweep.processes import shm_cleaner
shm_cleaner.LEAVE_S = float(sys.argv[3])
cleaner = shm_cleaner.ShmCleaner(Path(sys.argv[1]), "/bow/x", [int(sys.argv[2])])
print("supervises", flush=True)
sys.stdin.read()
"""


def test_it_outlives_a_killed_supervisor_until_all_processes_have_exited(tmp_path: Path) -> None:
    leave_s = 3.0
    SEGMENT.touch()
    with (
        holding(lock(SEGMENT)) as process,
        subprocess.Popen(
            [sys.executable, "-c", SUPERVISES, tmp_path, str(process.pid), str(leave_s)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        ) as supervisor,
    ):
        assert supervisor.stdout is not None
        assert supervisor.stdout.readline() == b"supervises\n"
        wait_until(lambda: is_noted(lock(SEGMENT), tmp_path))
        (note,) = notes(tmp_path)
        cleaner = int(note.suffix[1:])
        time.sleep(leave_s + 0.2)  # longer than it waits for processes without a supervisor
        supervisor.send_signal(signal.SIGKILL)
        supervisor.wait()
        time.sleep(0.2)
        os.kill(cleaner, 0)  # it runs
        assert SEGMENT.exists()
        process.kill()
        wait_until(lambda: not SEGMENT.exists())
        wait_until(lambda: not note.exists())
        wait_until(lambda: not Path(f"/proc/{cleaner}/exe").exists())


@pytest.mark.parametrize("error", [errno.ENOSYS, errno.EPERM, errno.EINVAL, None])
def test_where_the_kernel_reports_nothing_it_polls(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: int | None
) -> None:
    """Old kernels and sandboxes have no pidfd_open, and some no inotify."""

    def refuse(*_: object) -> int:
        assert error is not None
        raise OSError(error, os.strerror(error))

    if error is None:
        monkeypatch.delattr(os, "pidfd_open")
    else:
        monkeypatch.setattr(os, "pidfd_open", refuse)
        monkeypatch.setattr(inotify_simple.INotify, "__init__", refuse)
    cleaner = ShmCleaner(tmp_path, "/bow/x", [])
    with watched(cleaner, tmp_path) as process:
        process.kill()  # a zombie has ended
        wait_until(lambda: not SEGMENT.exists())
        assert not cleaner.has_exited
    cleaner.close(20)
    assert notes(tmp_path) == []
