"""A block to compute, as the coordinator's message gives it, checked before anything is computed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from bow_sim.kernel.block import Block
from bow_sim.physics.errors import ParameterError
from bow_sim.protocol.limits import check_block
from bow_sim.protocol.sweep_spec import split


@dataclass(eq=False)
class Job:
    """A block to compute, as the coordinator's message gives it."""

    message: Mapping[str, Any]
    block: Block

    @property
    def key(self) -> tuple[int, int]:
        """Block and attempt."""
        return self.message["block"], self.message["attempt"]


def prepare(message: Mapping[str, Any]) -> Block:
    """Return the kernel's block for a message, everything in it checked.

    Raises
    ------
    ParameterError, ValueError
        Where it is none that can be computed.
    """
    spec = split(message["spec.settings"])
    parameters = spec.parameters()
    planned = spec.number("x", "count") * spec.number("y", "count")
    check_block(len(message["cells"]), parameters)
    cells = np.asarray(message["cells"], dtype=np.int64)
    if cells.max() >= planned or len(np.unique(cells)) != len(cells):
        raise ParameterError(f"cells: should be different ones out of 0 ... {planned - 1}")
    lanes = {str(getattr(spec, axis).get("name")): np.array(message[axis], np.float64) for axis in ("x", "y")}
    return Block(parameters, lanes)
