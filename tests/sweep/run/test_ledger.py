"""The ledger: exact accounts whatever happens, in whatever order."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bow_sim.protocol.recording import recorded_chunks
from bow_sweep.run import ledger as L  # noqa: N812  # events read better as L.Finished
from bow_sweep.run.ledger import Ledger, State
from bow_sweep.run.ledger_block import SUSPECT_CRASHES

CHUNKS = 3


def chunk_sum(block: int, chunk: int) -> int:
    return 1000 * block + chunk


def verdict_sum(block: int, chunk: int) -> int:
    return 500_000 + 1000 * block + chunk


def answer(ledger: Ledger, block: int, now: float = 0.0, station: str = "", on_disk: bool = True) -> list:
    out = []
    for chunk in range(CHUNKS):
        streams, verdicts = chunk_sum(block, chunk), verdict_sum(block, chunk)
        out += ledger.handle(L.Receipted(block, chunk, streams, False, station), now)
        out += ledger.handle(L.Judged(block, chunk, streams, verdicts, station), now)
        out += ledger.handle(L.Receipted(block, chunk, verdicts, True, station), now)
    return out + (ledger.handle(L.OnDisk(block, station), now) if on_disk else [])


def dispatches(out: list) -> list[L.Dispatch]:
    return [item for item in out if isinstance(item, L.Dispatch)]


def test_a_simulator_gets_two_blocks_and_the_next_when_one_is_finished() -> None:
    ledger = Ledger(3, CHUNKS)
    out = dispatches(ledger.handle(L.SimulatorReady("a"), 0))
    assert [(d.block, d.attempt) for d in out] == [(0, 1), (1, 1)]
    assert [d.block for d in dispatches(ledger.handle(L.Finished("a", 0, 1), 0))] == [2]


def test_work_is_shared_between_simulators() -> None:
    ledger = Ledger(8, CHUNKS)
    first = dispatches(ledger.handle(L.SimulatorReady("a"), 0))
    second = dispatches(ledger.handle(L.SimulatorReady("b"), 0))
    assert {d.simulator for d in first} == {"a"}
    assert {d.simulator for d in second} == {"b"}


def test_dispatch_is_recorded_before_it_is_sent() -> None:
    out = Ledger(1, CHUNKS).handle(L.SimulatorReady("a"), 0)
    assert isinstance(out[0], L.Record)
    assert out[0].entry["event"] == "dispatched"
    assert isinstance(out[1], L.Dispatch)


@pytest.mark.parametrize("missing", ["streams", "judged", "verdicts", "disk"])
def test_a_block_is_not_done_while_one_answer_is_missing(missing: str) -> None:
    ledger = Ledger(1, CHUNKS)
    ledger.handle(L.SimulatorReady("a"), 0)
    events = {
        "streams": [L.Receipted(0, c, chunk_sum(0, c), False) for c in range(CHUNKS)],
        "judged": [L.Judged(0, c, chunk_sum(0, c), verdict_sum(0, c)) for c in range(CHUNKS)],
        "verdicts": [L.Receipted(0, c, verdict_sum(0, c), True) for c in range(CHUNKS)],
        "disk": [L.OnDisk(0)],
    }
    last = events[missing].pop()
    for kind in events.values():
        for event in kind:
            ledger.handle(event, 0)
    assert not ledger.finished
    ledger.handle(last, 0)
    assert ledger.finished
    assert ledger.count(State.DONE) == 1


@pytest.mark.parametrize(("record", "streams"), [("all", 3), ("last", 1), ("verdicts", 0)])
def test_a_block_waits_for_the_streams_that_are_to_be_recorded_and_no_others(record: str, streams: int) -> None:
    recorded = recorded_chunks(record, CHUNKS)
    assert list(recorded) == list(range(CHUNKS))[CHUNKS - streams :]
    ledger = Ledger(1, CHUNKS, recorded)
    ledger.handle(L.SimulatorReady("a"), 0)
    for chunk in range(CHUNKS):
        ledger.handle(L.Judged(0, chunk, chunk_sum(0, chunk), verdict_sum(0, chunk)), 0)
        ledger.handle(L.Receipted(0, chunk, verdict_sum(0, chunk), True), 0)
    ledger.handle(L.OnDisk(0), 0)
    for chunk in range(CHUNKS):
        assert ledger.finished == (chunk not in recorded and not any(c > chunk for c in recorded))
        ledger.handle(L.Receipted(0, chunk, chunk_sum(0, chunk), False), 0)
    assert ledger.count(State.DONE) == 1


def test_only_the_block_being_computed_is_suspect_when_its_simulator_crashes() -> None:
    ledger = Ledger(2, CHUNKS)
    ledger.handle(L.SimulatorReady("a"), 0)
    ledger.handle(L.SimulatorLost("a", "killed"), 0)
    assert [block.crashes for block in ledger.blocks] == [1, 0]


def test_a_block_that_is_done_is_not_suspect_for_the_crash_of_the_next() -> None:
    ledger = Ledger(2, CHUNKS)
    ledger.handle(L.SimulatorReady("a"), 0)
    answer(ledger, 0)  # the report that it is finished has not arrived when the simulator crashes on the next one
    ledger.handle(L.SimulatorLost("a", "SIGSEGV"), 0)
    assert [block.crashes for block in ledger.blocks] == [0, 1]
    assert ledger.blocks[1].crashes_alone == 1


def test_a_simulator_that_was_stopped_makes_no_block_suspect() -> None:
    ledger = Ledger(2, CHUNKS)
    ledger.handle(L.SimulatorReady("a"), 0)
    ledger.handle(L.SimulatorLost("a", "stopped", blame=False), 0)
    assert [block.crashes for block in ledger.blocks] == [0, 0]
    assert [d.attempt for d in dispatches(ledger.handle(L.SimulatorReady("b"), 0))] == [2, 2]


def test_silences_that_end_make_no_block_suspect_and_are_taken_back_in_a_resumed_ledger_too() -> None:
    ledger, entries = Ledger(1, CHUNKS), []
    for turn in range(SUSPECT_CRASHES + L.POISON_CRASHES + 1):
        out = [*ledger.handle(L.SimulatorReady("a"), turn), *ledger.handle(L.SimulatorLost("a", "silent"), turn)]
        assert (ledger.blocks[0].crashes, ledger.blocks[0].crashes_alone) == (1, 1)
        assert ledger.blocks[0].state is State.DUE
        for _ in range(2):  # only the first counts
            out += ledger.handle(L.SimulatorReturned("a"), turn)
        entries += [item.entry for item in out if isinstance(item, L.Record)]
        for one in (ledger, Ledger.resume(1, CHUNKS, entries)):
            assert (one.blocks[0].crashes, one.blocks[0].crashes_alone) == (0, 0)
    assert [entry["event"] for entry in entries[:4]] == ["dispatched", "died", "due", "returned"]


def test_a_simulator_that_returns_takes_back_the_loss_of_its_last_block_only() -> None:
    ledger = Ledger(2, CHUNKS)
    ledger.handle(L.SimulatorReady("a"), 0)
    ledger.handle(L.SimulatorLost("a", "SIGSEGV"), 0)
    ledger.handle(L.SimulatorReady("a"), 0)
    answer(ledger, 0)
    answer(ledger, 1)
    ledger.handle(L.SimulatorLost("a", "silent"), 0)
    assert ledger.handle(L.SimulatorReturned("a"), 0) == []
    assert [block.crashes for block in ledger.blocks] == [1, 0]


def test_a_poison_block_is_quarantined_and_the_rest_is_done() -> None:
    ledger = Ledger(4, CHUNKS)
    crashes = 0
    for turn in range(40):
        name = f"s{turn}"
        ledger.handle(L.SimulatorReady(name), turn)
        while ledger.in_flight.get(name):
            block = ledger.in_flight[name][0]
            if block == 1:
                ledger.handle(L.SimulatorLost(name, "SIGSEGV"), turn)
                crashes += 1
            else:
                answer(ledger, block, turn)
                ledger.handle(L.Finished(name, block, ledger.blocks[block].attempt), turn)
    assert [block.state for block in ledger.blocks] == [State.DONE, State.QUARANTINED, State.DONE, State.DONE]
    assert crashes <= SUSPECT_CRASHES + L.POISON_CRASHES


def test_a_suspect_block_runs_alone() -> None:
    ledger = Ledger(3, CHUNKS)
    for turn in range(SUSPECT_CRASHES):
        ledger.handle(L.SimulatorReady(f"s{turn}"), 0)
        ledger.handle(L.SimulatorLost(f"s{turn}", "died"), 0)
    out = dispatches(ledger.handle(L.SimulatorReady("last"), 0))
    assert [d.block for d in out] == [0]


@pytest.mark.parametrize("role", ["recorder", "classifier"])
def test_a_restarted_consumer_makes_every_unfinished_block_due_again_in_a_new_epoch(role: str) -> None:
    ledger = Ledger(3, CHUNKS)
    ledger.handle(L.SimulatorReady("a"), 0)
    answer(ledger, 0)
    ledger.handle(L.Receipted(1, 0, chunk_sum(1, 0), False), 0)
    out = ledger.handle(L.ConsumerRestarted(role), 0)
    assert L.NewEpoch(2) in out
    assert ledger.blocks[0].state is State.DONE
    assert [(d.block, d.attempt) for d in dispatches(out)] == [(1, 2), (2, 1)] or [
        (d.block, d.attempt) for d in dispatches(out)
    ] == [(1, 2), (2, 2)]
    assert ledger.blocks[1].streams == {}
    epoch_at = out.index(L.NewEpoch(2))
    assert all(out.index(d) > epoch_at for d in dispatches(out))


@pytest.mark.parametrize("verdicts", [False, True])
def test_differing_checksums_quarantine_the_block(verdicts: bool) -> None:
    ledger = Ledger(1, CHUNKS)
    ledger.handle(L.SimulatorReady("a"), 0)
    ledger.handle(L.Judged(0, 0, chunk_sum(0, 0), verdict_sum(0, 0)), 0)
    ledger.handle(L.Receipted(0, 0, 77, verdicts), 0)
    assert ledger.blocks[0].state is State.QUARANTINED
    assert ledger.finished


def test_an_answer_that_never_comes_makes_the_block_due_again() -> None:
    ledger = Ledger(1, CHUNKS)
    ledger.handle(L.SimulatorReady("a"), 0)
    ledger.handle(L.Finished("a", 0, 1), 1)
    assert dispatches(ledger.handle(L.Tick(), 1 + L.STALE_S)) == []
    assert [d.attempt for d in dispatches(ledger.handle(L.Tick(), 2 + L.STALE_S))] == [2]


def test_a_block_that_only_waits_for_the_disk_is_not_computed_again_at_once() -> None:
    ledger = Ledger(1, CHUNKS)
    ledger.handle(L.SimulatorReady("a"), 0)
    answer(ledger, 0)
    assert ledger.finished
    ledger = Ledger(1, CHUNKS)
    ledger.handle(L.SimulatorReady("a"), 0)
    ledger.handle(L.Finished("a", 0, 1), 1)
    for chunk in range(CHUNKS):
        ledger.handle(L.Receipted(0, chunk, chunk_sum(0, chunk), False), 1)
        ledger.handle(L.Judged(0, chunk, chunk_sum(0, chunk), verdict_sum(0, chunk)), 1)
        ledger.handle(L.Receipted(0, chunk, verdict_sum(0, chunk), True), 1)
    assert dispatches(ledger.handle(L.Tick(), 2 + L.STALE_S)) == []
    assert [d.attempt for d in dispatches(ledger.handle(L.Tick(), 2 + L.DISK_S))] == [2]


def test_a_block_on_the_disk_of_which_an_answer_was_lost_is_due_again_however_often_the_recorder_says_so() -> None:
    ledger = Ledger(1, CHUNKS)
    ledger.handle(L.SimulatorReady("a"), 0)
    ledger.handle(L.Finished("a", 0, 1), 0)
    sent = []
    for second in range(3 * round(L.STALE_S)):
        ledger.handle(L.OnDisk(0), second)
        sent += dispatches(ledger.handle(L.Tick(), second))
    assert [d.attempt for d in sent] == [2]
    answer(ledger, 0, 100)
    assert ledger.finished


def test_resume_takes_the_entries_that_the_bag_made() -> None:
    records = [
        {"event": "done", "block": 0},
        {"event": "reopened", "block": 0, "why": "chunk 0: no bridge_force", "attempt": 4, "epoch": 7},
        {"event": "done", "block": 1, "why": "found complete in the bag", "attempt": 2},
    ]
    again = Ledger.resume(2, CHUNKS, records)
    assert again.epoch == 8
    assert [block.state for block in again.blocks] == [State.DUE, State.DONE]
    assert [(d.block, d.attempt) for d in dispatches(again.handle(L.SimulatorReady("b"), 0))] == [(0, 5)]


def test_a_refused_block_goes_to_another_simulator() -> None:
    ledger = Ledger(1, CHUNKS)
    ledger.handle(L.SimulatorReady("a"), 0)
    out = ledger.handle(L.SimulatorReady("b"), 0)
    assert dispatches(out) == []
    ledger.handle(L.SimulatorLost("a", "rejects", blame=False), 0)
    assert ledger.in_flight == {"b": [0]}


def test_a_late_report_of_an_older_attempt_changes_nothing() -> None:
    ledger = Ledger(1, CHUNKS)
    ledger.handle(L.SimulatorReady("a"), 0)
    ledger.handle(L.ConsumerRestarted("recorder"), 0)
    ledger.handle(L.Refused("a", 0, 1, "cancelled"), 0)
    assert ledger.in_flight == {"a": [0]}
    assert ledger.blocks[0].attempt == 2


def test_resume_keeps_what_is_done_and_goes_on_with_the_next_attempt() -> None:
    ledger = Ledger(3, CHUNKS)
    records = [i.entry for i in ledger.handle(L.SimulatorReady("a"), 0) if isinstance(i, L.Record)]
    records += [i.entry for i in answer(ledger, 0) if isinstance(i, L.Record)]
    again = Ledger.resume(3, CHUNKS, records)
    assert again.epoch == 2
    assert again.blocks[0].state is State.DONE
    out = dispatches(again.handle(L.SimulatorReady("b"), 0))
    assert [(d.block, d.attempt) for d in out] == [(1, 2), (2, 1)]


def entries(out: list, event: str) -> list:
    return [item.entry for item in out if isinstance(item, L.Record) and item.entry["event"] == event]


def test_a_block_is_done_by_the_answers_of_the_station_that_it_was_sent_to() -> None:
    ledger = Ledger(1, CHUNKS)
    sent = entries(ledger.handle(L.SimulatorReady("a", "lab"), 0), "dispatched")
    assert [entry["station"] for entry in sent] == ["lab"]
    for other in ("", "attic"):
        assert answer(ledger, 0, station=other) == []
    done = entries(answer(ledger, 0, station="lab"), "done")
    assert [entry["station"] for entry in done] == ["lab"]
    assert ledger.finished
    assert Ledger.resume(1, CHUNKS, [*sent, *done]).is_of(0, "lab")


def test_entries_say_nothing_of_the_station_without_a_name() -> None:
    ledger = Ledger(1, CHUNKS)
    records = ledger.handle(L.SimulatorReady("a"), 0) + ledger.handle(L.ConsumerRestarted("recorder"), 0)
    records += answer(ledger, 0)
    assert [item.entry for item in records if isinstance(item, L.Record) and "station" in item.entry] == []


def test_the_account_of_a_block_begins_anew_at_another_station() -> None:
    ledger = Ledger(1, CHUNKS)
    ledger.handle(L.SimulatorReady("a", "lab"), 0)
    for chunk in range(CHUNKS):
        ledger.handle(L.Receipted(0, chunk, chunk_sum(0, chunk), False, "lab"), 0)
    ledger.handle(L.OnDisk(0, "lab"), 0)
    ledger.handle(L.SimulatorLost("a", "cut off"), 0)
    ledger.handle(L.SimulatorReady("b", "attic"), 0)
    assert ledger.blocks[0].streams == {}
    assert not ledger.blocks[0].on_disk
    answer(ledger, 0, station="lab")
    assert not ledger.finished
    answer(ledger, 0, station="attic")
    assert ledger.finished


def test_a_block_that_waits_for_the_disk_of_a_station_that_has_gone_goes_to_another() -> None:
    ledger = Ledger(2, CHUNKS)
    ledger.handle(L.SimulatorReady("a", "lab"), 0)
    answer(ledger, 0, 1, "lab", on_disk=False)
    ledger.handle(L.Finished("a", 0, 1), 1)
    ledger.handle(L.SimulatorReady("b", "attic"), 2)
    assert ledger.handle(L.StationLost("attic"), 3) == ledger.handle(L.Tick(), 60) == [], "a slow disk has its time"
    assert [sent.block for sent in dispatches(ledger.handle(L.StationLost("lab"), 61))] == [0]
    assert ledger.in_flight == {"a": [1], "b": [0]}, "what a simulator holds is not concerned"


def test_late_answers_of_a_lost_station_count_as_long_as_nobody_else_has_the_block() -> None:
    ledger = Ledger(1, CHUNKS)
    ledger.handle(L.SimulatorReady("a", "lab"), 0)
    ledger.handle(L.SimulatorLost("a", "silent"), 0)
    answer(ledger, 0, station="lab")
    assert ledger.finished


def test_two_stations_that_judge_a_chunk_differently_quarantine_the_block() -> None:
    ledger = Ledger(1, CHUNKS)
    ledger.handle(L.SimulatorReady("a", "lab"), 0)
    ledger.handle(L.Judged(0, 1, chunk_sum(0, 1) + 1, verdict_sum(0, 1), "lab"), 0)
    ledger.handle(L.SimulatorLost("a", "cut off"), 0)
    ledger.handle(L.SimulatorReady("b", "attic"), 0)
    ledger.handle(L.Judged(0, 0, chunk_sum(0, 0), verdict_sum(0, 0), "attic"), 0)
    assert ledger.blocks[0].state is State.DISPATCHED
    ledger.handle(L.Judged(0, 1, chunk_sum(0, 1), verdict_sum(0, 1), "attic"), 0)
    assert ledger.blocks[0].state is State.QUARANTINED


def test_a_restarted_consumer_concerns_the_blocks_of_its_station_only() -> None:
    ledger = Ledger(4, CHUNKS)
    ledger.handle(L.SimulatorReady("a", "lab"), 0)
    ledger.handle(L.SimulatorReady("b", "attic"), 0)
    held = {name: list(blocks) for name, blocks in ledger.in_flight.items()}
    first = held["b"][0]
    ledger.handle(L.Receipted(first, 0, chunk_sum(first, 0), False, "attic"), 0)
    out = ledger.handle(L.ConsumerRestarted("recorder", "lab"), 0)
    assert [item for item in out if isinstance(item, L.NewEpoch)] == [], "the blocks of the others are not void"
    assert ledger.in_flight["b"] == held["b"]
    assert ledger.blocks[first].streams
    sent = dispatches(out)
    assert sorted(d.block for d in sent) == held["a"]
    assert {d.attempt for d in sent} == {2}
    assert [ledger.epoch_of(d.block) for d in sent] == [2, 2]
    assert ledger.epoch_of(first) == ledger.announced == 1
    again = Ledger.resume(4, CHUNKS, entries(out, "restarted"))
    assert (again.epoch, again.announced) == (3, 3)


def test_the_blocks_of_another_round_are_due_and_are_sent_at_once() -> None:
    ledger = Ledger(2, CHUNKS)
    ledger.handle(L.SimulatorReady("a"), 0)
    for block in (0, 1):
        answer(ledger, block)
        ledger.handle(L.Finished("a", block, 1), 0)
    assert ledger.finished
    out = ledger.handle(L.Grown(5), 0)
    assert [d.block for d in dispatches(out)] == [2, 3]
    assert not ledger.finished
    assert (ledger.count(State.DONE), ledger.count(State.DISPATCHED), ledger.count(State.DUE)) == (2, 2, 1)
    for block in (2, 3, 4):
        answer(ledger, block)
    assert ledger.finished


def test_blocks_of_earlier_rounds_stay_as_they_are() -> None:
    ledger = Ledger(3, CHUNKS)
    answer(ledger, 1)
    ledger.handle(L.Grown(4), 0)
    assert [block.state for block in ledger.blocks] == [State.DUE, State.DONE, State.DUE, State.DUE]
    assert [d.block for d in dispatches(ledger.handle(L.SimulatorReady("a"), 0))] == [0, 2]


@given(st.permutations(list(range(5))), st.integers(1, 4))
def test_every_block_is_done_once_in_any_order_of_answers(order: list[int], simulators: int) -> None:
    ledger = Ledger(5, CHUNKS)
    for number in range(simulators):
        ledger.handle(L.SimulatorReady(f"s{number}"), 0)
    settled = []
    for block in order:
        settled += [item for item in answer(ledger, block) if isinstance(item, L.Settled)]
    assert ledger.finished
    assert sorted(item.block for item in settled) == list(range(5))
