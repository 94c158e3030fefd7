"""`bow verify`: everything recorded is checked, and every change of it is found."""

import json
import time

import numpy as np
import pytest
import recording
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bow_sim.protocol import cdr
from bow_sweep.record.bag import METADATA, bag_files, messages
from bow_sweep.record.mcap_reader import Scan
from bow_sweep.record.mcap_writer import McapWriter
from bow_sweep.record.metadata import FileInfo, render
from bow_sweep.record.topics import STORED_ONCE
from bow_sweep.record.verify import verify

SWEEP = recording.small_sweep()


def test_a_recorded_sweep_is_accounted_for_to_the_last_sample(recorded):
    calls = []
    result = verify(recorded, progress=lambda done, total: calls.append(done / total))
    assert result["ok"], recording.whats(result)
    assert result["cells"] == result["cells_planned"] == 12
    assert result["chunks"] == result["verdicts_equal"] == 12
    assert result["samples"] == 12 * 20 * 139
    assert result["quarantined_blocks"] == []
    assert json.loads(json.dumps(result)) == result
    assert calls == sorted(calls)
    assert calls[-1] == 1.0


def test_a_bag_alone_can_be_verified(recorded):
    assert verify(recorded / "bag")["ok"]


@settings(max_examples=80, deadline=None)
@given(place=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
@example(place=0.0, bit=0)
@example(place=0.9999999, bit=7)
def test_every_changed_byte_of_the_bag_is_seen(recorded, place, bit):
    path = bag_files(recorded / "bag")[0]
    content = path.read_bytes()
    changed = bytearray(content)
    changed[int(place * len(content))] ^= 1 << bit
    try:
        path.write_bytes(changed)
        result = verify(recorded)
    finally:
        path.write_bytes(content)
    assert not result["ok"]
    assert result["problems"][0]["what"]
    json.dumps(result)


@pytest.mark.parametrize("part", ["header", "chunk", "index", "data end", "summary", "footer", "magic"])
def test_a_changed_byte_is_seen_in_every_part_of_a_file(run, part):
    path = bag_files(run / "bag")[0]
    scan = Scan(path).run()
    chunk = scan.contents.chunks[2]
    size = path.stat().st_size
    place = {
        "header": 20,
        "chunk": chunk.chunk_start_offset + 3000,
        "index": chunk.chunk_start_offset + chunk.chunk_length + 20,
        "data end": scan.good_end + 10,
        "summary": scan.good_end + 500,
        "footer": size - 20,
        "magic": size - 3,
    }[part]
    content = bytearray(path.read_bytes())
    content[place] ^= 0x10
    path.write_bytes(content)
    result = verify(run)
    assert not result["ok"]
    named = [problem for problem in result["problems"] if "bytes" in problem and problem["file"] == "bag_0.mcap"]
    assert any(problem["bytes"][0] <= place for problem in named)


def test_a_changed_byte_of_the_metadata_is_seen(run):
    path = run / "bag" / METADATA
    content = path.read_bytes()
    for place in range(0, content.index(b"  custom_data"), 97):  # what follows has no meaning for the bag
        changed = bytearray(content)
        changed[place] ^= 1
        path.write_bytes(changed)
        assert not verify(run)["ok"], f"byte {place}"
    path.unlink()
    assert "cannot be read" in recording.whats(verify(run))


def rewritten(run, keep, renumber):
    """Write the bag again, with right checksums and the messages that `keep` selects."""
    path = bag_files(run / "bag")[0]
    scan = Scan(path)
    found = list(scan.messages())
    names = {number: channel.topic for number, channel in scan.contents.channels.items()}
    path.unlink()
    writer = McapWriter(path, scan.contents.schemas.values(), scan.contents.channels.values(), scan.notes)
    kept = [m for n, m in enumerate(found) if keep(n, names[m.channel].rpartition("/")[2])]
    for number, message in enumerate(kept, 1):
        sequence = number if renumber else message.sequence
        writer.add(message.channel, sequence, message.log_time, message.publish_time, message.data)
        writer.commit()
    writer.finish()
    (run / "bag" / METADATA).write_text(render([FileInfo.of(path.name, writer.contents)]))
    return found, kept


def test_a_bag_written_again_in_other_chunks_still_holds(run):
    rewritten(run, lambda n, topic: True, renumber=False)
    assert verify(run)["ok"]


def test_a_message_that_is_cut_out_is_missed(recorded, tmp_path):
    total = len(list(messages(recorded / "bag")))
    for cut in range(total):
        run = tmp_path / str(cut)
        recording.copy(recorded, run)
        rewritten(run, lambda n, topic, cut=cut: n != cut, renumber=False)
        assert not verify(run)["ok"], f"message {cut} of {total}"


@pytest.mark.parametrize("topic", ["bridge_force", "stick_slip", "verdicts", "receipts", "plan"])
@pytest.mark.parametrize("which", [0, -1])
def test_a_message_that_is_cut_out_is_missed_even_where_the_rest_is_numbered_anew(run, topic, which):
    rewritten(run, lambda n, name: True, renumber=True)
    assert verify(run)["ok"]
    places = [n for n, message in enumerate(messages(run / "bag")) if message.topic == topic]
    rewritten(run, lambda n, name: n != places[which], renumber=True)
    result = verify(run)
    assert not result["ok"]
    if topic not in ("plan", "receipts"):
        missing = next(problem for problem in result["problems"] if problem["what"] == "missing")
        assert missing["run"] == recording.RUN
        assert missing["topics"] == [topic]
        assert (missing["block"], missing["chunk"]) == ((0, 0) if which == 0 else (2, 3))


def test_a_message_that_is_doubled_or_moved_is_seen(run):
    found, _ = rewritten(run, lambda n, topic: True, renumber=False)
    path = bag_files(run / "bag")[0]
    for order in ([0, 1, 2, 3, 3, *range(4, len(found))], [0, 2, 1, *range(3, len(found))]):
        scan = Scan(path).run()
        path.unlink()
        writer = McapWriter(path, scan.contents.schemas.values(), scan.contents.channels.values(), scan.notes)
        for n in order:
            writer.add(found[n].channel, found[n].sequence, found[n].log_time, found[n].publish_time, found[n].data)
        writer.finish()
        (run / "bag" / METADATA).write_text(render([FileInfo.of(path.name, writer.contents)]))
        result = verify(run)
        assert "some are missing or moved" in recording.whats(result)
        assert ("stored twice" in recording.whats(result)) == (len(order) > len(found))


def altered(tmp_path, **changes):
    """Record the sweep with changed fields in the messages of block 1, chunk 2; their checksums are right."""
    run = tmp_path / "altered"
    session = recording.session(run, SWEEP)
    for topic, data in recording.everything(SWEEP):
        name = STORED_ONCE[topic]
        values = cdr.decode(name, data)
        if (values["block"], values["chunk"]) == (1, 2) and topic in changes:
            data = cdr.encode(name, {**values, **changes[topic](values)})  # noqa: PLW2901
        session.take(topic, data, time.time_ns())
    recording.finish(session, SWEEP)
    return run


def test_verdicts_that_do_not_follow_from_the_streams_are_named(tmp_path):
    result = verify(altered(tmp_path, verdicts=lambda v: {"corners": v["corners"] + 1, "regime": 0 * v["regime"] + 5}))
    assert not result["ok"]
    problem = next(p for p in result["problems"] if "derived again" in p["what"])
    assert (problem["run"], problem["block"], problem["chunk"]) == (recording.RUN, 1, 2)
    assert "corners, regime" in problem["what"]
    assert result["verdicts_equal"] == 11


def test_streams_that_are_not_those_that_were_judged_are_named(tmp_path):
    result = verify(altered(tmp_path, bridge_force=lambda v: {"data": v["data"] * np.float32(1.01)}))
    problem = next(p for p in result["problems"] if p["what"].startswith("the verdicts are on chunk"))
    assert (problem["block"], problem["chunk"]) == (1, 2)


def test_slips_that_do_not_continue_the_chunk_before_are_named(tmp_path):
    result = verify(altered(tmp_path, stick_slip=lambda v: {"slipping": 1 - v["slipping"]}))
    assert "block 1, chunk 2: the classifier does not take it" in recording.whats(result)


def test_an_unfinished_run_says_what_is_outstanding(tmp_path):
    run = tmp_path / "run"
    session = recording.session(run, SWEEP)
    for chunk in recording.chunks(SWEEP, 0):
        for topic, data in chunk.items():
            session.take(topic, data, time.time_ns())
    session.close(time.time_ns())
    result = verify(run)
    assert not result["ok"]
    assert "the last plan is open" in recording.whats(result)
    assert [p["block"] for p in result["problems"] if p["what"].startswith("outstanding")] == [0, 1, 2]


def test_a_torn_bag_says_how_to_repair_it(run):
    path = bag_files(run / "bag")[0]
    path.write_bytes(path.read_bytes()[:-3])
    assert "`bow recover` repairs it" in recording.whats(verify(run))


def test_a_quarantined_block_is_named_and_the_rest_is_accounted_for(tmp_path):
    recording.quarantined_run(tmp_path / "run")
    result = verify(tmp_path / "run")
    assert result["ok"], recording.whats(result)
    assert result["quarantined_blocks"] == [1]
    assert (result["cells"], result["cells_quarantined"], result["cells_planned"]) == (7, 5, 12)


def test_what_is_no_run_is_said_to_be_none(tmp_path):
    result = verify(tmp_path)
    assert not result["ok"]
    assert "holds no bag" in recording.whats(result)
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "bag_0.mcap").write_bytes(b"rubbish")
    result = verify(tmp_path)
    assert not result["ok"]
    assert "the bag holds no plan" in recording.whats(result)
