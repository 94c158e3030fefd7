"""A block has its receipt only when it is on the disk, and recording does not wait for the disk."""

import errno
import os
import threading
import time
from pathlib import Path

import pytest
import recording
from small_graph import SmallGraph

from bow_sim.protocol import cdr
from bow_sim.protocol.states import ReceiptKind
from bow_sweep.record import mcap_writer
from bow_sweep.record.bag import bag_files
from bow_sweep.record.disk import DiskSync
from bow_sweep.record.session import Session
from bow_sweep.record.verify import verify

SWEEP = recording.small_sweep()


class Disk:
    """A disk whose syncs return when the test allows it."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.let = threading.Event()
        self.asked = 0
        monkeypatch.setattr(os, "fdatasync", self._sync)

    def _sync(self, _: int) -> None:
        self.asked += 1
        assert self.let.wait(60)


def until(what) -> object:
    """Wait until the result of a call is true; return it."""
    end = time.monotonic() + 60
    while not (found := what()):
        assert time.monotonic() < end
        time.sleep(0.002)
    return found


def blocks_on_disk(session: Session) -> list[tuple[int, int]]:
    """Commit; return (block, attempt) of the blocks with a receipt."""
    data = session.commit(time.time_ns())
    if data is None:
        return []
    values = cdr.decode("Receipt", data)
    columns = (values[name].tolist() for name in ("kind", "block", "attempt"))
    return [(block, attempt) for kind, block, attempt in zip(*columns, strict=True) if kind == ReceiptKind.BLOCK]


def send(session: Session, block: int, attempt: int = 1) -> None:
    for chunk in recording.chunks(SWEEP, block, attempt):
        for topic, data in chunk.items():
            session.take(topic, data, time.time_ns())


@pytest.fixture
def session(tmp_path: Path):
    made = recording.session(tmp_path / "run", SWEEP)
    yield made
    made.abandon()


@pytest.mark.alone
def test_a_block_is_receipted_when_the_disk_has_it_and_messages_are_taken_meanwhile(session, monkeypatch) -> None:
    disk = Disk(monkeypatch)
    send(session, 0)
    assert blocks_on_disk(session) == []
    until(lambda: disk.asked)
    began = time.monotonic()
    send(session, 1)
    for _ in range(20):
        assert blocks_on_disk(session) == []
    assert time.monotonic() - began < 20  # the disk takes longer
    disk.let.set()
    found: list = []
    until(lambda: found.extend(blocks_on_disk(session)) or len(found) == 2)
    assert found == [(0, 1), (1, 1)]


def test_a_block_that_is_sent_again_is_answered_again(session) -> None:
    send(session, 2)
    until(lambda: (2, 1) in blocks_on_disk(session))
    send(session, 2, attempt=2)
    assert set(blocks_on_disk(session)) == {(2, 2)}


def test_part_of_a_block_is_not_receipted(session) -> None:
    for topic, data in list(recording.everything(SWEEP))[:11]:  # of 12 messages of the first block
        session.take(topic, data, time.time_ns())
    for _ in range(20):
        assert blocks_on_disk(session) == []
        time.sleep(0.005)


def test_without_sync_the_receipt_comes_with_the_commit(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(os, "fdatasync", lambda _: pytest.fail("nothing is synced"))
    data = recording.plan(SWEEP)
    now = time.time_ns()
    session = Session(tmp_path / "run", cdr.decode("Plan", data), data, "7" * 16, now, sync=False)
    send(session, 1)
    assert blocks_on_disk(session) == [(1, 1)]
    session.abandon()


def test_after_a_restart_what_is_whole_is_receipted_once_it_is_on_the_disk(tmp_path) -> None:
    first = recording.session(tmp_path / "run", SWEEP)
    send(first, 0)
    first.commit(time.time_ns())
    first.abandon()  # killed before the sync
    second = recording.session(tmp_path / "run", SWEEP, epoch=2)
    assert blocks_on_disk(second) == [(0, 1)]
    send(second, 1)
    send(second, 2)
    recording.finish(second, SWEEP, epoch=2)
    assert verify(tmp_path / "run")["ok"]


def test_a_disk_that_fails_ends_the_session(session, monkeypatch) -> None:
    def fail(_: int) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(os, "fdatasync", fail)
    send(session, 0)

    def failed() -> bool:
        try:
            session.commit(time.time_ns())
        except OSError as error:
            return error.errno == errno.EIO
        return False

    until(failed)


def test_one_sync_serves_all_that_waits(tmp_path, monkeypatch) -> None:
    disk = Disk(monkeypatch)
    with open(tmp_path / "file", "wb") as file:
        sync = DiskSync(file.fileno())
        sync.ask({1: 1})
        until(lambda: disk.asked == 1)
        for number in range(2, 9):
            sync.ask({number: 1})
        disk.let.set()
        found: dict = {}
        until(lambda: found.update(sync.done()) or len(found) == 8)
        assert disk.asked == 2
        assert sync.close() == {}


def test_what_a_sync_before_has_brought_to_the_disk_is_dropped_from_the_page_cache(tmp_path, monkeypatch) -> None:
    dropped: list[tuple[int, int, int]] = []
    monkeypatch.setattr(os, "posix_fadvise", lambda _, *what: dropped.append(what))
    with open(tmp_path / "file", "wb") as file:
        sync = DiskSync(file.fileno())
        for number in range(3):
            sync.wrote([(100 * number, 100 * number + 70)])
            sync.ask({number: 1})
            until(sync.done)
        sync.wrote([(900, 999)])
        sync.close()
    drop = os.POSIX_FADV_DONTNEED
    assert dropped == [(0, 70, drop), (100, 70, drop)]


def test_a_file_system_that_drops_nothing_is_asked_once_and_receipts_come_all_the_same(tmp_path, monkeypatch) -> None:
    asked: list[tuple[int, ...]] = []

    def refuse(*what: int) -> None:
        asked.append(what)
        raise OSError(errno.EINVAL, "Invalid argument")

    monkeypatch.setattr(os, "posix_fadvise", refuse)
    with open(tmp_path / "file", "wb") as file:
        sync = DiskSync(file.fileno())
        for number in range(4):
            sync.wrote([(0, 1), (1, 2)])
            sync.ask({number: 1})
            assert until(sync.done) == {number: 1}
        sync.close()
    assert len(asked) == 1


def test_the_streams_of_a_session_are_dropped_and_what_the_check_by_index_reads_is_not(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(mcap_writer, "BULK", 4096)  # verdicts are smaller
    places: list[tuple[int, int]] = []
    monkeypatch.setattr(os, "posix_fadvise", lambda _, first, size, __: places.append((first, first + size)))
    session = recording.session(tmp_path / "run", SWEEP)
    found: list = []
    for block in range(SWEEP.blocks):
        send(session, block)
        until(lambda: found.extend(blocks_on_disk(session)) or len(found) == block + 1)  # noqa: B023
    recording.finish(session, SWEEP)
    assert places
    path = bag_files(tmp_path / "run" / "bag")[0]
    content = bytearray(path.read_bytes())
    for first, end in places:
        content[first:end] = bytes(end - first)
    path.write_bytes(content)
    assert verify(tmp_path / "run", classify=False, index=True)["ok"]


def test_a_sweep_with_syncs_is_done_and_holds(tmp_path) -> None:
    SmallGraph(tmp_path / "run", SWEEP, sync=True).run()
    assert verify(tmp_path / "run")["ok"]


def test_a_block_that_nothing_says_came_to_the_disk_is_a_problem(tmp_path, monkeypatch) -> None:
    session = recording.session(tmp_path / "run", SWEEP)
    for topic, data in recording.everything(SWEEP):
        session.take(topic, data, time.time_ns())
    session._whole.pop(1)
    recording.finish(session, SWEEP)
    assert [p["what"] for p in verify(tmp_path / "run")["problems"]] == ["no receipt states that it is on the disk"]
