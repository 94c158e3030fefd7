"""Where the time loops of blocks find rows of rings and of gestures: compiled code only."""

from __future__ import annotations

from typing import Any

import numpy as np

from bow_sim.simd.jit import INLINE, OVERLOAD, overload, part
from bow_sim.simd.lanes import LANES, load, read, spread

STRIDE = 64 // LANES
"""Steps computed together: the states of eight lanes in these steps are the 64 bits of a number."""

ARRIVED = {
    "bridge": slice(0, STRIDE),
    "nut": slice(STRIDE, 2 * STRIDE),
    "torsion_nut": slice(2 * STRIDE, 3 * STRIDE),
    "torsion_bridge": slice(3 * STRIDE, 5 * STRIDE),
}
"""Rows of the workspace for what arrives in eight steps; from the torsional bridge, in the eight after these too."""

TOTALS = 5 * STRIDE
"""The first row of the sums of the slip speed in the workspace."""


@part(**INLINE)
def row_of(side: Any, group: Any, position: Any) -> Any:
    """Return the row of all rings for a position in a group's ring, from which on a window is contiguous."""
    position = position + side.length if position < -side.lead else position
    return group * side.ring.shape[1] + side.lead + position


def shape_at(table: Any, group: Any, t: Any) -> Any:
    """Return a gesture's shape at a step, eight lanes."""
    raise NotImplementedError


@overload(shape_at, strict=False, jit_options=OVERLOAD)
def _overload_shape_at(table: Any, group: Any, t: Any) -> Any:
    if table.ndim == 1:
        nothing = getattr(np, str(table.dtype))(0)
        return lambda table, group, t: spread(read(table, t, nothing))
    return lambda table, group, t: load(table, (group * table.shape[1] + t) * LANES)
