"""A bag whose writer was killed: complete chunks are kept, the rest is said."""

import shutil

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from bow_sweep.record.bag import METADATA, BagError, messages
from bow_sweep.record.recover import LockedError, locked, recover
from bow_sweep.record.scan import Scan


def bag_file(run):
    return run / "bag" / "bag_0.mcap"


def ends_of_chunks(path):
    scan = Scan(path).run()
    return [(c.chunk_start_offset + c.chunk_length) for c in scan.contents.chunks]


def test_a_whole_bag_stays_as_it_is(run):
    before = bag_file(run).read_bytes()
    report = recover(run)
    assert report["ok"]
    assert [file["was"] for file in report["files"]] == ["whole"]
    assert not report["metadata_rewritten"]
    assert bag_file(run).read_bytes() == before


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(cut=st.floats(0, 1), data=st.data())
def test_a_bag_cut_anywhere_keeps_its_complete_chunks(recorded, tmp_path, cut, data):
    run = tmp_path / "cut"
    shutil.rmtree(run, ignore_errors=True)
    shutil.copytree(recorded, run)
    path = bag_file(run)
    content = path.read_bytes()
    ends = ends_of_chunks(path)
    near = [end + step for end in ends for step in (-1, 0, 1, 40)]
    size = data.draw(st.sampled_from([int(cut * (len(content) - 1)), *near]))
    whole = list(messages(run / "bag"))
    path.write_bytes(content[:size])
    report = recover(run)
    assert report["ok"]
    assert report["files"][0]["was"] == "torn"
    kept = list(messages(run / "bag"))
    complete = sum(end <= size for end in ends)
    assert Scan(path).run().whole
    assert [m.sequence for m in kept] == [m.sequence for m in whole[: len(kept)]]
    assert [bytes(m.data) for m in kept] == [bytes(m.data) for m in whole[: len(kept)]]
    assert len(Scan(path).run().contents.chunks) == complete
    again = path.read_bytes()
    assert recover(run)["files"][0]["was"] == "whole"
    assert path.read_bytes() == again
    with open(path, "rb") as file:
        assert make_reader(file, validate_crcs=True).get_summary().statistics.message_count == len(kept)


def test_dying_while_repairing_is_another_torn_file(run):
    path = bag_file(run)
    path.write_bytes(path.read_bytes()[: ends_of_chunks(path)[3] + 5])
    recover(run)
    repaired = path.read_bytes()
    path.write_bytes(repaired[:-40])
    recover(run)
    assert path.read_bytes() == repaired


def test_metadata_is_written_again(run):
    right = (run / "bag" / METADATA).read_bytes()
    (run / "bag" / METADATA).unlink()
    assert recover(run)["metadata_rewritten"]
    assert (run / "bag" / METADATA).read_bytes() == right


@pytest.mark.parametrize("torn", [False, True])
def test_a_wrong_byte_before_the_end_is_reported_and_nothing_is_dropped(run, torn):
    path = bag_file(run)
    content = bytearray(path.read_bytes())
    ends = ends_of_chunks(path)
    at = ends[1] - 100
    content[at] ^= 4
    if torn:
        del content[ends[4] + 100 :]
    path.write_bytes(content)
    report = recover(run)
    assert not report["ok"]
    assert report["files"][0]["was"] == "damaged"
    damage = report["files"][0]["damage"][0]
    assert damage["start"] <= at < damage["end"]
    assert path.read_bytes() == content


def test_a_wrong_length_in_the_middle_of_a_torn_file_does_not_drop_what_follows(run):
    path = bag_file(run)
    scan = Scan(path).run()
    start = scan.contents.chunks[1].chunk_start_offset
    content = bytearray(path.read_bytes()[: ends_of_chunks(path)[4] + 10])
    content[start + 6] ^= 0xFF  # the chunk's record now reaches past the end of the file
    path.write_bytes(content)
    report = recover(run)
    assert report["files"][0]["was"] == "damaged"
    assert report["files"][0]["damage"][0]["end"] == scan.contents.chunks[2].chunk_start_offset


@pytest.mark.parametrize("compression", list(CompressionType))
def test_files_of_other_writers_are_repaired_too(tmp_path, compression):
    path = tmp_path / "bag" / "other_0.mcap"
    path.parent.mkdir()
    with open(path, "wb") as file:
        writer = Writer(file, chunk_size=500, compression=compression)
        writer.start("ros2", "somebody")
        channel = writer.register_channel("/a", "cdr", writer.register_schema("a/msg/A", "ros2msg", b""))
        for number in range(50):
            writer.add_message(channel, number, bytes([number]) * 40, number)
        writer.finish()
    content = path.read_bytes()
    scan = Scan(path).run()
    path.write_bytes(content[: scan.contents.chunks[2].chunk_start_offset + 30])
    assert recover(tmp_path)["files"][0]["was"] == "torn"
    with open(path, "rb") as file:
        found = [m.data for _, _, m in make_reader(file, validate_crcs=True).iter_messages()]
    assert found == [bytes([n]) * 40 for n in range(len(found))]
    assert len(found) > 10


def test_a_bag_that_is_being_written_is_left_alone(run):
    with locked(run), pytest.raises(LockedError, match="a recorder is at work"):
        recover(run)


def test_what_is_no_bag_is_said_to_be_none(tmp_path):
    with pytest.raises(BagError, match="holds no bag"):
        recover(tmp_path)
    with pytest.raises(BagError, match="no directory"):
        recover(tmp_path / "nowhere")


def test_an_empty_file_becomes_an_empty_bag(run):
    bag_file(run).write_bytes(b"")
    assert recover(run)["ok"]
    assert list(messages(run / "bag")) == []
