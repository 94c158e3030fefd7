"""Which messages enter the bag of a run, and how they are answered."""

import errno
import os
import time
from pathlib import Path

import numpy as np
import pytest
import recording
from hypothesis import given, settings
from hypothesis import strategies as st

from bow_sim.physics.errors import ParameterError
from bow_sim.protocol import cdr
from bow_sim.protocol.states import PlanState, ReceiptKind
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sweep.record.bag import BagError, bag_files, messages
from bow_sweep.record.session import AlreadyClosedError, Session, log_name
from bow_sweep.record.topics import STORED_ONCE
from bow_sweep.record.verify import verify
from bow_sweep.run.lock import LockedError

SWEEP = recording.small_sweep()
CHUNK = recording.chunks(SWEEP, 1)[2]


def stored(run):
    """Return (topic, bytes) of all messages in the bag except plans and receipts."""
    return [(m.topic, bytes(m.data)) for m in messages(run / "bag") if m.topic not in ("plan", "receipts")]


def receipts(message):
    """Return the entries of a receipt as tuples."""
    values = cdr.decode("Receipt", message)
    return list(zip(*(values[n].tolist() for n in ("kind", "block", "chunk", "attempt", "checksum")), strict=True))


@pytest.fixture
def session(tmp_path):
    made = recording.session(tmp_path / "run", SWEEP)
    yield made
    made.abandon()


def take(session, topic, data):
    session.take(topic, data, time.time_ns())


def test_a_block_on_the_disk_is_receipted_again_until_the_plan_says_that_it_is_done(session):
    for chunk in recording.chunks(SWEEP, 1):
        for topic, data in chunk.items():
            take(session, topic, data)
    said = []
    deadline = time.monotonic() + 20
    while (ReceiptKind.BLOCK, 1, 0, 1, 0) not in said:
        assert time.monotonic() < deadline
        if message := session.commit(time.time_ns()):
            said += receipts(message)
    assert session.commit(time.time_ns()) is None
    session.repeat_receipts()
    assert receipts(session.commit(time.time_ns())) == [(ReceiptKind.BLOCK, 1, 0, 1, 0)]
    data = recording.plan(SWEEP, states=np.array([0, 1, 0], np.uint8))
    session.plan(cdr.decode("Plan", data), data, time.time_ns())
    session.repeat_receipts()
    assert session.commit(time.time_ns()) is None


def test_a_chunk_is_receipted_after_it_is_in_the_file(session, tmp_path):
    session.commit(time.time_ns())
    path = bag_files(tmp_path / "run" / "bag")[0]
    before = path.stat().st_size
    for topic, data in CHUNK.items():
        take(session, topic, data)
    assert path.stat().st_size == before
    message = session.commit(time.time_ns())
    assert path.stat().st_size > before + len(CHUNK.bridge_force)
    heads = [cdr.decode_head(STORED_ONCE[topic], data) for topic, data in CHUNK.items()]
    whole = cdr.chunk_checksum(1, 2, heads[0]["checksum"], heads[1]["checksum"])
    assert receipts(message) == [(0, 1, 2, 1, whole), (1, 1, 2, 1, heads[2]["checksum"])]


def test_a_receipt_lies_in_the_chunk_of_the_file_that_it_confirms(session, tmp_path):
    for topic, data in CHUNK.items():
        take(session, topic, data)
    session.commit(time.time_ns())
    session.abandon()  # killed now
    from bow_sweep.record.recover import recover

    recover(tmp_path / "run")
    assert [m.topic for m in messages(tmp_path / "run" / "bag")] == [
        "plan",
        "bridge_force",
        "stick_slip",
        "verdicts",
        "receipts",
    ]


def test_nothing_to_answer_nothing_to_say(session):
    assert session.commit(time.time_ns()) is None


def test_duplicates_are_answered_and_not_stored(session, tmp_path):
    second = recording.chunks(SWEEP, 1, attempt=2)[2]
    for chunk in (CHUNK, CHUNK, second):
        for topic, data in chunk.items():
            take(session, topic, data)
        answers = receipts(session.commit(time.time_ns()))
        assert [entry[:3] for entry in answers] == [(0, 1, 2), (1, 1, 2)]
        assert {entry[3] for entry in answers} == {2 if chunk is second else 1}
    recording.finish(session, SWEEP)
    assert stored(tmp_path / "run") == list(CHUNK.items())
    assert session.stored.duplicates == 6


def test_a_duplicate_that_differs_is_answered_with_the_stored_checksum_and_named(session, tmp_path):
    values = cdr.decode("BridgeForce", CHUNK.bridge_force)
    other = cdr.encode("BridgeForce", {**values, "attempt": 2, "data": values["data"] + 1})
    for data in (CHUNK.bridge_force, other):
        take(session, "bridge_force", data)
        take(session, "stick_slip", CHUNK.stick_slip)
    answers = receipts(session.commit(time.time_ns()))
    assert len({entry[4] for entry in answers}) == 1
    assert any("block 1, chunk 2, attempt 2 has checksum" in complaint for complaint in session.complaints)
    recording.finish(session, SWEEP)
    assert [topic for topic, _ in stored(tmp_path / "run")] == ["bridge_force", "stick_slip"]


def changed(topic, **fields):
    name = STORED_ONCE[topic]
    return cdr.encode(name, {**cdr.decode(name, getattr(CHUNK, topic)), **fields})


RUBBISH = {
    "another run": ("bridge_force", changed("bridge_force", run_id="f" * 16), "should be of run"),
    "another sweep": ("stick_slip", changed("stick_slip", sweep_id="f" * 16), "should be of run"),
    "no such block": ("bridge_force", changed("bridge_force", block=3), "the sweep has 3 blocks of 4 chunks"),
    "no such chunk": ("verdicts", changed("verdicts", chunk=4), "the sweep has 3 blocks of 4 chunks"),
    "cells of another block": ("bridge_force", changed("bridge_force", block=0), "not the 5 cells of block 0"),
    "too many samples": (
        "bridge_force",
        changed("bridge_force", samples=696, data=np.zeros((5, 696))),
        "696 samples from sample 1390 on, should be 695",
    ),
    "samples from elsewhere": (
        "stick_slip",
        changed("stick_slip", first_sample=0),
        "from sample 0 on, should be 695 from sample 1390 on",
    ),
    "data for other cells": ("bridge_force", changed("bridge_force", data=np.zeros(7)), "7 values for 5 cells"),
    "verdicts of another classifier": ("verdicts", changed("verdicts", classifier="?"), "classifier = '?'"),
    "a flipped bit": ("bridge_force", CHUNK.bridge_force[:-9] + b"\xff" + CHUNK.bridge_force[-8:], "does not hold"),
    "a message cut short": ("stick_slip", CHUNK.stick_slip[:100], ""),
    "nothing": ("verdicts", b"", "not with plain little-endian CDR"),
    "no map": ("basin_map", b"\x00\x01\x00\x00", ""),
    "an inspected cell of another run": ("inspect", recording.inspected(CHUNK, run_id="f" * 16), "this is run"),
}


@pytest.mark.parametrize("what", RUBBISH)
def test_what_does_not_belong_is_counted_and_ignored(session, tmp_path, what):
    topic, data, why = RUBBISH[what]
    take(session, topic, data)
    assert session.ignored == 1
    assert why in str(next(iter(session.complaints)))
    assert session.commit(time.time_ns()) is None
    recording.finish(session, SWEEP)
    assert stored(tmp_path / "run") == []


@pytest.fixture(scope="module")
def fuzzed(tmp_path_factory):
    made = recording.session(tmp_path_factory.mktemp("fuzz") / "run", SWEEP)
    yield made
    made.abandon()


def flipped(at, bit, size):
    """Return the slips of a chunk with one bit changed, or cut short, or both."""
    data = bytearray(CHUNK.stick_slip[:size])
    data[min(at, size - 1)] ^= 1 << bit
    return bytes(data)


@settings(max_examples=400, deadline=None)
@given(
    topic=st.sampled_from(["bridge_force", "stick_slip", "verdicts", "basin_map", "inspect"]),
    data=st.binary(max_size=300)
    | st.builds(flipped, st.integers(0, 200), st.integers(0, 7), st.integers(1, len(CHUNK.stick_slip))),
)
def test_rubbish_is_counted_whatever_it_is(fuzzed, topic, data):
    before = fuzzed.ignored
    take(fuzzed, topic, data)
    changed_bytes = [
        place for place, pair in enumerate(zip(data, CHUNK.stick_slip, strict=False)) if pair[0] != pair[1]
    ]
    if not (len(data) == len(CHUNK.stick_slip) and changed_bytes[0] in UNSEALED):
        assert fuzzed.ignored == before + 1


RUN_ID = 4 + 8 + 4 + 4
"""Offset of the run: after encapsulation, stamp and frame_id."""

ATTEMPT = RUN_ID + 4 + 17 + 3 + 4 + 17 + 3 + 8
"""Offset of the attempt: after two strings of 16 characters, block and chunk."""

PADDING = {*range(RUN_ID + 21, RUN_ID + 24), *range(RUN_ID + 45, RUN_ID + 48), *range(ATTEMPT + 25, ATTEMPT + 32)}
"""Padding after a string, up to the next aligned field: CDR leaves its bytes open."""

UNSEALED = {2, 3} | PADDING | {*range(4, RUN_ID)} | {*range(ATTEMPT, ATTEMPT + 4), *range(ATTEMPT + 8, ATTEMPT + 24)}
"""Options and padding of CDR, which readers ignore; header, attempt and incarnation, which the checksum leaves out."""


@pytest.mark.parametrize("bit", [0, 7])
def test_every_byte_that_says_something_of_the_chunk_is_checked(fuzzed, bit):
    size = len(CHUNK.stick_slip)
    accepted = set()
    for place in range(size):
        before = fuzzed.ignored
        take(fuzzed, "stick_slip", flipped(place, bit, size))
        if fuzzed.ignored == before:
            accepted.add(place)
    assert accepted <= UNSEALED
    assert accepted >= PADDING


def test_cells_under_inspection_and_maps_are_recorded_as_they_come(session, tmp_path):
    shown = recording.inspected(CHUNK)
    for _ in range(2):
        take(session, "inspect", shown)
    recording.finish(session, SWEEP)
    assert stored(tmp_path / "run") == [("inspect", shown)] * 2


def test_a_session_goes_on_in_the_next_file_and_knows_what_is_stored(tmp_path):
    run = tmp_path / "run"
    first = recording.session(run, SWEEP)
    for topic, data in CHUNK.items():
        take(first, topic, data)
    first.commit(time.time_ns())
    take(first, "bridge_force", recording.chunks(SWEEP, 0)[0].bridge_force)
    first.abandon()  # killed: the last message was not in the file

    second = recording.session(run, SWEEP, epoch=2)
    for topic, data in CHUNK.items():
        take(second, topic, data)
    assert [entry[:3] for entry in receipts(second.commit(time.time_ns()))] == [(0, 1, 2), (1, 1, 2)]
    for topic, data in recording.chunks(SWEEP, 0)[0].items():
        take(second, topic, data)
    recording.finish(second, SWEEP, epoch=2)
    assert [path.name for path in bag_files(run / "bag")] == ["bag_0.mcap", "bag_1.mcap"]
    assert stored(run) == [*CHUNK.items(), *recording.chunks(SWEEP, 0)[0].items()]
    assert [m.sequence for m in messages(run / "bag")] == list(range(1, len(list(messages(run / "bag"))) + 1))


def test_a_run_that_is_closed_stays_closed_until_it_is_opened_again(tmp_path):
    run = tmp_path / "run"
    recording.record(run, SWEEP)
    closing = recording.plan(SWEEP, PlanState.CLOSED)
    with pytest.raises(AlreadyClosedError):
        Session(run, cdr.decode("Plan", closing), closing, "7" * 16, 0)
    again = recording.session(run, SWEEP, epoch=2)
    recording.finish(again, SWEEP, epoch=2)
    assert len(bag_files(run / "bag")) == 2


def test_two_recorders_do_not_write_one_bag(session, tmp_path):
    with pytest.raises(LockedError):
        recording.session(tmp_path / "run", SWEEP)


def test_a_directory_of_another_run_is_refused(tmp_path, recorded):
    data = recording.plan(SWEEP, run="f" * 16)
    size = sum(path.stat().st_size for path in (recorded / "bag").iterdir())
    with pytest.raises(BagError, match="it needs a directory of its own"):
        Session(recorded, cdr.decode("Plan", data), data, "7" * 16, 0)
    assert sum(path.stat().st_size for path in (recorded / "bag").iterdir()) == size


def test_a_damaged_bag_is_mended_and_continued_and_lacks_only_what_was_damaged(run):
    path = bag_files(run / "bag")[0]
    content = bytearray(path.read_bytes())
    content[[m.offset for m in messages(run / "bag") if m.topic == "stick_slip"][5] + 50] ^= 1
    path.write_bytes(content)
    before = len(list(recording.everything(SWEEP)))
    again = recording.session(run, SWEEP, epoch=2)
    assert before // 2 < len(again.stored) < before
    for topic, data in recording.everything(SWEEP, attempt=2):
        take(again, topic, data)
    recording.finish(again, SWEEP, epoch=2)
    (damage,) = again.report["files"][0]["damage"]
    (aside,) = again.report["files"][0]["aside"]
    assert Path(aside).read_bytes() == content[damage["start"] : damage["end"]]
    assert verify(run)["ok"]


def test_after_a_full_disk_the_bag_holds_what_was_committed_and_can_go_on(tmp_path, monkeypatch):
    run = tmp_path / "run"
    first = recording.session(run, SWEEP)
    for topic, data in CHUNK.items():
        take(first, topic, data)
    first.commit(time.time_ns())
    for topic, data in recording.chunks(SWEEP, 0)[0].items():
        take(first, topic, data)

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "writev", full)
    with pytest.raises(OSError, match="No space"):
        first.commit(time.time_ns())
    with pytest.raises(OSError, match="No space"):
        first.close(time.time_ns())
    monkeypatch.undo()
    second = recording.session(run, SWEEP, epoch=2)
    assert second.report["files"][0]["was"] == "torn"
    assert len(second.stored) == 3
    recording.finish(second, SWEEP, epoch=2)
    assert stored(run) == list(CHUNK.items())


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ({"run_id": "../../etc"}, "run_id = '../../etc': should be 16 hexadecimal digits"),
        ({"run_id": ""}, "should be 16 hexadecimal digits"),
        ({"sweep_id": "x"}, "sweep_id = 'x'"),
        ({"spec.settings": ["x.count=4", "y.count=3"]}, "block_cells"),
        ({"spec.settings": ["x.count=4000000000", "y.count=3", "block_cells=1"]}, "should be 1 ... 4194304"),
        ({"spec.settings": ["x.count=4", "y.count=3", "block_cells=0"]}, "block_cells = 0"),
        ({"spec.settings": ["x.count=4", "y.count=3", "block_cells=4", "v_mid=nan"]}, "v_mid"),
        ({"spec.settings": ["rubbish"]}, "name=value"),
    ],
)
def test_a_plan_that_cannot_be_is_refused_before_anything_is_written(fields, why):
    with pytest.raises(ParameterError, match=why):
        SweepOutline.of({**cdr.decode("Plan", recording.plan(SWEEP)), **fields})


def test_the_outline_of_a_run_is_that_of_its_plan():
    expected = SweepOutline.of(cdr.decode("Plan", recording.plan(SWEEP)))
    assert (expected.run_id, expected.sweep_id) == (recording.RUN, SWEEP.sweep_id)
    assert expected.classifier == SWEEP.thresholds.hash
    assert (expected.shape, expected.cells) == ((SWEEP.y.count, SWEEP.x.count), SWEEP.cells)
    assert (expected.chunks, expected.chunk_samples) == (SWEEP.chunks, SWEEP.parameters.chunk_samples)
    assert expected.blocks == SWEEP.blocks
    for block in range(SWEEP.blocks):
        assert np.array_equal(expected.block(block), SWEEP.block(block))


def test_the_head_of_a_message_is_what_wire_reads():
    for topic, data in CHUNK.items():
        name = STORED_ONCE[topic]
        values = cdr.decode(name, data)
        head = cdr.decode_head(name, data)
        identity = [*cdr.Identity._fields, "incarnation", "checksum"]
        assert list(head) == [*(field for field in values if "stamp" in field or "frame_id" in field), *identity]
        assert head == {field: values[field] for field in head}


def test_the_logger_of_a_log_message_is_read_without_ros():
    from rcl_interfaces.msg import Log
    from rclpy.serialization import serialize_message

    assert log_name(serialize_message(Log(name="bow.run.recorder", msg="hello"))) == "bow.run.recorder"
    assert log_name(b"") == log_name(bytes(30)) == ""
