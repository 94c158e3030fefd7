"""Taps of cells that differ, as lanes: a group of eight cells has a window that contains all their lags."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bow_sim.simd.lanes import LANES, aligned


def windows(
    functions: Sequence[tuple[int, tuple[float, ...]]], dtype: Any, even: bool = False, least: int = 0
) -> tuple[NDArray[Any], NDArray[np.int64], NDArray[np.int64]]:
    """Lay out taps at each lane's own lags, zeros elsewhere.

    Parameters
    ----------
    functions : sequence of (int, tuple of float)
        The least lag of each lane, samples, and its taps from there on; whole groups.
    dtype : dtype
    even : bool
        Let each group need an even number of taps.
    least : int
        If odd, the greatest lag of each group is made odd, and at least this; then there is a tap for each lag from 1
        on, beyond those that a group needs.

    Returns
    -------
    taps : ndarray, shape (groups, taps, 8)
        That of the greatest lag first.
    count : ndarray, shape (groups,)
        How many of them a group needs; beyond them all are 0.
    last : ndarray, shape (groups,)
        The greatest lag of a group, samples.
    """
    first = np.array([lag for lag, _ in functions]).reshape(-1, LANES)
    last = np.array([lag + len(taps) - 1 for lag, taps in functions]).reshape(-1, LANES).max(axis=1)
    if least:
        last = np.maximum(last, least) | 1
    count = last - first.min(axis=1) + 1
    count += count % 2 if even else 0
    table: NDArray[Any] = aligned((len(last), int((last if least else count).max()), LANES), dtype)
    for i, (lag, taps) in enumerate(functions):
        group, lane = divmod(i, LANES)
        oldest = last[group] - (lag + len(taps) - 1)
        table[group, oldest : oldest + len(taps), lane] = taps[::-1]
    return table, count, last
