"""Cells computed in this process with their slips and verdicts: for claims about a few strings, and about slips."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bow_sim.physics.parameters import Parameters
from bow_sweep.beyond.sweeps import THRESHOLDS
from bow_sweep.maps.in_process import judged_chunks
from bow_sweep.maps.slips import Pieces, Slips, join

AT_ONCE = 512
"""Cells computed at once: what a block of a sweep has."""


class Motion(NamedTuple):
    """What some cells did.

    Parameters
    ----------
    slips : Slips
    regime : ndarray of uint8, shape (tests, cells)
        Code of the regime after every five periods.
    period : ndarray, shape (tests, cells)
        Measured period, samples; NaN where there is none.
    """

    slips: Slips
    regime: NDArray[np.uint8]
    period: NDArray[np.float32]


def compute(parameters: Parameters, lanes: Mapping[str, ArrayLike]) -> Motion:
    """Simulate and classify cells as a sweep does, with the thresholds of the claims.

    Parameters
    ----------
    parameters
        Common to all cells.
    lanes
        Name -> (cells,), what differs; as in :class:`bow_sim.kernel.block.Block`.

    Raises
    ------
    ParameterError
        For values that cannot be.
    """
    columns = {name: np.asarray(values, np.float64) for name, values in lanes.items()}
    count = len(next(iter(columns.values())))
    parts = []
    for first in range(0, count, AT_ONCE):
        part = _block(parameters, {name: x[first : first + AT_ONCE] for name, x in columns.items()})
        parts.append(part._replace(slips=part.slips._replace(cell=part.slips.cell + first)))
    slips = Slips(*(np.concatenate(column) for column in zip(*(part.slips for part in parts), strict=True)))
    regime, period = (np.concatenate([part[i] for part in parts], axis=1) for i in (1, 2))
    return Motion(slips, regime, period)


def _block(p: Parameters, lanes: Mapping[str, NDArray[np.float64]]) -> Motion:
    pieces, regimes, periods = [], [], []
    for c, verdict in judged_chunks(p, lanes, THRESHOLDS):
        regimes.append(verdict.regime)
        periods.append(verdict.period)
        pieces.append(Pieces(c.slipping, c.offsets, c.onset, c.duration, c.slip))
    return Motion(join(pieces, p.chunk_samples), *map(np.array, (regimes, periods)))
