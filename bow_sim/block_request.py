"""A block to compute, as the coordinator's message describes it; checked before anything is computed."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bow_sim.kernel.block import Block, ChunkResult
from bow_sim.kernel.fingerprint import fingerprint
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.kinds import common, value_text
from bow_sim.protocol import cdr
from bow_sim.protocol.limits import check_block
from bow_sim.protocol.recording import DEFAULT, record_of, recorded_chunks
from bow_sim.protocol.repeats import Repeats
from bow_sim.protocol.sweep_spec import Axis, split

STREAMS = {"bridge_force": "BridgeForce", "stick_slip": "StickSlip"}
"""Topic -> message, of the two messages of a chunk."""

Judge = Callable[[Mapping[str, Any], ChunkResult], bytes]
"""Judges the chunks of one block, in their order: takes the fields that the stream messages of a chunk share with its
Verdicts, and the chunk; returns the Verdicts as CDR bytes. ``chunk_checksum`` is among the fields."""


@dataclass(eq=False)
class BlockRequest:
    """A block to compute.

    Attributes
    ----------
    message
        The decoded Block message.
    block
        The kernel's block, at the beginning of its first chunk.
    record
        Which of its streams are recorded, see :mod:`bow_sim.protocol.recording`.
    judge
        Judges its chunks where they are computed; None: the classifier judges them.
    """

    message: Mapping[str, Any]
    block: Block
    record: str = DEFAULT
    judge: Judge | None = None

    @property
    def key(self) -> tuple[int, int]:
        """Block and attempt."""
        return self.message["block"], self.message["attempt"]

    @property
    def chunks(self) -> int:
        """How many chunks the block has."""
        return self.block.parameters.chunks

    @property
    def recorded(self) -> range:
        """The chunks whose streams are recorded."""
        return recorded_chunks(self.record, self.chunks)


@functools.lru_cache(maxsize=8)
def fingerprint_of(settings: tuple[str, ...]) -> str:
    """Return what this machine computes for a sweep (:func:`bow_sim.kernel.fingerprint.fingerprint`).

    Raises
    ------
    ParameterError
        If the settings describe no sweep.
    """
    spec = split(settings)
    return fingerprint(spec.parameters(), Axis.of("x", spec.x), Axis.of("y", spec.y))


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
    repeats, plane_cells = Repeats.of(spec), spec.number("x", "count") * spec.number("y", "count")
    planned = repeats.cells(plane_cells)
    check_block(len(message["cells"]), parameters)
    cells = np.asarray(message["cells"], dtype=np.int64)
    if cells.max() >= planned or len(np.unique(cells)) != len(cells):
        raise ParameterError(f"cells: should be different ones out of 0 ... {planned - 1}")
    lanes = {str(getattr(spec, axis).get("name")): np.array(message[axis], np.float64) for axis in ("x", "y")}
    own = common(parameters, repeats.vary(parameters, lanes, cells, plane_cells))
    return BlockRequest(message, Block(own.parameters, own.lanes), record_of(spec.record))


def encode_chunk(
    request: BlockRequest,
    chunk: int,
    output: ChunkResult,
    incarnation: str,
    inspected: Sequence[int],
    stamp: int = 0,
    streams: bool = True,
) -> tuple[dict[str, bytes], tuple[bytes, ...]]:
    """Return the messages of a chunk as CDR bytes. It is judged here if its block has a judge.

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
    stamp
        Of the messages, nanoseconds since 1970.
    streams
        Whether the streams are wanted: of a chunk that is judged here they need not be.

    Returns
    -------
    messages
        Topic -> message of all cells: BridgeForce and StickSlip where they are wanted, Verdicts where it is judged.
    inspect
        An InspectedCell for each inspected cell of the block.
    """
    samples = output.bridge_force.shape[1]
    values = {name: request.message[name] for name in ("run_id", "sweep_id", "block", "attempt")}
    cells = np.array(request.message["cells"], dtype=np.uint32)
    values |= {"chunk": chunk, "incarnation": incarnation, "cells": cells, "checksum": 0}
    values |= {"samples": samples, "first_sample": chunk * samples, "stamp": stamp, "header.stamp": stamp}
    contents: dict[str, dict[str, Any]] = {
        "BridgeForce": values | {"data": output.bridge_force},
        "StickSlip": values | {name: getattr(output, name) for name in cdr.INTERVAL_FIELDS},
    }
    messages: dict[str, bytes] = {}
    if streams:
        messages = {topic: cdr.encode(name, contents[name]) for topic, name in STREAMS.items()}
    if request.judge is not None:
        checksums = (cdr.checksum_of(name, content) for name, content in contents.items())
        checksum = cdr.chunk_checksum(values["block"], chunk, *checksums)
        messages["verdicts"] = request.judge(values | {"chunk_checksum": checksum}, output)
    rows = sorted({row for cell in inspected for row in np.flatnonzero(cells == cell).tolist()})
    shown = tuple(_inspected_cell(request, values, row, output.bridge_force[row]) for row in rows)
    return messages, shown


def _inspected_cell(request: BlockRequest, values: Mapping[str, Any], row: int, force: NDArray[np.float32]) -> bytes:
    """Return the InspectedCell of the cell in a row of the block; `values` has the chunk's identity and samples."""
    spec, parameters = split(request.message["spec.settings"]), request.block.parameters
    names = [str(getattr(spec, axis).get("name")) for axis in ("x", "y")]
    places = [
        f"{name} = {value_text(name, request.message[axis][row])}" for axis, name in zip("xy", names, strict=True)
    ]
    periods = (values["first_sample"] + np.arange(values["samples"])) / parameters.period
    own = {"cell": values["cells"][row], "name": ", ".join(places), "sample_rate": parameters.sample_rate}
    return cdr.encode("InspectedCell", {**values, **own, "periods": periods, "bridge_force": force})
