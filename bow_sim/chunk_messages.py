"""The chunks of a block as messages: computed, and written where they are computed."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bow_sim.block_request import BlockRequest, sweep_of
from bow_sim.physics.kinds import value_text
from bow_sim.protocol import cdr
from bow_sim.protocol.cdr_in_place import Template
from bow_sim.protocol.messages import STREAMS


class ChunkMessages:
    """Computes the chunks of a block and writes their messages. What these have in common is encoded once.

    Parameters
    ----------
    request
        The block. It is judged here if it has a judge.
    incarnation
        Of the simulator.
    inspected
        Cells whose bridge force also goes out on `inspect`.
    """

    def __init__(self, request: BlockRequest, incarnation: str, inspected: Iterable[int] = ()) -> None:
        self.request = request
        message, parameters = request.message, request.block.parameters
        identity = {name: message[name] for name in ("run_id", "sweep_id", "block", "attempt")}
        identity["incarnation"] = incarnation
        cells = np.array(message["cells"], dtype=np.uint32)
        self._samples = parameters.chunk_samples
        self._common = {**identity, "cells": cells, "samples": self._samples}
        self._force, self._slips = (Template(name, self._common) for name in STREAMS.values())
        self._period = parameters.period
        rows = np.flatnonzero(np.isin(cells, np.array(list(inspected), np.int64)))
        self._shown = {row: Template("InspectedCell", {**identity, **self._about(row)}) for row in rows.tolist()}

    def _about(self, row: int) -> dict[str, Any]:
        """Return what an InspectedCell says of the cell in a row of the block."""
        message, parameters = self.request.message, self.request.block.parameters
        names = sweep_of(tuple(message["spec.settings"])).axes
        places = [f"{name} = {value_text(name, message[axis][row])}" for axis, name in zip("xy", names, strict=True)]
        cell = self._common["cells"][row]
        return {"cell": cell, "name": ", ".join(places), "sample_rate": parameters.sample_rate}

    def next(self, stamp: int = 0, streams: bool = True) -> tuple[dict[str, cdr.Buffer], tuple[cdr.Buffer, ...]]:
        """Compute the next chunk and return its messages as CDR bytes.

        Parameters
        ----------
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
        block, judge = self.request.block, self.request.judge
        chunk, samples = block.chunk, self._samples
        numbers = {"chunk": chunk, "first_sample": chunk * samples, "stamp": stamp, "header.stamp": stamp}
        force, (data,) = self._force.begin([len(self._common["cells"]) * samples])
        output = block.advance(data.reshape(-1, samples))
        slips, checksum_of_slips = self._slips.write(numbers, output[1:])
        checksums = self._force.seal(force, numbers), checksum_of_slips
        messages: dict[str, cdr.Buffer] = dict(zip(STREAMS, (force, slips), strict=True)) if streams else {}
        if judge is not None:
            checksum = cdr.chunk_checksum(self._common["block"], chunk, *checksums)
            messages["verdicts"] = judge({**self._common, **numbers, "chunk_checksum": checksum}, output)
        shown = tuple(self._inspected_cell(row, output.bridge_force[row], numbers) for row in self._shown)
        return messages, shown

    def _inspected_cell(self, row: int, force: NDArray[np.float32], numbers: dict[str, int]) -> memoryview:
        periods = (numbers["first_sample"] + np.arange(len(force))) / self._period
        return self._shown[row].write(numbers, (periods, force))[0]
