"""A block to compute, as the coordinator's message describes it; checked before anything is computed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bow_sim.kernel.block import Block, ChunkResult
from bow_sim.physics.errors import ParameterError
from bow_sim.protocol import cdr
from bow_sim.protocol.limits import check_block
from bow_sim.protocol.sweep_spec import split


@dataclass(eq=False)
class BlockRequest:
    """A block to compute.

    Attributes
    ----------
    message
        The decoded Block message.
    block
        The kernel's block, at the beginning of its first chunk.
    """

    message: Mapping[str, Any]
    block: Block

    @property
    def key(self) -> tuple[int, int]:
        """Block and attempt."""
        return self.message["block"], self.message["attempt"]

    @property
    def chunks(self) -> int:
        """How many chunks the block has."""
        return self.block.parameters.chunks


def prepare(message: Mapping[str, Any]) -> BlockRequest:
    """Return the request for a decoded Block message, after checking everything in it.

    Raises
    ------
    ParameterError, ValueError
        If the block cannot be computed; the text names the setting, its value and what would be right.
    """
    lengths = {name: len(message[name]) for name in ("cells", "x", "y")}
    if len(set(lengths.values())) != 1 or not lengths["cells"]:
        raise ValueError(f"array lengths {lengths} should be equal and above 0")
    spec = split(message["spec.settings"])
    parameters = spec.parameters()
    planned = spec.number("x", "count") * spec.number("y", "count")
    check_block(len(message["cells"]), parameters)
    cells = np.asarray(message["cells"], dtype=np.int64)
    if cells.max() >= planned or len(np.unique(cells)) != len(cells):
        raise ParameterError(f"cells: should be different ones out of 0 ... {planned - 1}")
    lanes = {str(getattr(spec, axis).get("name")): np.array(message[axis], np.float64) for axis in ("x", "y")}
    return BlockRequest(message, Block(parameters, lanes))


def encode_chunk(
    request: BlockRequest, chunk: int, output: ChunkResult, incarnation: str, inspected: Sequence[int]
) -> tuple[tuple[bytes, bytes], bytes]:
    """Return the stream messages of a chunk as CDR bytes.

    Parameters
    ----------
    request, chunk
        The block, and the number of the chunk in it.
    output
        What the kernel returned for the chunk.
    incarnation
        Of the simulator.
    inspected
        Cells whose bridge force also goes out on `inspect`.

    Returns
    -------
    messages
        BridgeForce and StickSlip of all cells.
    inspect
        BridgeForce of the inspected cells; empty if the block has none of them.
    """
    samples = output.bridge_force.shape[1]
    values = {name: request.message[name] for name in ("run_id", "sweep_id", "block", "attempt")}
    cells = np.array(request.message["cells"], dtype=np.uint32)
    values |= {"chunk": chunk, "incarnation": incarnation, "cells": cells, "checksum": 0}
    values |= {"samples": samples, "first_sample": chunk * samples}
    messages = (
        cdr.encode("BridgeForce", values | {"data": output.bridge_force}),
        cdr.encode("StickSlip", values | {name: getattr(output, name) for name in cdr.INTERVAL_FIELDS}),
    )
    rows = np.flatnonzero(np.isin(cells, inspected))
    shown = {"cells": cells[rows], "data": output.bridge_force[rows]}
    return messages, cdr.encode("BridgeForce", values | shown) if rows.size else b""
