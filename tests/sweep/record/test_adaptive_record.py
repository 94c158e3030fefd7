"""The record of an adaptive sweep: blocks are added round by round, and every one is checked."""

from __future__ import annotations

import time

import numpy as np
import pytest
import recording

from bow_sim.physics.errors import ParameterError
from bow_sim.protocol import cdr
from bow_sim.protocol.blocks import Blocks
from bow_sim.protocol.states import BlockState, PlanState
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sweep.maps.basin_map import Basin
from bow_sweep.record.replay import load_verdicts, replay
from bow_sweep.record.session import Session
from bow_sweep.record.verify import verify

SWEEP = recording.small_sweep(
    "adaptive=0.8", "x.count=7", "y.count=6", "x.first=2", "x.last=12", "block_cells=5", "periods=50"
)


def announce(session: Session, blocks: Blocks, state: int = 1, states: np.ndarray | None = None) -> bytes:
    states = np.zeros(blocks.count, np.uint8) if states is None else states
    data = recording.plan(SWEEP, state, states=states, rounds=blocks.announce())
    session.plan(cdr.decode("Plan", data), data, time.time_ns())
    return data


def take(session: Session, blocks: Blocks, numbers: range, basin: Basin | None = None) -> None:
    for number in numbers:
        for chunk, messages in enumerate(recording.chunks(SWEEP, number, blocks=blocks)):
            for topic, data in messages.items():
                session.take(topic, data, time.time_ns())
            if basin is not None:
                verdict = cdr.decode("Verdicts", messages.verdicts)
                basin.take(chunk, verdict["cells"], verdict)


def record(directory, *, change=None, given_up=()):
    """Record an adaptive sweep without ROS; return all its blocks."""
    blocks, done = SWEEP.first_blocks, 0
    session = recording.session(directory, SWEEP)
    basin = Basin(SWEEP.x.count, SWEEP.y.count, SWEEP.chunks)
    while True:
        take(session, blocks, range(done, blocks.count), basin)
        session.commit(time.time_ns())
        basin.transient_periods[blocks.cells_of(n for n in given_up if n < blocks.count)] = np.nan
        more = SWEEP.more_blocks(blocks, basin.transient_periods)
        if more is None:
            break
        done, blocks = blocks.count, more if change is None else change(blocks, more)
        announce(session, blocks)
    states = np.full(blocks.count, BlockState.DONE, np.uint8)
    states[list(given_up)] = BlockState.QUARANTINED
    announce(session, blocks, PlanState.CLOSED, states)
    session.close(time.time_ns())
    assert not session.complaints
    return blocks


def test_every_cell_of_every_round_is_accounted_for_once(tmp_path):
    blocks = record(tmp_path / "run")
    assert len(blocks.rounds) > 3  # otherwise the test shows nothing
    account = verify(tmp_path / "run")
    assert account["ok"], account["problems"]
    assert account["notes"] == []
    assert account["cells"] == account["cells_planned"] == blocks.planned_cells <= 0.8 * 42
    assert account["cells_predicted"] == 42 - blocks.planned_cells
    assert account["chunks"] == account["verdicts_equal"] == blocks.count * SWEEP.chunks
    assert np.array_equal(load_verdicts(tmp_path / "run")["tested"].all(axis=0), blocks.planned)


def test_replaying_gives_the_same_verdicts(tmp_path):
    blocks = record(tmp_path / "run")
    again = replay(tmp_path / "run")
    assert again["ok"]
    assert (again["cells"], again["equal"]) == (blocks.planned_cells, blocks.count * SWEEP.chunks)


def test_a_block_that_is_given_up_leaves_its_cells_unknown_and_the_rounds_go_on(tmp_path):
    blocks = record(tmp_path / "run", given_up=[1])
    account = verify(tmp_path / "run")
    assert account["ok"], account["problems"]
    assert account["notes"] == []
    assert (account["cells_quarantined"], account["quarantined_blocks"]) == (blocks.size(1), [1])


def test_rounds_that_do_not_follow_from_the_verdicts_are_noted(tmp_path):
    def change(blocks: Blocks, more: Blocks) -> Blocks:
        return blocks.grown(np.flatnonzero(~blocks.planned)[: len(more.rounds[-1])])

    record(tmp_path / "run", change=change)
    account = verify(tmp_path / "run")
    assert account["ok"]
    assert account["notes"] == ["round 2 has other cells than the verdicts before it ask for here"]


def test_a_block_is_refused_until_its_round_is_announced(tmp_path):
    first = SWEEP.first_blocks
    blocks = first.grown(np.flatnonzero(~first.planned)[:3])
    session = recording.session(tmp_path / "run", SWEEP)
    fresh = range(first.count, blocks.count)
    take(session, blocks, fresh)
    assert session.ignored == 3 * SWEEP.chunks
    assert not len(session.stored)
    announce(session, blocks)
    take(session, blocks, fresh)
    assert len(session.stored) == 3 * SWEEP.chunks
    session.abandon()


def test_a_plan_that_takes_rounds_back_is_ignored_and_named(tmp_path):
    first = SWEEP.first_blocks
    blocks = first.grown(np.flatnonzero(~first.planned)[:3])
    session = recording.session(tmp_path / "run", SWEEP)
    announce(session, blocks)
    announce(session, first, PlanState.CLOSED)
    assert not session.closed
    assert "do not contain the" in next(iter(session.complaints))
    session.abandon()


def test_a_recorder_that_is_started_again_knows_the_rounds_from_the_latest_plan(tmp_path):
    first = SWEEP.first_blocks
    blocks = first.grown(np.flatnonzero(~first.planned)[:3])
    session = recording.session(tmp_path / "run", SWEEP)
    take(session, first, range(first.count))
    session.commit(time.time_ns())
    session.abandon()
    data = recording.plan(SWEEP, states=np.zeros(blocks.count, np.uint8), rounds=blocks.announce())
    again = Session(tmp_path / "run", cdr.decode("Plan", data), data, "8" * 16, time.time_ns())
    take(again, blocks, range(blocks.count))
    assert len(again.stored) == 3 * SWEEP.chunks * blocks.count
    assert again.stored.duplicates == 3 * SWEEP.chunks * first.count
    announce(again, blocks, PlanState.CLOSED, np.full(blocks.count, BlockState.DONE, np.uint8))
    again.close(time.time_ns())
    assert verify(tmp_path / "run")["ok"]


@pytest.mark.parametrize("rounds", [[], [1] * 41, [0] * 42, [2] * 42])
def test_a_plan_with_rounds_that_cannot_be_is_refused(rounds):
    plan = cdr.decode("Plan", recording.plan(SWEEP, rounds=np.array(rounds, np.uint8)))
    with pytest.raises(ParameterError, match=r"Plan\.rounds"):
        SweepOutline.of(plan)


def test_an_exhaustive_sweep_has_no_rounds():
    sweep = recording.small_sweep()
    with pytest.raises(ParameterError, match="adaptive = 1"):
        SweepOutline.of(cdr.decode("Plan", recording.plan(sweep, rounds=np.ones(12, np.uint8))))
