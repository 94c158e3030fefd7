"""The simulator's session: one statement each on what it answers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from session_messages import (
    OWN,
    block,
    chunk_messages,
    plan,
    receipt,
    request,
)

from bow_sim.block_request import fingerprint_of
from bow_sim.protocol.neighbours import FIRST_HELLO_S, HELLO_S, UNCONFIRMED_S
from bow_sim.protocol.states import NodeState
from bow_sim.simulator_events import (
    BlockReceived,
    ChunkComputed,
    ComputeChunk,
    Ignore,
    Instruction,
    Log,
    PlanReceived,
    Publish,
    Published,
    ReadersChecked,
    ReceiptReceived,
    RecreatePublishers,
    Report,
    SetState,
    WorkerIdle,
)
from bow_sim.simulator_session import SimulatorSession
from bow_sweep.plan.sweep import Sweep


@pytest.fixture
def session() -> SimulatorSession:
    """A session that is ready in the first of `RUNS`, epoch 1."""
    made = SimulatorSession(OWN, lambda _: "f", lambda *_: True, credit=2, prepare=request)
    made.handle(PlanReceived(plan()), 0)
    made.handle(ReadersChecked((), consumers_alive=True), 0)
    assert made.state == NodeState.READY
    return made


def compute(session: SimulatorSession, out: list[Instruction], now: float = 0.0) -> list[Instruction]:
    """Do what a worker is told, until it is told nothing more; return all instructions."""
    done = []
    while out:
        done += out
        (item,) = [item for item in out if isinstance(item, ComputeChunk | Publish)] or [None]
        if isinstance(item, ComputeChunk):
            out = session.handle(ChunkComputed(chunk_messages(item)), now)
        elif isinstance(item, Publish):
            out = session.handle(Published(item, failed=False), now)
        else:
            break
    return done


def test_a_block_is_computed_as_far_as_credit_goes_and_to_its_end_when_it_is_answered(
    session: SimulatorSession,
) -> None:
    out = compute(session, session.handle(BlockReceived(block()), 0))
    assert [item.chunk for item in out if isinstance(item, ComputeChunk)] == [0, 1, 2]
    assert len([item for item in out if isinstance(item, Publish)]) == 2
    assert session.state == NodeState.BUSY
    out = compute(session, session.handle(ReceiptReceived(receipt([(0, 0, 0), (0, 0, 1)])), 0))
    assert len([item for item in out if isinstance(item, Publish)]) == 1
    assert isinstance(out[-1], Report)
    assert (out[-1].state, out[-1].held, out[-1].refused) == (NodeState.READY, (), ())


def test_a_settled_block_is_dropped_before_its_next_message(session: SimulatorSession) -> None:
    out = session.handle(BlockReceived(block()), 0)
    assert any(isinstance(item, ComputeChunk) for item in out)
    assert session.handle(PlanReceived(plan(settled=[0])), 0) == []  # the kernel is at it
    (report,) = session.handle(ChunkComputed({}), 0)
    assert isinstance(report, Report)
    assert (report.held, report.refused) == ((), ((0, 1),))


def test_hellos_are_frequent_until_the_streams_are_received_and_stop_while_chunks_are_under_way() -> None:
    session = SimulatorSession(OWN, lambda _: "f", lambda *_: True, prepare=request)
    assert session.handle(WorkerIdle(), 0) == []  # no run
    session.handle(PlanReceived(plan()), 0)

    def hellos(now: float) -> int:
        out = session.handle(WorkerIdle(), now)
        for item in out:
            assert isinstance(item, Publish)
            session.handle(Published(item, failed=False), now)
        return len(out)

    assert [hellos(now) for now in (1, 1, 1 + FIRST_HELLO_S)] == [1, 0, 1]
    waits = ReadersChecked(("/bow/recorder does not hear bridge_force",), consumers_alive=True)
    session.handle(waits, 1.11)
    assert hellos(1.11) == 1, "the recorder has taken up the run, and hears it now"
    session.handle(waits, 1.12)
    assert hellos(1.12) == 0
    session.handle(ReadersChecked((), consumers_alive=True), 1.2)
    assert [hellos(now) for now in (1 + 0.5 * HELLO_S, 1.2 + HELLO_S)] == [0, 1]
    compute(session, session.handle(BlockReceived(block()), 5), 5)
    assert hellos(5 + HELLO_S) == 0


def test_publishers_that_fail_for_good_are_created_again(session: SimulatorSession) -> None:
    publish = next(item for item in session.handle(WorkerIdle(), 9) if isinstance(item, Publish))
    session.handle(Published(publish, failed=True), 9)
    assert session.handle(ReadersChecked((), consumers_alive=True), 9 + 2 * UNCONFIRMED_S) == []  # it was for a moment
    missing = ReadersChecked(("/bow/recorder does not hear bridge_force",), consumers_alive=True)
    early = SimulatorSession(OWN, lambda _: "f", lambda *_: True, prepare=request, now=8)
    early.handle(PlanReceived(plan()), 9)
    early.handle(Published(publish, failed=True), 9)
    assert not any(isinstance(item, RecreatePublishers) for item in early.handle(missing, 9))
    assert RecreatePublishers() in early.handle(missing, 8.1 + UNCONFIRMED_S)
    assert RecreatePublishers() not in early.handle(missing, 20 + UNCONFIRMED_S)


def test_publishers_that_fail_again_and_again_are_created_again_at_once_but_not_too_often(
    session: SimulatorSession,
) -> None:
    publish = next(item for item in session.handle(WorkerIdle(), 9) if isinstance(item, Publish))
    heard = ReadersChecked((), consumers_alive=True)

    def recreated(failures: list[bool], now: float) -> bool:
        for failed in failures:
            session.handle(Published(publish, failed=failed), now)
        return RecreatePublishers() in session.handle(heard, now)

    assert not recreated([True, True], 9)
    assert not recreated([False, True, True], 9)
    assert recreated([True], 9)
    assert not recreated([True] * 3, 9 + UNCONFIRMED_S)
    assert recreated([], 9.1 + UNCONFIRMED_S)
    assert not recreated([], 20 + UNCONFIRMED_S), "those that were created since have not failed"


def test_a_lost_consumer_takes_the_simulator_out_of_work_until_it_is_back(session: SimulatorSession) -> None:
    why = "/bow/recorder does not hear stick_slip"
    (item,) = session.handle(ReadersChecked((why,), consumers_alive=True), 1)
    assert item == SetState(NodeState.STARTING, f"waiting: {why}", "r1")
    out = session.handle(BlockReceived(block()), 1)
    assert any(isinstance(item, Log) and "not ready: waiting" in item.text for item in out)
    (item,) = session.handle(ReadersChecked((), consumers_alive=True), 2)
    assert item == SetState(NodeState.READY, "", "r1")


def test_receipts_whose_arrays_differ_in_length_are_ignored(session: SimulatorSession) -> None:
    odd = {**receipt([(0, 0, 0)]), "kind": np.zeros(2, np.uint8)}
    (item,) = session.handle(ReceiptReceived(odd), 0)
    assert isinstance(item, Ignore)


def test_a_simulator_refuses_blocks_that_cannot_be_right() -> None:
    sweep = Sweep.from_spec("fig11d", ["x.count=16", "y.count=8", "block_cells=8"])
    run = ("run", sweep.sweep_id)
    cells = sweep.block(3)
    lanes = sweep.lanes(cells)

    def objection(ready: bool = True, open_epoch: int = 1, **changes: Any) -> str:
        session = SimulatorSession(OWN, fingerprint_of, lambda *_: True)
        session.handle(PlanReceived(plan(run, open_epoch)), 0)
        session.handle(ReadersChecked(() if ready else ("no recorder",), consumers_alive=True), 0)
        message = block(3, run=run, fingerprint=sweep.fingerprint, cells=cells)
        message |= {"spec.settings": list(sweep.settings()), "x": lanes["f_asym"], "y": lanes["f_init_ratio"]}
        out = session.handle(BlockReceived({**message, **changes}), 0)
        return "".join(item.text for item in out if isinstance(item, Log))

    assert objection() == ""
    assert "array lengths" in objection(x=lanes["f_asym"][:-1])
    assert "array lengths" in objection(cells=[], x=[], y=[])
    assert "f_asym" in objection(x=-lanes["f_asym"])
    assert "f_asym" in objection(x=np.full(8, np.nan))
    assert "f_init_ratio" in objection(y=np.full(8, np.inf))
    assert "cells" in objection(cells=cells + 128)
    assert "cells" in objection(cells=np.zeros(8, np.uint32))
    assert "kernel" in objection(fingerprint="another")
    assert "is not the open one" in objection(run_id="another")
    assert "is not the open one" in objection(sweep_id="another")
    assert "v_mid" in objection(**{"spec.settings": [*sweep.settings(), "v_mid=1"]})
    assert "nonsense" in objection(**{"spec.settings": ["nonsense"]})
    assert "epoch 1 is over" in objection(open_epoch=2)
    assert "not ready" in objection(ready=False)
