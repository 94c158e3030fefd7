"""The messages of a chunk: the bytes of the encoder for any message, and the cells under inspection, to be plotted."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import recording

from bow_sim.block_request import BlockRequest, prepare
from bow_sim.chunk_messages import ChunkMessages
from bow_sim.protocol import cdr
from bow_sim.protocol.messages import STREAMS
from bow_sweep.plan.sweep import Sweep

STAMP = 1_700_000_000_987_654_321
SWEEP = recording.small_sweep("x.name=f_asym", "y.name=f_init_ratio")


def request(sweep: Sweep, block: int) -> BlockRequest:
    cells = sweep.block(block)
    axes = sweep.axis_values(cells)
    identity = {"run_id": recording.RUN, "sweep_id": sweep.sweep_id, "block": block, "attempt": 3}
    spec = {"spec.preset": "", "spec.settings": sweep.settings()}
    return prepare({**identity, **spec, "cells": cells, "x": axes[sweep.x.name], "y": axes[sweep.y.name]})


@pytest.mark.parametrize("block_cells", [2, 8, 11])
@pytest.mark.parametrize("more", [(), ("dtype=float32",), ("model=raman",)])
def test_their_bytes_are_those_of_the_encoder_for_any_message(block_cells: int, more: tuple[str, ...]) -> None:
    sweep = recording.small_sweep(f"block_cells={block_cells}", "periods=15", *more)
    for block in range(sweep.blocks):
        made, again = request(sweep, block), request(sweep, block)
        chunks = ChunkMessages(made, "5" * 16)
        for chunk in range(made.chunks):
            messages, shown = chunks.next(STAMP + chunk)
            assert not shown
            output = again.block.advance()
            samples = output.bridge_force.shape[1]
            values: dict[str, Any] = {name: made.message[name] for name in ("run_id", "sweep_id", "block", "attempt")}
            values |= {"chunk": chunk, "incarnation": "5" * 16, "cells": made.message["cells"], "samples": samples}
            values |= {"first_sample": chunk * samples, "stamp": STAMP + chunk, "header.stamp": STAMP + chunk}
            values |= {"data": output.bridge_force, **output._asdict()}
            assert messages == {topic: cdr.encode(name, values) for topic, name in STREAMS.items()}


def test_streams_and_inspected_cells_of_a_chunk_agree() -> None:
    cells, again = SWEEP.block(1), request(SWEEP, 1)
    lanes = SWEEP.lanes(cells)
    again.block.advance()
    output = again.block.advance()
    chunks = ChunkMessages(request(SWEEP, 1), "5" * 16, [int(cells[2]), 10**6, -1, int(cells[0])])
    chunks.next()
    messages, inspected = chunks.next(STAMP)
    force, slip = (cdr.unseal(name, messages.pop(topic)) for topic, name in STREAMS.items())
    assert not messages
    assert force["stamp"] == slip["header.stamp"] == STAMP
    assert slip["header.frame_id"] == "bow"
    shown = [cdr.unseal("InspectedCell", one) for one in inspected]
    assert [one["cell"] for one in shown] == [cells[0], cells[2]]
    for one, row in zip(shown, (0, 2), strict=True):
        for name in ("run_id", "sweep_id", "block", "chunk", "attempt", "incarnation", "first_sample"):
            assert one[name] == force[name] == slip[name]
        assert one["header.stamp"] == STAMP
        assert one["bridge_force"].tobytes() == output.bridge_force[row].tobytes()
        assert one["sample_rate"] == SWEEP.parameters.sample_rate
        np.testing.assert_allclose(one["periods"], 5 + np.arange(695) / 139, rtol=1e-6)
        x, y = lanes["f_asym"][row], lanes["f_init_ratio"][row]
        assert one["name"] == f"f_asym = {x:.4g}, f_init_ratio = {y:.4g}"


def test_the_messages_of_a_chunk_stay_as_they_are_when_the_next_is_computed() -> None:
    chunks = ChunkMessages(request(SWEEP, 0), "5" * 16)
    first = chunks.next()[0]
    before = {topic: bytes(message) for topic, message in first.items()}
    assert chunks.next()[0] != before
    assert first == before
