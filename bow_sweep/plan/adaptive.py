"""Basin boundaries cheaper than exhaustively: which cells to simulate next, and what the others would say.

The paper hopes for it (section III.C). A sweep starts with a coarse grid and goes on in *rounds*; every round goes
where the map so far is least sure, that is, where the simulated cells around disagree whether Helmholtz motion comes
at all, or, in coloured terrain, how long it takes. What is never simulated is predicted from the cells around it.

Everything is a sum over the simulated cells within `RADIUS`, with whole-number weights that fall with distance, and
one division: a round does not depend on the machine, on the order of events or on anything but the cells before it.
Streaks need no special kernel: one stretched along them did no better on any of the maps (docs/adaptive.md).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics.parameters import CHUNK_PERIODS

STEP = 4
"""Rows and columns of the first round: every fourth, and both borders. One cell of 16."""

ROUNDS = 16
"""The whole plane would be simulated in so many rounds."""

RADIUS = 6
"""Cells further off than this, along x or y, say nothing."""

ROUGHNESS = 0.25
"""What it counts that the lengths of transients differ, where a tie between black and coloured counts 1."""

SURE = 0.1
"""A cell less uncertain than this is not worth a simulation: all around it say the same, and they are near."""

WORTH = 8
"""A round shorter than 1 / WORTH of a full one is not begun: all of it waits for its slowest block."""

_ONE = 4096
_DOUBT = _ONE // 20


def _weights(radius: int, square: int) -> NDArray[np.int64]:
    """Weights 1 / (1 + d^2 / square)^2 in units of 1 / _ONE, (2 radius + 1, 2 radius + 1); the middle has none."""
    r = np.arange(-radius, radius + 1)
    distance = r[:, None] ** 2 + r[None, :] ** 2
    weights: NDArray[np.int64] = square**2 * _ONE // (square + distance) ** 2
    weights[radius, radius] = 0
    return weights


WIDE = _weights(RADIUS, 4)
"""Half the weight at 1.3 cells: for black or coloured."""

NARROW = _weights(3, 1)
"""Half the weight at 0.6 cells: for the length of the transient, which slopes."""


def first_round(shape: tuple[int, int], budget: int) -> NDArray[np.uint32]:
    """Return the coarse grid a sweep begins with, (cells of the round,), as ascending cell indices iy * nx + ix.

    Parameters
    ----------
    shape
        (ny, nx) of the plane.
    budget
        Cells that may be simulated, 1 or more; the grid takes half of them at most, or else is coarser.
    """
    step = STEP
    while True:
        rows, columns = (np.unique([*range(0, count, step), count - 1]) for count in shape)
        if 2 * len(rows) * len(columns) <= budget or step > max(shape):
            break
        step += 1
    cells = (rows[:, None] * shape[1] + columns).ravel()
    return cells[:budget].astype(np.uint32)


def next_round(
    tried: NDArray[np.bool_], transient_periods: NDArray[np.floating], budget: int, most: int | None = None
) -> NDArray[np.uint32]:
    """Return the cells to simulate next, (cells of the round,), as ascending cell indices; none = enough is known.

    Parameters
    ----------
    tried
        (ny, nx), cells of the rounds before.
    transient_periods
        (ny, nx), periods until the tests first passed, 0 = never, NaN = not known: not tried, or given up.
    budget
        Cells that may be simulated in all.
    most
        Cells of the round at most; 1 / `ROUNDS` of the plane unless given.
    """
    if not tried.any():
        return first_round(tried.shape, budget)
    left = max(0, budget - np.count_nonzero(tried))
    most = max(1, tried.size // ROUNDS) if most is None else most
    doubt = np.where(tried, -1.0, uncertainty(transient_periods)).ravel()
    order = np.argsort(-doubt, kind="stable")[: min(left, most)]
    cells = np.sort(order[doubt[order] > SURE]).astype(np.uint32)
    return cells if WORTH * len(cells) >= most else cells[:0]


def uncertainty(transient_periods: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return how little the cells around tell of a cell, (ny, nx): 0 = all, 1 = nothing; up to `ROUGHNESS` more.

    It is `1 - |share coloured - share black|`, by weight, plus `ROUGHNESS` times the share coloured times s / (1 + s),
    s being the variance of the transient's length in units of one test interval squared.
    """
    known, coloured, length, square = _around(transient_periods, WIDE)
    certain = np.abs(2 * coloured - known) / (known + _DOUBT)
    some = np.maximum(coloured, 1)
    variance = np.maximum(square / some - (length / some) ** 2, 0.0)
    rough = coloured / (known + _DOUBT) * (variance / (1.0 + variance))
    doubt: NDArray[np.float64] = 1.0 - certain + ROUGHNESS * rough
    return doubt


def fill(transient_periods: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the map with what is not known predicted from the cells around, (ny, nx) float32.

    Black or coloured is what the greater weight of the known cells within `RADIUS` says, black in a tie; the length is
    the mean of the coloured ones near by, to the next test. NaN stays where nothing is known within `RADIUS`.

    Parameters
    ----------
    transient_periods
        As for :func:`next_round`.
    """
    known, coloured, far_length, _ = _around(transient_periods, WIDE)
    _, near, length, _ = _around(transient_periods, NARROW)
    total, count = np.where(near, length, far_length), np.where(near, near, coloured)
    mean = (2 * total + count) // np.maximum(2 * count, 1)  # rounded, halves up
    predicted = np.where(2 * coloured > known, mean * CHUNK_PERIODS, 0).astype(np.float32)
    predicted[known == 0] = np.nan
    return np.where(np.isnan(transient_periods), predicted, transient_periods).astype(np.float32)


def _around(transient_periods: NDArray[np.floating], weights: NDArray[np.int64]) -> NDArray[np.int64]:
    """Sum over the known cells around each: 1, coloured, length and its square in test intervals; (4, ny, nx)."""
    known = ~np.isnan(transient_periods)
    tests = np.rint(np.where(known, transient_periods, 0) / CHUNK_PERIODS).astype(np.int64)
    layers = np.stack([known, tests > 0, tests, tests**2]).astype(np.int64)
    radius, (ny, nx) = len(weights) // 2, known.shape
    padded = np.pad(layers, ((0, 0), (radius, radius), (radius, radius)))
    out = np.zeros_like(layers)
    for (iy, ix), weight in np.ndenumerate(weights):
        if weight:
            out += weight * padded[:, iy : iy + ny, ix : ix + nx]
    return out


def within_budget(fraction: float, cells: int) -> int:
    """Return how many of `cells` a fraction of them is, at least 1."""
    return max(1, int(fraction * cells))
