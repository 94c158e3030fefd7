"""Adaptive sweeps: which cells to simulate next, and a prediction of the others.

The paper hopes for a cheaper way to find the boundaries of a basin (section III.C). A sweep starts with a coarse grid
and continues in *rounds*. A round takes the cells whose prediction is most uncertain: where the simulated cells near
by disagree whether Helmholtz motion comes or, if it does, after how many periods. Cells that are never simulated are
predicted from the cells near by.

All numbers are sums over the simulated cells within `RADIUS`, with integer weights that fall with distance, and one
division at the end. So a round depends only on the results of the rounds before, not on the machine or on the order in
which the results came. Streaks need no special weights: weights stretched along them did no better on any map
(docs/adaptive.md).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics.parameters import CHUNK_PERIODS

STEP = 4
"""The first round has every fourth row and column, and the borders: one cell of 16."""

ROUNDS = 16
"""A full round has this part of the plane."""

RADIUS = 6
"""Distance along x and y, in cells, up to which a simulated cell counts in a prediction."""

ROUGHNESS = 0.25
"""Weight of the variance of transient lengths in the uncertainty; a tie between black and coloured has weight 1."""

SURE = 0.1
"""Cells with less uncertainty are not simulated: all cells near by agree."""

WORTH = 8
"""Skip rounds below 1 / WORTH of full size; each round ends with its slowest block."""

_ONE = 4096
"""Weight 1 as an integer."""

_PRIOR = _ONE // 20
"""Added to the weight of the known cells: a few far cells that agree do not make a prediction certain."""


def _weights(radius: int, square: int) -> NDArray[np.int64]:
    """Return weights 1 / (1 + d^2 / square)^2 in units of 1 / _ONE, (2 radius + 1, 2 radius + 1); 0 in the middle."""
    r = np.arange(-radius, radius + 1)
    distance = r[:, None] ** 2 + r[None, :] ** 2
    weights: NDArray[np.int64] = square**2 * _ONE // (square + distance) ** 2
    weights[radius, radius] = 0
    return weights


WIDE = _weights(RADIUS, 4)
"""For the decision black or coloured; half the weight at 1.3 cells."""

NARROW = _weights(3, 1)
"""For the transient length, which changes gradually; half the weight at 0.6 cells."""


def first_round(shape: tuple[int, int], budget: int) -> NDArray[np.uint32]:
    """Return the coarse grid that a sweep starts with, (cells of the round,): ascending cell indices iy * nx + ix.

    Parameters
    ----------
    shape
        (ny, nx) of the plane.
    budget
        Number of cells that may be simulated, 1 or more. The grid takes at most half of them; else it is made coarser.
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
    planned: NDArray[np.bool_], transient_periods: NDArray[np.floating], budget: int, most: int | None = None
) -> NDArray[np.uint32]:
    """Return the cells to simulate next, (cells of the round,): ascending cell indices; none where enough is known.

    Parameters
    ----------
    planned
        (ny, nx), whether a cell is in one of the rounds before.
    transient_periods
        (ny, nx), periods until the tests first passed, 0 = never, NaN = unknown: not planned, or given up.
    budget
        Number of cells that may be simulated in all rounds together.
    most
        Largest number of cells of the round; 1 / `ROUNDS` of the plane unless given.
    """
    if not planned.any():
        return first_round(planned.shape, budget)
    left = max(0, budget - np.count_nonzero(planned))
    most = max(1, planned.size // ROUNDS) if most is None else most
    uncertain = np.where(planned, -1.0, uncertainty(transient_periods)).ravel()
    order = np.argsort(-uncertain, kind="stable")[: min(left, most)]
    cells = np.sort(order[uncertain[order] > SURE]).astype(np.uint32)
    return cells if WORTH * len(cells) >= most else cells[:0]


def uncertainty(transient_periods: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return how uncertain the prediction of each cell is, (ny, nx): 0 = certain, 1 + `ROUGHNESS` = unknown.

    It is 1 - abs(share coloured - share black), by weight, plus `ROUGHNESS` times share coloured times s / (1 + s),
    where s is the variance of the transient length in units of the test interval squared.

    Parameters
    ----------
    transient_periods
        As for :func:`next_round`.
    """
    known, coloured, length, square = _around(transient_periods, WIDE)
    certain = np.abs(2 * coloured - known) / (known + _PRIOR)
    some = np.maximum(coloured, 1)
    variance = np.maximum(square / some - (length / some) ** 2, 0.0)
    rough = coloured / (known + _PRIOR) * (variance / (1.0 + variance))
    result: NDArray[np.float64] = 1.0 - certain + ROUGHNESS * rough
    return result


def fill(transient_periods: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the map with its unknown cells predicted, (ny, nx) float32.

    A cell is predicted coloured where the coloured cells within `RADIUS` have more weight than the black ones, else
    black. Its length is the weighted mean of the coloured cells near by, rounded to a test. NaN stays where no cell
    within `RADIUS` is known.

    Parameters
    ----------
    transient_periods
        As for :func:`next_round`.
    """
    known, coloured, far_length, _ = _around(transient_periods, WIDE)
    _, near, length, _ = _around(transient_periods, NARROW)
    total, count = np.where(near, length, far_length), np.where(near, near, coloured)
    mean = (2 * total + count) // np.maximum(2 * count, 1)  # round half up
    predicted = np.where(2 * coloured > known, mean * CHUNK_PERIODS, 0).astype(np.float32)
    predicted[known == 0] = np.nan
    return np.where(np.isnan(transient_periods), predicted, transient_periods).astype(np.float32)


def _around(transient_periods: NDArray[np.floating], weights: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return weighted sums over the known cells near each, (4, ny, nx): 1, coloured, length, length squared.

    Lengths are in test intervals, rounded up: Guettler's transient is no whole number of them, and never 0.
    """
    known = ~np.isnan(transient_periods)
    tests = np.ceil(np.where(known, transient_periods, 0) / CHUNK_PERIODS).astype(np.int64)
    layers = np.stack([known, tests > 0, tests, tests**2]).astype(np.int64)
    radius, (ny, nx) = len(weights) // 2, known.shape
    padded = np.pad(layers, ((0, 0), (radius, radius), (radius, radius)))
    out = np.zeros_like(layers)
    for (iy, ix), weight in np.ndenumerate(weights):
        if weight:
            out += weight * padded[:, iy : iy + ny, ix : ix + nx]
    return out


def within_budget(fraction: float, cells: int) -> int:
    """Return a fraction of a number of cells as a number of cells, 1 or more."""
    return max(1, int(fraction * cells))
