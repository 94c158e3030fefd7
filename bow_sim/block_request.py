"""A block to compute, as the coordinator's message describes it; checked before anything is computed."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from bow_sim.kernel.block import Block, ChunkResult
from bow_sim.kernel.fingerprint import fingerprint
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.kinds import common
from bow_sim.physics.parameters import Parameters
from bow_sim.protocol import cdr
from bow_sim.protocol.limits import check_block
from bow_sim.protocol.recording import DEFAULT, record_of, recorded_chunks
from bow_sim.protocol.repeats import Repeats
from bow_sim.protocol.sweep_spec import Axis, split

Judge = Callable[[Mapping[str, Any], ChunkResult], cdr.Buffer]
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

    @functools.cached_property
    def key(self) -> tuple[int, int]:
        """Block and attempt."""
        return self.message["block"], self.message["attempt"]

    @functools.cached_property
    def run(self) -> tuple[str, str]:
        """run_id and sweep_id."""
        return self.message["run_id"], self.message["sweep_id"]

    @property
    def chunks(self) -> int:
        """How many chunks the block has."""
        return self.block.parameters.chunks

    @functools.cached_property
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


class Sweep(NamedTuple):
    """What the settings of a sweep say of all its blocks."""

    parameters: Parameters
    repeats: Repeats
    plane_cells: int
    axes: tuple[str, str]
    record: str


@functools.lru_cache(maxsize=8)
def sweep_of(settings: tuple[str, ...]) -> Sweep:
    """Return what settings say of all blocks; ParameterError or ValueError where they describe no sweep."""
    spec = split(settings)
    plane_cells = spec.number("x", "count") * spec.number("y", "count")
    axes = str(spec.x.get("name")), str(spec.y.get("name"))
    return Sweep(spec.parameters(), Repeats.of(spec), plane_cells, axes, record_of(spec.record))


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
    sweep = sweep_of(tuple(message["spec.settings"]))
    planned = sweep.repeats.cells(sweep.plane_cells)
    check_block(len(message["cells"]), sweep.parameters)
    cells = np.asarray(message["cells"], dtype=np.int64)
    if cells.max() >= planned or len(np.unique(cells)) != len(cells):
        raise ParameterError(f"cells: should be different ones out of 0 ... {planned - 1}")
    lanes = {name: np.array(message[axis], np.float64) for name, axis in zip(sweep.axes, "xy", strict=True)}
    own = common(sweep.parameters, sweep.repeats.vary(sweep.parameters, lanes, cells, sweep.plane_cells))
    return BlockRequest(message, Block(own.parameters, own.lanes), sweep.record)
