"""Runs that record verdicts only, or the streams of the last chunks: same map, exact account, proof by the kernel."""

from __future__ import annotations

import tempfile
import time
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import recording
from hypothesis import given, settings
from hypothesis import strategies as st
from outlines import outline
from small_graph import SmallGraph

from bow_sim.protocol import cdr
from bow_sim.protocol.messages import STREAMS
from bow_sim.protocol.recording import PROVED_CELLS
from bow_sim.protocol.states import ReceiptKind
from bow_sweep.cell.computed import block_streams, kernel
from bow_sweep.record.again import Again, Kernel
from bow_sweep.record.bag import BagError, messages
from bow_sweep.record.replay import replay
from bow_sweep.record.session import Session
from bow_sweep.record.topics import STORED_ONCE
from bow_sweep.record.verify import verify

PLAIN, LAST, VERDICTS = (recording.small_sweep(*more) for more in ((), ("record=last",), ("record=verdicts",)))
SWEEPS = {"all": PLAIN, "last": LAST, "verdicts": VERDICTS}
ALL = Again(kernel(), float("inf"))


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A whole run of each mode; not to be changed."""
    folder = tmp_path_factory.mktemp("modes")
    for name, sweep in SWEEPS.items():
        SmallGraph(folder / name, sweep).run()
    return {name: folder / name for name in SWEEPS}


def arrays(run: Path) -> dict[str, bytes]:
    with np.load(run / "map.npz") as file:
        return {name: file[name].tobytes() for name in file.files if name != "settings"}


@pytest.mark.parametrize("mode", ["last", "verdicts"])
def test_the_map_is_that_of_a_run_with_all_its_streams(runs: dict[str, Path], mode: str) -> None:
    assert arrays(runs[mode]) == arrays(runs["all"])


@pytest.mark.parametrize(("mode", "each"), [("all", 12), ("last", 3), ("verdicts", 0)])
def test_the_bag_holds_the_streams_that_are_to_be_recorded_and_every_verdict(runs, mode: str, each: int) -> None:
    topics = Counter(message.topic for message in messages(runs[mode] / "bag"))
    assert (topics["bridge_force"], topics["stick_slip"], topics["verdicts"]) == (each, each, 12)
    chunks = {
        cdr.decode_head("BridgeForce", message.data)["chunk"]
        for message in messages(runs[mode] / "bag")
        if message.topic == "bridge_force"
    }
    assert chunks == set(SWEEPS[mode].recorded_chunks)


@pytest.mark.parametrize(("mode", "recorded"), [("all", 12), ("last", 3), ("verdicts", 0)])
def test_every_cell_and_chunk_is_accounted_for_and_proved(runs: dict[str, Path], mode: str, recorded: int) -> None:
    result = verify(runs[mode], again=ALL)
    assert result["ok"], result["problems"]
    assert (result["cells"], result["chunks"], result["chunks_recorded"]) == (12, 12, recorded)
    assert result["samples"] == result["samples_planned"]
    assert result["verdicts_equal"] == 12
    assert result["computed_again"] == {"blocks": [0, 1, 2], "cells": 12, "equal": 12, "seed": 0}


def test_unless_asked_only_runs_without_streams_are_computed_again_and_it_is_said_where_nothing_was(runs) -> None:
    assert "computed_again" not in verify(runs["all"], again=Again(kernel()))
    assert verify(runs["verdicts"], again=Again(kernel()))["computed_again"]["cells"] == 12
    result = verify(runs["verdicts"])
    assert (result["ok"], result["verdicts_equal"]) == (True, 0)
    assert "record=verdicts, and nothing was computed again" in result["notes"][0]


@given(cells=st.none() | st.integers(0, 40), seed=st.integers(0, 9), mode=st.sampled_from(list(SWEEPS)))
def test_so_many_whole_blocks_are_drawn_that_they_have_the_wanted_cells(cells, seed: int, mode: str) -> None:
    plan = outline("0" * 16, SWEEPS[mode].sweep_id, SWEEPS[mode].settings())
    drawn = Again(kernel(), cells, seed).draw(plan, range(3))
    wanted = cells if cells is not None else 0 if mode == "all" else PROVED_CELLS
    sizes = [plan.planned.size(block) for block in drawn]
    assert drawn == sorted(set(drawn)) == Again(kernel(), cells, seed).draw(plan, range(3))
    assert sum(sizes) >= min(wanted, 12)
    assert not drawn or sum(sizes) - max(sizes) < wanted


# ---- what a proof finds


def altered(run: Path, change: Callable[[dict[str, Any]], Mapping[str, Any]], leave_out: int = -1) -> Path:
    """Record verdicts only, those of block 1, chunk 2 changed; checksums and receipts are right."""
    session = recording.session(run, VERDICTS)
    for topic, data in recording.everything(VERDICTS):
        values = cdr.decode(STORED_ONCE[topic], data)
        if values["block"] == leave_out:
            continue
        if (topic, values["block"], values["chunk"]) == ("verdicts", 1, 2):
            data = cdr.encode("Verdicts", {**values, **change(values)})  # noqa: PLW2901
        session.take(topic, data, time.time_ns())
    recording.finish(session, VERDICTS)
    return run


def test_a_changed_verdict_is_found_though_every_checksum_is_right(tmp_path: Path) -> None:
    run = altered(tmp_path / "run", lambda v: {"regime": 0 * v["regime"] + 5})
    assert verify(run)["ok"]
    result = verify(run, again=ALL)
    assert [(p["what"], p["block"], p["chunk"]) for p in result["problems"]] == [
        ("the verdicts derived again differ in regime", 1, 2)
    ]
    assert (result["computed_again"]["cells"], result["computed_again"]["equal"]) == (12, 7)


def test_a_changed_checksum_of_a_chunk_is_found(tmp_path: Path) -> None:
    run = altered(tmp_path / "run", lambda v: {"chunk_checksum": v["chunk_checksum"] ^ 1})
    (problem,) = verify(run, again=ALL)["problems"]
    assert problem["what"].startswith("the verdicts are on chunk")
    assert "kernel" not in problem["what"]
    assert (problem["block"], problem["chunk"]) == (1, 2)


def test_a_missing_block_is_found_without_computing(tmp_path: Path) -> None:
    result = verify(altered(tmp_path / "run", dict, leave_out=1))
    found = [(p["block"], p["chunk"], p["topics"]) for p in result["problems"] if p["what"] == "missing"]
    assert found == [(1, chunk, ["verdicts"]) for chunk in range(4)]
    assert result["cells"] == 7


def test_a_kernel_with_other_bits_is_named_and_proves_nothing(runs: dict[str, Path]) -> None:
    def other(plan: Any, block: int) -> Any:
        for force, slip in block_streams(plan, block):
            values = cdr.decode("BridgeForce", force)
            yield cdr.encode("BridgeForce", {**values, "data": values["data"] * np.float32(1 + 2**-20)}), slip

    result = verify(runs["verdicts"], again=Again(Kernel(lambda _: "another", other), float("inf")))
    assert not result["ok"]
    assert all("so nothing is proved here" in p["what"] and "here is another" in p["what"] for p in result["problems"])
    assert [p["chunk"] for p in result["problems"]] == [0, 0, 0]


@pytest.mark.parametrize("mode", ["last", "verdicts"])
def test_a_replay_says_which_streams_it_lacks_and_what_would_do(runs: dict[str, Path], mode: str) -> None:
    before = sorted(runs[mode].iterdir())
    with pytest.raises(
        BagError, match=rf"record={mode}: the streams .* of [34] of 4 chunks .*bow verify --all.*--record"
    ):
        replay(runs[mode], ["corner=0.4"])
    assert sorted(runs[mode].iterdir()) == before


# ---- the recorder


@pytest.mark.parametrize(("mode", "streams"), [("last", 1), ("verdicts", 0)])
def test_streams_that_are_not_to_be_recorded_are_heard_and_counted_and_not_answered(tmp_path, mode, streams) -> None:
    sweep = SWEEPS[mode]
    session = recording.session(tmp_path / "run", sweep)
    try:
        for chunk in recording.chunks(sweep, 2):
            for topic in STREAMS:
                session.take(topic, getattr(chunk, topic), time.time_ns())
        assert session.senders == {(topic, "5" * 16) for topic in STREAMS}
        assert (session.passed, session.ignored) == (8 - 2 * streams, 0)
        assert kinds(session) == Counter({ReceiptKind.STREAMS: streams})
        session.take("stick_slip", b"rubbish", time.time_ns())
        session.take("stick_slip", recording.chunks(sweep, 2, run="f" * 16)[0].stick_slip, time.time_ns())
        assert session.ignored == 2
        for chunk in recording.chunks(sweep, 2):
            session.take("verdicts", chunk.verdicts, time.time_ns())
        assert kinds(session)[ReceiptKind.VERDICTS] == 4
        deadline = time.monotonic() + 60  # a thread syncs the file
        while not kinds(session)[ReceiptKind.BLOCK]:
            assert time.monotonic() < deadline
            session.repeat_receipts()
    finally:
        session.abandon()


TAKEN = st.tuples(
    st.integers(0, 2), st.integers(0, 3), st.sampled_from([*STREAMS, "verdicts"]), st.integers(1, 2), st.booleans()
)
"""Block, chunk, topic, attempt, and whether the message is torn."""


@pytest.mark.parametrize("mode", list(SWEEPS))
def test_every_message_is_stored_once_a_duplicate_not_to_be_recorded_or_ignored(tmp_path: Path, mode: str) -> None:
    sweep = SWEEPS[mode]

    @settings(max_examples=12, deadline=None)
    @given(begun=st.lists(st.sampled_from([0, 6, 11, 12, 12]), min_size=3, max_size=3), more=st.lists(TAKEN))
    def holds(begun: list[int], more: list[tuple[int, int, str, int, bool]]) -> None:
        order = [(chunk, topic) for chunk in range(4) for topic in (*STREAMS, "verdicts")]
        taken = [(block, *at, 1, False) for block, count in enumerate(begun) for at in order[:count]] + more
        run = Path(tempfile.mkdtemp(dir=tmp_path))
        data = recording.plan(sweep)
        session = Session(run, cdr.decode("Plan", data), data, "7" * 16, 0, sync=False, lock=False)
        stored = set()
        try:
            for block, chunk, topic, attempt, torn in taken:
                message = getattr(recording.chunks(sweep, block, attempt)[chunk], topic)
                session.take(topic, message[:40] if torn else message, 0)
                if not torn and (topic == "verdicts" or chunk in sweep.recorded_chunks):
                    stored.add((topic, block, chunk))
            found = session.stored
            assert len(found) == len(stored)
            assert len(taken) == len(found) + found.duplicates + session.passed + session.ignored
            assert session.ignored == sum(torn for *_, torn in taken)
            each = 4 + 2 * len(sweep.recorded_chunks)
            right = {block for block, count in Counter(block for _, block, _ in stored).items() if count == each}
            answer = session.commit(0)
            values = cdr.decode("Receipt", answer) if answer else {"kind": np.zeros(0), "block": np.zeros(0)}
            assert set(values["block"][values["kind"] == ReceiptKind.BLOCK].tolist()) == right
        finally:
            session.abandon()

    holds()


def kinds(session: Session) -> Counter[int]:
    """Commit; count the entries of the receipt."""
    message = session.commit(time.time_ns())
    return Counter(cdr.decode("Receipt", message)["kind"].tolist() if message else [])
