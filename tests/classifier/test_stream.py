from __future__ import annotations

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kinematics import (
    SAMPLES_OF_STREAMS,
    Record,
    chunks,
    helmholtz,
    multiple_flyback,
    multiple_slip,
    silence,
    sticking_flybacks,
)
from outlines import outline

from bow_classifier import stream
from bow_classifier.block_classifier import BlockClassifier, Geometry
from bow_classifier.stream import FORCE, SLIP, Classifier
from bow_classifier.task import Task
from bow_classifier.verdict.regimes import REGIMES
from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.protocol import cdr

RUN, SWEEP, NEXT = "0123456789abcdef", "fedcba9876543210", "ffffffffffffffff"
CHUNKS = 5
SETTINGS = (
    "block_cells=2",
    "classifier.correlation=0.9",
    f"periods={5 * CHUNKS}",
    "x.count=3",
    "x.first=0.5",
    "x.last=20",
    "x.name=f_asym",
    "x.scale=log",
    "y.count=1",
    "y.first=0",
    "y.last=2",
    "y.name=f_init_ratio",
    "y.scale=linear",
)
TASK = Task.of(outline(RUN, SWEEP, SETTINGS))
RECORDS = {
    0: [helmholtz(SAMPLES_OF_STREAMS), multiple_slip(SAMPLES_OF_STREAMS)],
    1: [multiple_flyback(SAMPLES_OF_STREAMS, 3)],
}
BLOCKS = {block: chunks(records) for block, records in RECORDS.items()}


def message(name, chunk, block=0, attempt=1, content=None, **changes):
    """Return one stream message of the sweep."""
    force, intervals = content or BLOCKS[block][chunk]
    values = {
        "run_id": RUN,
        "sweep_id": SWEEP,
        "block": block,
        "chunk": chunk,
        "attempt": attempt,
        "incarnation": f"simulator {attempt}",
        "cells": TASK.outline.block(block % TASK.outline.blocks),
        "first_sample": chunk * 695,
        "samples": 695,
        "data": force,
        **intervals._asdict(),
        **changes,
    }
    return cdr.encode(name, values)


def plan(**changes):
    values = {
        "run_id": RUN,
        "sweep_id": SWEEP,
        "epoch": 1,
        "state": 1,
        "spec.preset": "",
        "spec.settings": SETTINGS,
        "fingerprint": "",
        "classifier": TASK.thresholds.hash,
        "block_states": [0, 0],
        "rounds": [],
        "incarnation": "c" * 16,
        **changes,
    }
    return cdr.encode("Plan", values)


def ready(incarnation="classifier"):
    classifier = Classifier(incarnation)
    classifier.plan(plan())
    assert not classifier.problem
    return classifier


def judged(out):
    """Return (block, chunk, attempt) of verdict messages, after checking their seals."""
    return [cdr.identity(cdr.unseal("Verdicts", data))[2:] for data in out]


def payloads(out):
    return {cdr.identity(v)[2:4]: v["checksum"] for v in (cdr.unseal("Verdicts", data) for data in out)}


def feed(classifier, *messages):
    return [out for name, data in messages for out in classifier.take(name, data)]


def test_verdicts_have_the_stamp_of_the_chunk_that_they_judge():
    stamps = {chunk: 10**18 + chunk for chunk in range(2)}
    classifier, out = ready(), []
    for chunk, at in stamps.items():
        stamped = {"stamp": at, "header.stamp": at}
        out += feed(classifier, *((name, message(name, chunk, **stamped)) for name in (FORCE, SLIP)))
    found = [cdr.unseal("Verdicts", data) for data in out]
    assert {values["chunk"]: values["header.stamp"] for values in found} == stamps
    assert {values["header.frame_id"] for values in found} == {"bow"}
    plain = feed(ready(), *((name, message(name, 0)) for name in (FORCE, SLIP)))
    assert cdr.unseal("Verdicts", plain[0])["checksum"] == found[0]["checksum"]  # which does not cover it


def both(chunk, **changes):
    return [(name, message(name, chunk, **changes)) for name in (FORCE, SLIP)]


def everything(attempt=1, block=0):
    return [pair for chunk in range(CHUNKS) for pair in both(chunk, block=block, attempt=attempt)]


@pytest.fixture(scope="module")
def truth():
    """The payload checksum of every chunk's verdicts."""
    return payloads(feed(ready(), *everything(), *everything(block=1)))


def test_every_chunk_gets_one_verdict_that_names_it_and_its_checksum():
    out = feed(ready("me"), *everything(attempt=3), *everything(block=1))
    assert judged(out) == [(0, chunk, 3) for chunk in range(CHUNKS)] + [(1, chunk, 1) for chunk in range(CHUNKS)]
    last = cdr.unseal("Verdicts", out[CHUNKS - 1])
    parts = [cdr.unseal(name, message(name, CHUNKS - 1))["checksum"] for name in (FORCE, SLIP)]
    assert last["chunk_checksum"] == cdr.chunk_checksum(0, CHUNKS - 1, *parts)
    assert (last["run_id"], last["sweep_id"], last["incarnation"]) == (RUN, SWEEP, "me")
    assert last["classifier"] == Thresholds(correlation=0.9).hash
    assert last["cells"].tolist() == [0, 1]
    assert [REGIMES[code] for code in last["regime"]] == ["helmholtz", "multiple_slip"]
    last = cdr.unseal("Verdicts", out[-1])
    assert last["cells"].tolist() == [2]
    assert [REGIMES[code] for code in last["regime"]] == ["multiple_flyback"]


def test_the_payload_depends_on_neither_attempt_nor_incarnation(truth):
    assert payloads(feed(ready("another"), *everything(attempt=7), *everything(block=1, attempt=2))) == truth


def test_the_two_topics_may_come_in_either_order_and_one_may_run_ahead(truth):
    forces = [(FORCE, message(FORCE, chunk)) for chunk in range(CHUNKS)]
    slips = [(SLIP, message(SLIP, chunk)) for chunk in range(CHUNKS)]
    for order in (forces + slips, slips + forces):
        classifier = ready()
        assert feed(classifier, *order[:CHUNKS]) == []
        out = feed(classifier, *order[CHUNKS:])
        assert payloads(out).items() <= truth.items()
        assert len(out) == CHUNKS
        assert classifier.counts.ignored == 0


def test_a_duplicate_is_answered_again_with_its_attempt_and_not_judged_again(truth):
    classifier = ready()
    first = feed(classifier, *both(0), *both(1))
    again = feed(classifier, *both(0, attempt=2), *both(1, attempt=2))
    assert judged(again) == [(0, 0, 2), (0, 1, 2)]
    assert payloads(again) == payloads(first)
    assert feed(classifier, *both(1))[0] == first[1]
    assert (classifier.counts.judged, classifier.counts.duplicates, classifier.counts.ignored) == (2, 6, 0)
    assert payloads(feed(classifier, *both(2, attempt=2))).items() <= truth.items()


def test_the_next_chunk_is_taken_from_any_attempt_even_half_of_each(truth):
    classifier = ready()
    out = feed(classifier, *both(0), (FORCE, message(FORCE, 1)))  # attempt 1 ends here
    out += feed(classifier, *both(0, attempt=2), *both(1, attempt=2), *both(2, attempt=2))
    assert judged(out) == [(0, 0, 1), (0, 0, 2), (0, 1, 2), (0, 2, 2)]
    assert payloads(out).items() <= truth.items()


def test_all_attempts_that_sent_a_chunk_while_it_waited_are_answered():
    classifier = ready()
    waiting = [(SLIP, message(SLIP, 0)), (SLIP, message(SLIP, 0, attempt=2)), (SLIP, message(SLIP, 0, attempt=2))]
    assert feed(classifier, *waiting) == []
    assert judged(feed(classifier, (FORCE, message(FORCE, 0)))) == [(0, 0, 1), (0, 0, 2)]


def test_a_later_chunk_than_expected_is_counted_and_ignored(truth):
    classifier = ready()
    assert feed(classifier, *both(1), *both(2)) == []
    assert classifier.counts.ignored == 4
    assert "chunk 0 comes first" in classifier.complaints[0]
    assert payloads(feed(classifier, *everything())).items() <= truth.items()


def test_what_waits_is_bounded(monkeypatch):
    monkeypatch.setattr(stream, "AHEAD", 3)
    classifier = ready()
    feed(classifier, *((FORCE, message(FORCE, chunk)) for chunk in range(CHUNKS)))
    assert classifier.counts.ignored == CHUNKS - 3
    for _ in range(stream.COMPLAINTS + 10):
        classifier.take(SLIP, b"rubbish")
    assert len(classifier.complaints) == stream.COMPLAINTS


def flipped(data, at):
    return data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]


RUBBISH = {
    "empty": (b"", "StickSlip"),
    "short": (message(SLIP, 0)[:-9], "StickSlip"),
    "no CDR": (b"\x00\x00" + message(SLIP, 0)[2:], "plain little-endian CDR"),
    "a flipped bit": (flipped(message(SLIP, 0), 150), "StickSlip"),
    "another run": (message(SLIP, 0, run_id="other"), "run 'other'"),
    "another sweep": (message(SLIP, 0, sweep_id="other"), "sweep 'other'"),
    "no such block": (message(SLIP, 0, block=2, content=BLOCKS[0][0], cells=[0, 1]), "2 blocks of 5 chunks"),
    "no such chunk": (message(SLIP, CHUNKS, content=BLOCKS[0][0]), "2 blocks of 5 chunks"),
    "other cells": (message(SLIP, 0, cells=[1, 0]), "its cells are not the"),
    "cells of another block": (message(SLIP, 0, block=1, content=BLOCKS[0][0], cells=[0, 1]), "its cells are not the"),
    "another first sample": (message(SLIP, 0, first_sample=695), "695 samples from sample 695 on"),
    "other samples": (message(SLIP, 0, samples=696), "696 samples from sample 0 on"),
    "slips without a length": (message(SLIP, 0, duration=0 * BLOCKS[0][0][1].duration), "should be in order, separate"),
    "a string that already slips": (message(SLIP, 0, slipping=[1, 1]), "sticks at the end of the chunk before"),
}


@pytest.mark.parametrize("kind", RUBBISH)
def test_rubbish_is_counted_ignored_and_explained(kind, truth):
    classifier = ready()
    data, says = RUBBISH[kind]
    before = feed(classifier, (FORCE, message(FORCE, 0)))
    assert before + classifier.take(SLIP, data) == []
    assert classifier.counts.ignored == 1
    assert says in classifier.complaints.popleft()
    assert payloads(feed(classifier, *everything())).items() <= truth.items()


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_no_bytes_bring_it_down(data):
    classifier = ready()
    good = bytearray(message(SLIP, 0))
    for _ in range(data.draw(st.integers(1, 8))):
        good[data.draw(st.integers(0, len(good) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, len(good)))
    classifier.take(SLIP, bytes(good[:cut]))
    classifier.plan(bytes(good[:cut]))


def test_a_duplicate_with_other_bytes_is_reported_and_answered_as_the_first():
    classifier = ready()
    first = feed(classifier, *both(0))
    other = message(SLIP, 0, attempt=2, content=chunks([helmholtz(700), silence(700)])[0])
    assert payloads(classifier.take(SLIP, other)) == payloads(first)
    assert classifier.counts.nondeterministic == 1
    assert "not deterministic" in classifier.complaints.pop()


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_however_the_messages_of_two_attempts_interleave_every_chunk_is_judged_once_in_order(truth, data):
    lines = []
    for attempt in (1, 2):
        stops = CHUNKS if attempt == 2 else data.draw(st.integers(0, CHUNKS))
        for name in (FORCE, SLIP):
            lines.append([(name, message(name, chunk, attempt=attempt)) for chunk in range(stops)])
    classifier, out = ready(), []
    while any(lines):
        line = data.draw(st.sampled_from([line for line in lines if line]))
        out += classifier.take(*line.pop(0))
    assert classifier.counts.judged == CHUNKS
    assert [chunk for chunk, _ in itertools.groupby(sorted(c for _, c, _ in judged(out)))] == list(range(CHUNKS))
    assert {(c, 2) for c in range(CHUNKS)} <= {(c, attempt) for _, c, attempt in judged(out)}
    for one in out:  # also the second answer to a chunk
        assert payloads([one]).items() <= truth.items()


def test_a_settled_block_is_forgotten_and_its_messages_ignored():
    classifier = ready()
    feed(classifier, *both(0), *both(0, block=1))
    classifier.plan(plan(block_states=[1, 0], epoch=2))
    assert feed(classifier, *both(0), *both(1)) == []
    assert classifier.counts.ignored == 4
    assert "settled" in classifier.complaints.pop()
    assert judged(feed(classifier, *both(1, block=1))) == [(1, 1, 1)]
    classifier.plan(plan(block_states=[1, 2], epoch=2))
    assert not classifier._blocks


def test_a_plan_that_grows_has_more_blocks_and_keeps_the_begun_ones():
    settings = [*SETTINGS, "adaptive=0.9"]  # three cells, first two, then one
    classifier = Classifier("me")
    classifier.plan(plan(rounds=[1, 1, 0], block_states=[0], **{"spec.settings": settings}))
    assert feed(classifier, *both(0, block=1)) == []
    assert "1 blocks" in classifier.complaints.pop()
    assert judged(feed(classifier, *both(0))) == [(0, 0, 1)]
    classifier.plan(plan(rounds=[1, 1, 2], **{"spec.settings": settings}))
    assert judged(feed(classifier, *both(0, block=1), *both(1))) == [(1, 0, 1), (0, 1, 1)]


@pytest.mark.parametrize("rounds", [[1, 0, 0], [1, 2, 1], [1, 1], [1, 1, 3]])
def test_a_plan_whose_rounds_change_what_is_known_is_ignored(rounds):
    settings = [*SETTINGS, "adaptive=0.9"]
    classifier = Classifier("me")
    classifier.plan(plan(rounds=[1, 1, 0], block_states=[0], **{"spec.settings": settings}))
    classifier.plan(plan(rounds=rounds, block_states=[1], **{"spec.settings": settings}))
    assert "plan ignored" in classifier.complaints.pop()
    assert judged(feed(classifier, *both(0))) == [(0, 0, 1)]


def test_a_block_that_is_judged_to_the_end_keeps_only_its_answers():
    classifier = ready()
    feed(classifier, *everything())
    assert classifier._blocks[0].classifier is None
    assert judged(feed(classifier, *everything(attempt=2))) == [(0, chunk, 2) for chunk in range(CHUNKS)]


def test_without_an_open_plan_nothing_is_judged():
    classifier = Classifier("me")
    assert feed(classifier, *both(0)) == []
    classifier.plan(plan(state=2))
    assert classifier.task is None
    classifier.plan(plan())
    assert len(feed(classifier, *both(0))) == 1
    classifier.plan(plan(state=2))
    assert classifier.task is None
    assert feed(classifier, *both(1)) == []
    classifier.plan(plan(epoch=1))
    assert judged(feed(classifier, *both(0))) == [(0, 0, 1)]


def test_a_new_epoch_keeps_what_is_known_and_an_older_one_is_ignored():
    classifier = ready()
    feed(classifier, *both(0))
    classifier.plan(plan(epoch=5))
    classifier.plan(plan(epoch=4, block_states=[1, 1]))
    assert "epoch 5 is in charge" in classifier.complaints.pop()
    assert judged(feed(classifier, *both(1))) == [(0, 1, 1)]


def test_another_run_begins_anew_and_the_end_of_the_one_before_does_not_end_it():
    classifier = ready()
    feed(classifier, *both(0))
    classifier.plan(plan(run_id=NEXT))
    classifier.plan(plan(state=2))
    assert classifier.task.outline.run_id == NEXT
    assert feed(classifier, *both(1)) == []
    assert judged(feed(classifier, *both(0, run_id=NEXT))) == [(0, 0, 1)]


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"classifier": "0" * 16}, "the plan wants classifier 0000000000000000, this is"),
        ({"spec.settings": [*SETTINGS, "classifier.slip=7"]}, "classifier.slip = '7'"),
        ({"spec.settings": [*SETTINGS, "v_mid=2"]}, "v_mid"),
        ({"spec.settings": [*SETTINGS, "x.count=many"]}, "x.count = 'many'"),
        ({"spec.settings": [*SETTINGS, "block_cells=0"]}, "block_cells = 0"),
        ({"spec.settings": [*SETTINGS, "nonsense"]}, "nonsense"),
        ({"spec.settings": [*SETTINGS, "x.name=period"]}, "x.name = 'period'"),
        ({"spec.settings": [*SETTINGS, "x.name=bow_bridge"]}, "x.count = 3: bow_bridge takes whole numbers"),
        ({"spec.settings": [*SETTINGS, "x.name=v_b", "x.first=0"]}, "x.first = 0.0: should be above 0"),
        ({"spec.settings": [*SETTINGS, "x.name=v_b", "x.scale=cubic"]}, "x.scale = 'cubic'"),
    ],
)
def test_a_plan_that_cannot_be_judged_is_a_problem_until_the_next(changes, says):
    classifier = Classifier("me")
    classifier.plan(plan(**changes))
    assert classifier.task is None
    assert says in classifier.problem
    assert feed(classifier, *both(0)) == []
    classifier.plan(plan(sweep_id="a" * 16))
    assert classifier.problem == ""
    assert classifier.task is not None


def test_every_cell_of_a_map_of_bow_position_is_judged_by_its_own():
    axis = ("x.name=bow_bridge", "x.scale=linear", "x.first=5", "x.last=35", "block_cells=3")
    task = Task.of(outline(RUN, SWEEP, [*SETTINGS, *axis]))
    classifier = Classifier("me")
    classifier.open(task)
    record = sticking_flybacks(SAMPLES_OF_STREAMS, 3)
    content = chunks([Record(record.bridge_force * 3, record.slips)] * 3)
    out = []
    for chunk in range(2):
        for name in (FORCE, SLIP):
            out += classifier.take(name, message(name, chunk, content=content[chunk], cells=task.outline.block(0)))
    last = cdr.unseal("Verdicts", out[-1])
    block = BlockClassifier(Geometry.of(task.outline.parameters), task.thresholds, 3, bow_bridge=[5, 20, 35])
    expected = [block.classify(*chunk) for chunk in content[:2]][-1]._asdict()
    assert all(last[name].tobytes() == values.tobytes() for name, values in expected.items())
    assert [REGIMES[code] for code in last["regime"]][:2] == ["multiple_slip", "multiple_flyback"]
