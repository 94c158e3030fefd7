"""The messages of a chunk: what they have in common, and the cells under inspection in a form that tools can plot."""

import numpy as np
import recording

from bow_sim.block_request import STREAMS, encode_chunk, prepare
from bow_sim.protocol import cdr

SWEEP = recording.small_sweep("x.name=f_asym", "y.name=f_init_ratio")
STAMP = 1_700_000_000_987_654_321


def test_streams_and_inspected_cells_of_a_chunk_agree():
    cells = SWEEP.block(1)
    lanes = SWEEP.lanes(cells)
    spec = {"spec.preset": "", "spec.settings": SWEEP.settings()}
    identity = {"run_id": recording.RUN, "sweep_id": SWEEP.sweep_id, "block": 1, "attempt": 1}
    request = prepare({**identity, **spec, "cells": cells, "x": lanes["f_asym"], "y": lanes["f_init_ratio"]})
    request.block.advance()
    output = request.block.advance()
    asked = [int(cells[2]), 10**6, int(cells[0])]
    messages, shown = encode_chunk(request, 1, output, "5" * 16, asked, STAMP)
    force, slip = (cdr.unseal(name, messages.pop(topic)) for topic, name in STREAMS.items())
    assert not messages
    assert force["stamp"] == slip["header.stamp"] == STAMP
    assert slip["header.frame_id"] == "bow"
    shown = [cdr.unseal("InspectedCell", one) for one in shown]
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
