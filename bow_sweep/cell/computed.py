"""Cells computed again by the kernel that simulators use, and whether they are the recorded ones.

The bits of a cell do not depend on the cells it is computed with (:mod:`bow_sim.kernel.block`), so a cell computed
alone has the samples that it had in its block, where the kernel is the same: same sources, compilers and processor
(:func:`bow_sim.kernel.fingerprint.fingerprint`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from bow_sim.block_request import BlockRequest
from bow_sim.chunk_messages import ChunkMessages
from bow_sim.kernel.block import Block
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.kinds import common
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sweep.cell.cell_record import CellTests
from bow_sweep.cell.parameters import Plane, lanes
from bow_sweep.cell.waveform import CellError, Waveform, joined, part_of
from bow_sweep.maps.basin_map import Basin
from bow_sweep.maps.in_process import verdicts
from bow_sweep.plan.sweep import Sweep
from bow_sweep.record.again import Kernel, checksum


def compute(plane: Plane, cell: int, periods: int | None = None) -> Waveform:
    """Compute one cell.

    Parameters
    ----------
    plane
        The sweep, or its outline.
    cell
        Index in the map.
    periods
        Nominal periods to compute, in whole chunks of five; None: as many as the sweep has. More periods begin with
        the same samples.

    Raises
    ------
    CellError
        For values that cannot be simulated.
    """
    shared = plane.parameters if periods is None else plane.parameters.replace(periods=periods)
    try:
        block = Block(*common(shared, lanes(plane, np.array([cell])))[:2])
    except ParameterError as error:
        raise CellError(f"cell {cell}: {error}") from None
    parts = []
    for _ in range(shared.chunks):
        chunk = block.advance()
        parts.append(part_of(0, shared.chunk_samples, chunk.bridge_force.reshape(-1), chunk._asdict()))
    return joined(parts, shared.chunk_samples)


def judged(sweep: Sweep, cell: int) -> tuple[CellTests, float]:
    """Simulate and classify one cell; return what the tests say of it, and its transient length in periods.

    The transient length is 0 where the tests never passed. Thresholds are those of the sweep.
    """
    basin = Basin(1, 1, sweep.chunks)
    for test, verdict in enumerate(verdicts(sweep.parameters, lanes(sweep, np.array([cell])), sweep.thresholds)):
        basin.take(test, np.zeros(1, int), verdict._asdict())
    return CellTests.of({name: layer[:, 0] for name, layer in basin.layers.items()}), float(basin.transient_periods[0])


def chunk_checksums(plane: Plane, block: int, cells: np.ndarray) -> list[int]:
    """Compute a whole block again; return the checksum of each of its chunks, as receipts and verdicts state it.

    Parameters
    ----------
    block, cells
        Number of the block, and its cells.
    """
    identity = {"run_id": "", "sweep_id": "", "block": block, "cells": cells}
    return [checksum(*messages) for messages in _messages(plane, identity)]


def kernel() -> Kernel:
    """Return the kernel of this machine, for what computes blocks of a bag again."""
    from bow_sim.kernel.fingerprint import fingerprint

    return Kernel(lambda outline: fingerprint(outline.parameters, outline.x, outline.y), block_streams)


def block_streams(outline: SweepOutline, block: int) -> Iterator[tuple[bytes, bytes]]:
    """Compute a block again; yield the messages BridgeForce and StickSlip of each of its chunks.

    Raises
    ------
    ParameterError
        For values that cannot be simulated.
    """
    identity = {"run_id": outline.run_id, "sweep_id": outline.sweep_id, "block": block, "cells": outline.block(block)}
    yield from _messages(outline, identity)


def _messages(plane: Plane, identity: Mapping[str, Any]) -> Iterator[tuple[bytes, bytes]]:
    block = Block(*common(plane.parameters, lanes(plane, identity["cells"]))[:2])
    request = BlockRequest({**identity, "attempt": 0}, block)
    chunks = ChunkMessages(request, "")
    for _ in range(request.chunks):
        messages, _ = chunks.next()
        yield bytes(messages["bridge_force"]), bytes(messages["stick_slip"])
