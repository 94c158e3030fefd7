"""Which cells have their waveforms shown where nobody has chosen any."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bow_sim.protocol.sweep_outline import SweepOutline

INSPECTED = 6
"""Cells whose waveforms the dashboard shows by default."""

SPREAD = -1
"""In place of cells, in the parameter `inspect` of a node: for each run those of :func:`spread_over`."""


def spread_cells(nx: int, ny: int, planned: NDArray[np.bool_]) -> list[int]:
    """Return cells that are spread over a plane, from those that are planned at first.

    Parameters
    ----------
    nx, ny
        Cells along x and y.
    planned
        (cells,) whether a cell is in a block of the first round.
    """
    columns = np.unique(np.linspace(0, nx - 1, INSPECTED // 2 + 2).astype(int)[1:-1])
    rows = np.unique(np.linspace(0, ny - 1, 4).astype(int)[1:-1])
    y, x = np.divmod(np.flatnonzero(planned), nx)
    nearest = [np.argmin((y - iy) ** 2 + (x - ix) ** 2) for iy in rows for ix in columns]
    return np.unique((y * nx + x)[nearest]).tolist()


def spread_over(outline: SweepOutline) -> list[int]:
    """Return the cells that are spread over the plane of an announced sweep, whatever its round."""
    first = np.zeros(outline.cells, bool)
    first[outline.planned.rounds[0]] = True
    return spread_cells(outline.x.count, outline.y.count, first)
