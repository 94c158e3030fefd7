"""Space reserved behind the end of a bag: readers see nothing of it, and it is given back."""

import os
from pathlib import Path

import pytest
from mcap.records import Channel, Schema

from bow_sweep.record import reserve
from bow_sweep.record.mcap_reader import Scan
from bow_sweep.record.mcap_writer import McapWriter
from bow_sweep.record.recover import finish_file

STEP = 2 << 20
MESSAGE = 1_100_000


@pytest.fixture
def reserved(tmp_path, monkeypatch) -> list[int]:
    """Where space was reserved."""
    true, offsets = reserve._fallocate, []
    with open(tmp_path / "tried", "wb") as file:
        if true is None or true(file.fileno(), reserve._KEEP_SIZE, 0, STEP):
            pytest.skip("space cannot be reserved here")

    def fallocate(descriptor: int, mode: int, offset: int, length: int) -> int:
        offsets.append(offset)
        return true(descriptor, mode, offset, length)

    monkeypatch.setattr(reserve, "_fallocate", fallocate)
    monkeypatch.setattr(reserve, "STEP", STEP)
    return offsets


@pytest.fixture
def writer(tmp_path):
    schemas = [Schema(id=1, name="pkg/msg/Thing", encoding="ros2msg", data=b"uint8 x\n")]
    channels = [Channel(id=1, topic="/one", message_encoding="cdr", schema_id=1, metadata={})]
    made = McapWriter(tmp_path / "a.mcap", schemas, channels)
    yield made
    made.abandon()


def write(writer: McapWriter, size: int = MESSAGE) -> int:
    """Commit a message; return the size of the file."""
    writer.add(1, 1, 1, 1, bytes(size))
    writer.commit()
    return writer.path.stat().st_size


def on_disk(path: Path) -> int:
    return path.stat().st_blocks * 512


def test_space_is_reserved_for_several_commits_and_the_rest_is_given_back(writer, reserved):
    assert MESSAGE < write(writer) < MESSAGE + 1000
    assert on_disk(writer.path) > STEP
    assert 4 * MESSAGE < [write(writer) for _ in range(3)][-1] < 4 * MESSAGE + 2000
    assert len(reserved) == 2
    writer.finish()
    assert Scan(writer.path).run().whole
    assert on_disk(writer.path) < 4 * MESSAGE + 100_000


def test_small_commits_reserve_nothing(writer, reserved):
    for _ in range(5):
        write(writer, reserve.LARGE // 2)
    assert reserved == []


def test_what_a_killed_recorder_had_reserved_is_given_back_by_the_repair(writer, reserved, tmp_path):
    write(writer)
    torn = tmp_path / "torn.mcap"
    os.link(writer.path, torn)
    assert on_disk(torn) > STEP
    finish_file(Scan(torn).run())
    assert Scan(torn).run().whole
    assert on_disk(torn) < MESSAGE + 100_000


def test_a_file_that_is_given_up_keeps_no_more_than_its_contents(writer, reserved):
    write(writer)
    writer.abandon()
    assert on_disk(writer.path) < MESSAGE + 100_000


def test_a_full_disk_that_gives_a_part_gets_it_back_and_is_not_asked_again(writer, reserved, monkeypatch):
    true = reserve._fallocate
    monkeypatch.setattr(reserve, "_fallocate", lambda *what: true(*what) - 1)
    write(writer)
    assert on_disk(writer.path) < MESSAGE + 100_000
    write(writer)
    writer.finish()
    assert len(reserved) == 1
    assert Scan(writer.path).run().whole
