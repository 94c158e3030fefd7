"""Our files are valid MCAP: the readers of the mcap package check every CRC; and our scan finds all damage."""

import io
import os
import zlib
from itertools import cycle

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Channel, DataEnd, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType, Writer

from bow_sweep.record import mcap_writer
from bow_sweep.record.mcap_reader import Scan
from bow_sweep.record.mcap_writer import McapWriter, write_all

SCHEMAS = [Schema(id=1, name="pkg/msg/Thing", encoding="ros2msg", data=b"uint8 x\n")]
CHANNELS = [
    Channel(id=number, topic=topic, message_encoding="cdr", schema_id=1, metadata={"a": "b"})
    for number, topic in ((1, "/one"), (2, "/two"))
]


def write(path, messages, commit_every=3):
    writer = McapWriter(path, SCHEMAS, CHANNELS)
    for number, data in enumerate(messages, 1):
        writer.add(1 + number % 2, number, 1000 + number, 900 + number, data)
        if number % commit_every == 0:
            writer.commit()
    writer.finish()


@pytest.mark.parametrize("sizes", [[], [0], [1], [10, 0, 100_000, 3], [7] * 1000])
def test_mcaps_own_readers_give_the_messages_back(tmp_path, sizes):
    data = [os.urandom(size) for size in sizes]
    write(tmp_path / "a.mcap", data, commit_every=600)
    with open(tmp_path / "a.mcap", "rb") as file:
        records = list(StreamReader(file, validate_crcs=True).records)
    assert records[0].profile == "ros2"
    with open(tmp_path / "a.mcap", "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        found = list(reader.iter_messages(log_time_order=True))
    assert [bytes(message.data) for _, _, message in found] == data
    assert [message.sequence for _, _, message in found] == list(range(1, len(data) + 1))
    assert summary.statistics.message_count == len(data)
    assert {c.topic for c in summary.channels.values()} == {"/one", "/two"}


def test_the_index_finds_the_messages_of_a_topic(tmp_path):
    write(tmp_path / "a.mcap", [bytes([n]) for n in range(20)])
    with open(tmp_path / "a.mcap", "rb") as file:
        found = [m.sequence for _, _, m in make_reader(file).iter_messages(topics=["/one"], starting_at=1005)]
    assert found == [6, 8, 10, 12, 14, 16, 18, 20]


def test_a_scan_gives_the_messages_and_where_they_lie(tmp_path):
    data = [os.urandom(size) for size in (5, 0, 4000, 12)]
    write(tmp_path / "a.mcap", data)
    scan = Scan(tmp_path / "a.mcap")
    found = list(scan.messages())
    content = (tmp_path / "a.mcap").read_bytes()
    assert scan.whole
    assert [bytes(m.data) for m in found] == data
    assert [content[m.offset : m.offset + len(m.data)] for m in found] == data
    assert [(m.log_time, m.publish_time) for m in found] == [(1000 + n, 900 + n) for n in range(1, 5)]


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunked", [True, False])
def test_files_of_other_writers_are_read_too(tmp_path, compression, chunked):
    with open(tmp_path / "a.mcap", "wb") as file:
        writer = Writer(file, chunk_size=300, compression=compression, use_chunking=chunked, enable_data_crcs=True)
        writer.start("ros2", "somebody")
        schema = writer.register_schema("a", "ros2msg", b"")
        channel = writer.register_channel("/a", "cdr", schema)
        for number in range(50):
            writer.add_message(channel, number, bytes([number]) * 40, number, number)
        writer.add_attachment(1, 1, "note", "text/plain", b"hello")
        writer.add_metadata("more", {"k": "v"})
        writer.finish()
    scan = Scan(tmp_path / "a.mcap")
    assert [bytes(m.data) for m in scan.messages()] == [bytes([n]) * 40 for n in range(50)]
    assert scan.damage == []
    assert scan.finished


def test_a_file_without_message_index_is_read_too(tmp_path):
    stream = io.BytesIO()
    writer = Writer(stream, compression=CompressionType.NONE, index_types=IndexType.CHUNK)
    writer.start("ros2", "somebody")
    channel = writer.register_channel("/a", "cdr", writer.register_schema("a", "ros2msg", b""))
    writer.add_message(channel, 1, b"data", 1)
    writer.finish()
    (tmp_path / "a.mcap").write_bytes(stream.getvalue())
    assert Scan(tmp_path / "a.mcap").run().whole


def test_a_commit_that_the_disk_refuses_leaves_the_file_as_it_was(tmp_path, monkeypatch):
    writer = McapWriter(tmp_path / "a.mcap", SCHEMAS, CHANNELS)
    writer.add(1, 1, 1, 1, b"first")
    writer.commit()
    size = (tmp_path / "a.mcap").stat().st_size
    writer.add(1, 2, 2, 2, bytes(100_000))

    true_writev = os.writev

    def half(descriptor, parts):
        if sum(map(len, parts)) > 50_000:
            return true_writev(descriptor, [b"".join(parts)[:50_000]])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "writev", half)
    with pytest.raises(OSError, match="No space"):
        writer.commit()
    monkeypatch.undo()
    assert (tmp_path / "a.mcap").stat().st_size == size
    writer.finish()  # the disk has room again: nothing was lost
    assert [bytes(m.data) for m in Scan(tmp_path / "a.mcap").messages()] == [b"first", bytes(100_000)]


@settings(max_examples=60, deadline=None)
@given(sizes=st.lists(st.integers(0, 300), max_size=12), commit_every=st.integers(1, 5))
def test_the_crc_of_the_data_section_is_that_of_its_bytes(tmp_path_factory, sizes, commit_every):
    path = tmp_path_factory.mktemp("crc") / "a.mcap"
    write(path, [os.urandom(size) for size in sizes], commit_every)
    content = path.read_bytes()
    with open(path, "rb") as file:
        (record,) = (record for record in StreamReader(file).records if isinstance(record, DataEnd))
    section, _, _ = content.rpartition(mcap_writer.pack(record))
    assert record.data_section_crc == zlib.crc32(section)


@settings(max_examples=100, deadline=None)
@given(
    sizes=st.lists(st.integers(0, 40), max_size=20),
    offset=st.integers(0, 50),
    shorter=st.lists(st.integers(1, 16), min_size=1, max_size=5),
)
def test_pieces_end_at_multiples_and_nothing_is_lost_where_less_is_written_than_asked_for(
    tmp_path_factory, sizes, offset, shorter
):
    path = tmp_path_factory.mktemp("pieces") / "file"
    path.write_bytes(bytes(offset))
    parts = [os.urandom(size) for size in sizes]
    ends, most = [], cycle(shorter)
    true_writev = os.writev

    def writev(descriptor, piece):
        data = b"".join(piece)
        ends.append(os.lseek(descriptor, 0, os.SEEK_CUR) + len(data))
        return true_writev(descriptor, [data[: next(most)]])

    with pytest.MonkeyPatch.context() as patch, open(path, "r+b") as file:
        patch.setattr(mcap_writer, "PIECE", 16)
        patch.setattr(mcap_writer, "_MAX_PARTS", 3)
        patch.setattr(os, "writev", writev)
        os.lseek(file.fileno(), offset, os.SEEK_SET)
        write_all(file.fileno(), parts, offset)
        for at, end in zip([offset, *ends], ends, strict=False):
            assert end <= (at // 16 + 1) * 16
    assert path.read_bytes() == bytes(offset) + b"".join(parts)


def test_large_messages_are_named_by_their_place_once_they_are_committed(tmp_path):
    writer = McapWriter(tmp_path / "a.mcap", SCHEMAS, CHANNELS)
    small, large = os.urandom(mcap_writer.BULK - 1), [os.urandom(mcap_writer.BULK + n) for n in range(2)]
    for number, data in enumerate((large[0], small, large[1])):
        writer.add(1, number, number, number, data)
    assert writer.take_bulk() == []
    writer.commit()
    places = writer.take_bulk()
    content = (tmp_path / "a.mcap").read_bytes()
    assert [content[first:end] for first, end in places] == [data[mcap_writer.HEAD :] for data in large]
    assert writer.take_bulk() == []
    writer.abandon()


def test_a_file_that_is_there_is_not_overwritten(tmp_path):
    write(tmp_path / "a.mcap", [b"x"])
    with pytest.raises(FileExistsError):
        McapWriter(tmp_path / "a.mcap", SCHEMAS, CHANNELS)


def test_every_flipped_byte_is_damage(tmp_path):
    path = tmp_path / "a.mcap"
    write(path, [os.urandom(size) for size in (30, 0, 200, 7, 60)], commit_every=2)
    content = path.read_bytes()
    for position in range(len(content)):
        changed = bytearray(content)
        changed[position] ^= 1 << position % 8
        path.write_bytes(changed)
        scan = Scan(path).run()
        assert scan.damage or not scan.finished, f"byte {position} of {len(content)}"


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    """Two small files, one of ours and a compressed one of another writer, and a folder for changed ones."""
    folder = tmp_path_factory.mktemp("sample")
    write(folder / "ours.mcap", [os.urandom(size) for size in (30, 0, 200, 7, 60)], commit_every=2)
    with open(folder / "other.mcap", "wb") as file:
        writer = Writer(file, chunk_size=300, enable_data_crcs=True)
        writer.start("ros2", "somebody")
        channel = writer.register_channel("/a", "cdr", writer.register_schema("a", "ros2msg", b""))
        for number in range(50):
            writer.add_message(channel, number, os.urandom(20), number)
        writer.finish()
    return folder


@settings(max_examples=300, deadline=None)
@given(
    name=st.sampled_from(["ours", "other"]),
    splices=st.lists(st.tuples(st.floats(0, 1), st.integers(0, 60), st.binary(max_size=60)), max_size=4),
    end=st.floats(0, 1) | st.just(1.0),
)
def test_whatever_the_bytes_are_a_scan_comes_to_an_end_and_says_so(sample, name, splices, end):
    whole = (sample / f"{name}.mcap").read_bytes()
    content = whole
    for place, length, data in splices:
        at = int(place * len(content))
        content = content[:at] + data + content[at + length :]
    content = content[: int(end * len(content))]
    (sample / "changed.mcap").write_bytes(content)
    scan = Scan(sample / "changed.mcap").run()
    assert scan.whole == (content == whole)
