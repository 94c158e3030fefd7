"""A simulator that judges its chunks gives the verdicts that the classifier gives of its streams, byte for byte."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest
import recording

from bow_classifier.at_source import Judges
from bow_sim.block_request import BlockRequest, prepare
from bow_sim.chunk_messages import ChunkMessages
from bow_sim.physics.errors import ParameterError
from bow_sim.protocol import cdr
from bow_sweep.plan.sweep import Sweep


def request(sweep: Sweep, block: int, judges: Judges, **changes: Any) -> BlockRequest:
    """Return a block of a sweep as a simulator takes it, to be judged by the sweep's plan with some changes."""
    plan = {**cdr.decode("Plan", recording.plan(sweep)), **changes}
    message = {name: plan[name] for name in ("run_id", "sweep_id", "spec.settings")}
    cells = sweep.block(block)
    axes = sweep.axis_values(cells)
    message |= {"block": block, "attempt": 1, "cells": cells, "x": axes[sweep.x.name], "y": axes[sweep.y.name]}
    return dataclasses.replace(prepare(message), judge=judges.of_block(plan, cells.tolist()))


@pytest.mark.parametrize(
    "more", [(), ("repeats=2", "jitter=0.02"), ("classifier.correlation=0.5",), ("dtype=float32",)]
)
def test_its_verdicts_are_those_of_the_classifier(more: tuple[str, ...]) -> None:
    sweep, judges = recording.small_sweep("record=verdicts", *more), Judges()
    for block in range(sweep.blocks):
        chunks = ChunkMessages(request(sweep, block, judges), "c" * 16)
        for chunk in recording.chunks(sweep, block):
            messages, _ = chunks.next(streams=False)
            assert messages == {"verdicts": chunk.verdicts}


def test_streams_go_out_with_the_verdicts_where_they_are_wanted() -> None:
    sweep = recording.small_sweep("record=verdicts")
    judged = request(sweep, 0, Judges())
    messages, _ = ChunkMessages(judged, "c" * 16).next()
    heads = [cdr.decode_head(name, messages[topic]) for topic, name in recording.STORED_ONCE.items()]
    assert [head["checksum"] for head in heads] == [
        cdr.decode_head(name, getattr(recording.chunks(sweep, 0)[0], topic))["checksum"]
        for topic, name in recording.STORED_ONCE.items()
    ]


def test_a_sweep_that_asks_for_another_classifier_is_refused() -> None:
    with pytest.raises(ParameterError, match="the plan wants classifier another, this is"):
        request(recording.small_sweep("record=verdicts"), 0, Judges(), classifier="another")


def test_another_run_is_judged_by_its_own_plan() -> None:
    judges = Judges()
    for correlation in (0.5, 0.99):
        sweep = recording.small_sweep("record=verdicts", f"classifier.correlation={correlation}")
        judged = request(sweep, 0, judges, run_id=f"{int(correlation * 100):016x}")
        messages, _ = ChunkMessages(judged, "c" * 16).next(streams=False)
        assert cdr.unseal("Verdicts", messages["verdicts"])["classifier"] == sweep.thresholds.hash
