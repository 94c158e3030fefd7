"""A bag whose writer was killed: complete chunks are kept, the rest is reported."""

import json
import shutil
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from bow_sweep.cli import main
from bow_sweep.record.bag import METADATA, BagError, messages
from bow_sweep.record.mcap_reader import Scan
from bow_sweep.record.recover import recover
from bow_sweep.run.lock import LockedError, locked


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
def test_a_wrong_byte_before_the_end_costs_the_chunk_it_is_in_and_nothing_else(run, torn):
    path = bag_file(run)
    content = bytearray(path.read_bytes())
    whole = list(messages(run / "bag"))
    ends = ends_of_chunks(path)
    at = ends[1] - 100
    content[at] ^= 4
    if torn:
        del content[ends[4] + 100 :]
    path.write_bytes(content)
    report = recover(run)
    assert report["ok"]
    (file,) = report["files"]
    assert (file["was"], file["did"]) == ("damaged", "mend")
    (damage,) = file["damage"]
    assert damage["start"] <= at < damage["end"]
    assert Path(file["aside"][0]).read_bytes() == content[damage["start"] : damage["end"]]
    kept = [m.sequence for m in messages(run / "bag")]
    lost = {m.sequence for m in whole if damage["start"] <= m.offset < damage["end"]}
    there = [m.sequence for m in whole if not torn or m.offset < ends[4]]
    assert kept == [number for number in there if number not in lost]
    assert report["missing"] == [[min(lost), max(lost)]]
    with open(path, "rb") as stream:
        assert [m.sequence for _, _, m in make_reader(stream, validate_crcs=True).iter_messages()] == kept
    assert recover(run)["files"][0]["was"] == "whole"


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
    assert len(Scan(path).run().contents.chunks) == 4


TAILS = {
    "zeros": bytes(4096),
    "one zero": b"\0",
    "garbage": bytes(range(256)) * 9,
    "text": b"lorem ipsum " * 100,
    "what looks like a private record": b"\x81" + bytes(500),
    "magic": b"\x89MCAP0\r\n",
}


@pytest.mark.parametrize("finished", [False, True])
@pytest.mark.parametrize("name", TAILS)
def test_whatever_comes_after_the_last_whole_chunk_is_set_aside(run, name, finished):
    path = bag_file(run)
    whole = path.read_bytes()
    before = list(messages(run / "bag"))
    if not finished:
        chunk = Scan(path).run().contents.chunks[-1]
        whole = whole[: chunk.chunk_start_offset + chunk.chunk_length + chunk.message_index_length]
    path.write_bytes(whole + TAILS[name])
    report = recover(run)
    assert report["ok"]
    assert report["files"][0]["did"] == "mend"
    assert [m.sequence for m in messages(run / "bag")] == [m.sequence for m in before]
    assert Path(report["files"][0]["aside"][-1]).read_bytes().endswith(TAILS[name])
    assert recover(run)["files"][0]["was"] == "whole"


@pytest.mark.parametrize("part", ["index", "data end", "summary", "footer", "magic"])
def test_what_can_be_derived_from_the_data_is_written_again(run, part):
    path = bag_file(run)
    scan = Scan(path).run()
    chunk = scan.contents.chunks[2]
    content = path.read_bytes()
    place = {
        "index": chunk.chunk_start_offset + chunk.chunk_length + 20,
        "data end": scan.good_end + 10,
        "summary": scan.good_end + 500,
        "footer": len(content) - 20,
        "magic": len(content) - 3,
    }[part]
    changed = bytearray(content)
    changed[place] ^= 0x10
    path.write_bytes(changed)
    assert recover(run)["ok"]
    assert path.read_bytes() == content


def test_a_file_whose_head_is_gone_is_set_aside_whole(run):
    path = bag_file(run)
    content = bytearray(path.read_bytes())
    content[:4096] = bytes(4096)
    path.write_bytes(content)
    report = recover(run)
    assert (report["ok"], report["files"][0]["did"]) == (True, "set aside")
    assert not path.exists()
    assert Path(report["files"][0]["aside"][0]).read_bytes() == content


@pytest.mark.parametrize("number", [1, 7])
def test_a_copy_of_a_file_is_set_aside(run, number):
    path = bag_file(run)
    shutil.copy(path, path.with_name(f"bag_{number}.mcap"))
    files = recover(run)["files"]
    assert [(file["was"], file["did"]) for file in files] == [("whole", "keep"), ("misplaced", "set aside")]
    assert "a copy or an older version" in files[1]["why"]


def test_a_dry_run_says_the_same_and_changes_nothing(run):
    path = bag_file(run)
    content = bytearray(path.read_bytes() + bytes(100))
    content[ends_of_chunks(path)[1] - 100] ^= 4
    path.write_bytes(content)
    shutil.copy(path, path.with_name("bag_3.mcap"))
    before = {file: file.read_bytes() for file in run.rglob("*") if file.is_file()}
    said = recover(run, dry_run=True)
    assert {file: file.read_bytes() for file in run.rglob("*") if file.is_file()} == before
    done = recover(run)
    for one, other in zip(said["files"], done["files"], strict=True):
        assert {**one, "aside": []} == {**other, "aside": []}
    assert [len(file["aside"]) for file in done["files"]] == [2, 1]


def test_a_whole_bag_of_others_is_not_touched_whatever_its_metadata_say(tmp_path):
    path = other_bag(tmp_path, CompressionType.ZSTD)
    metadata = path.with_name(METADATA)
    metadata.write_text("rosbag2_bagfile_information: {mine: 1}\n")
    before = path.read_bytes(), metadata.read_bytes()
    assert recover(tmp_path)["ok"]
    assert (path.read_bytes(), metadata.read_bytes()) == before


def test_a_bag_of_others_that_is_damaged_within_is_said_to_be_and_left(tmp_path):
    path = other_bag(tmp_path, CompressionType.NONE)
    content = bytearray(path.read_bytes())
    content[Scan(path).run().contents.chunks[1].chunk_start_offset + 100] ^= 1
    path.write_bytes(content)
    report = recover(tmp_path)
    assert (report["ok"], report["files"][0]["did"]) == (False, "refuse")
    assert path.read_bytes() == content


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize("zeros", [False, True])
def test_files_without_crcs_are_whole_and_torn_ones_are_repaired(tmp_path, compression, chunked, zeros):
    """rosbag2 writes zeros for CRCs by default: in MCAP that means that there is no CRC."""
    path = other_bag(tmp_path, compression, use_chunking=chunked, enable_crcs=False)
    scan = Scan(path).run()
    assert (scan.whole, scan.contents.messages) == (True, 50)
    content = path.read_bytes()
    path.write_bytes(content[: int(0.6 * scan.good_end)] + bytes(300 * (chunked and zeros)))
    report = recover(tmp_path)
    assert (report["ok"], report["files"][0]["was"]) == (True, "torn")
    with open(path, "rb") as file:
        found = [m.data for _, _, m in make_reader(file).iter_messages()]
    assert found == [bytes([n]) * 40 for n in range(len(found))]
    assert 20 < len(found) < 50


@pytest.mark.parametrize("compression", list(CompressionType))
def test_without_crcs_a_damaged_chunk_does_not_hide_those_after_it(tmp_path, compression):
    path = other_bag(tmp_path, compression, enable_crcs=False)
    chunks = Scan(path).run().contents.chunks
    content = bytearray(path.read_bytes())
    at = chunks[1].chunk_start_offset
    content[at : at + 60] = bytes(60)
    path.write_bytes(content)
    scan = Scan(path).run()
    assert next((damage.start, damage.end) for damage in scan.damage) == (at, chunks[2].chunk_start_offset)
    assert len(scan.contents.chunks) == len(chunks) - 1


def other_bag(directory, compression, **options):
    """Write a bag of another writer with 50 messages; return its file."""
    path = directory / "bag" / "other_0.mcap"
    path.parent.mkdir()
    with open(path, "wb") as file:
        writer = Writer(file, chunk_size=500, compression=compression, **options)
        writer.start("ros2", "somebody")
        channel = writer.register_channel("/a", "cdr", writer.register_schema("a/msg/A", "ros2msg", b""))
        for number in range(50):
            writer.add_message(channel, number, bytes([number]) * 40, number)
        writer.finish()
    return path


@pytest.mark.parametrize("compression", list(CompressionType))
def test_files_of_other_writers_are_repaired_too(tmp_path, compression):
    path = other_bag(tmp_path, compression)
    content = path.read_bytes()
    scan = Scan(path).run()
    path.write_bytes(content[: scan.contents.chunks[2].chunk_start_offset + 30])
    assert recover(tmp_path)["files"][0]["was"] == "torn"
    with open(path, "rb") as file:
        found = [m.data for _, _, m in make_reader(file, validate_crcs=True).iter_messages()]
    assert found == [bytes([n]) * 40 for n in range(len(found))]
    assert len(found) > 10


def test_a_bag_that_is_being_written_is_left_alone(run):
    with locked(run, "recorder"), pytest.raises(LockedError, match="at work on this run as its recorder"):
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


def test_the_command_prints_what_was_done_or_would_be(run, capsys):
    path = bag_file(run)
    path.write_bytes(path.read_bytes() + bytes(10))
    assert main(["recover", str(run), "--dry-run"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["dry_run"], said["files"][0]["was"], said["files"][0]["dropped_bytes"]) == (True, "torn", 10)
    assert main(["recover", str(run)]) == 0
    assert json.loads(capsys.readouterr().out)["files"][0]["aside"]
    assert main(["recover", str(run)]) == 0
    assert json.loads(capsys.readouterr().out)["files"][0]["did"] == "keep"
