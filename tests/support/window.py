"""The compiled pass of the classifier over one window of any cells, with thresholds of each cell's own."""

from __future__ import annotations

from typing import Any

import numpy as np
from kinematics import N
from numpy.typing import ArrayLike, NDArray

from bow_classifier.chunk_pass import BlockState, Chunk, Lags, Result, Setup, Strings, classify_cells
from bow_classifier.features.first_slips import Releases
from bow_classifier.features.slips import Intervals, SlipState
from bow_classifier.features.wolf import WolfState
from bow_classifier.verdict.decision import Decision, Features, Limits
from bow_classifier.verdict.thresholds import Thresholds

NO_LAGS = (N, N + 1)
"""Two lags have no interior maximum: the first test finds no period."""


def no_slips(cells: int) -> Intervals:
    """Return the intervals of strings that stick throughout."""
    none = np.zeros(0, np.uint32)
    return Intervals(np.zeros(cells, np.uint8), np.zeros(cells + 1, np.uint32), none, none, np.zeros(0))


def one_slip(cells: int, which: ArrayLike) -> Intervals:
    """Return intervals with one slip, of 1, in the middle of a window, in those of the cells that are given."""
    count = np.zeros(cells, np.uint32)
    count[which] = 1
    ones = np.ones(int(count.sum()), np.uint32)
    offsets = np.concatenate([[0], np.cumsum(count)]).astype(np.uint32)
    return Intervals(np.zeros(cells, np.uint8), offsets, 20 * ones, ones, ones.astype(float))


def measure(
    record: NDArray[Any],
    start: int,
    *,
    period: int = N,
    near: tuple[int, int] = NO_LAGS,
    long: tuple[int, int] = (146, 435),
    delay: ArrayLike = 15,
    corner: ArrayLike = np.inf,
    spread: ArrayLike = 0.0,
    slip: ArrayLike = 0.5,
    gap: ArrayLike = 0.0,
    intervals: Intervals | None = None,
    state: SlipState | None = None,
    **limits: float,
) -> Features:
    """Return the features of cells in one window; heights are 1, so that loudness has the unit of the record.

    Parameters
    ----------
    record
        (cells, start + samples) bridge force; the window is ``record[:, start:]``.
    start
        Samples before the window.
    period
        Nominal period, samples.
    near, long
        First and last lag near the nominal period, and of the long ones; samples.
    delay, corner, spread, slip, gap
        As in `bow_classifier.chunk_pass.Strings`; one or (cells,).
    intervals
        Slips of the window; none unless given.
    state
        Before the window, changed to what it leaves; the string sticks unless given.
    limits
        Fields of `bow_classifier.verdict.decision.Limits` other than the usual ones.
    """
    cells = len(record)
    each = [np.array(np.broadcast_to(x, (cells,)), float) for x in (1.0, corner, slip, 0.0, spread, gap)]
    strings = Strings(np.array(np.broadcast_to(delay, (cells,)), np.int64), *each)
    usual = Limits.of(N, Thresholds())._replace(period=float(period), **limits)
    force = np.ascontiguousarray(record[:, start:], np.float32)
    force.flags.writeable = False
    before = np.ascontiguousarray(record[:, :start], np.float32)
    before.flags.writeable = False
    block = BlockState(before, state or SlipState.at_rest(cells), WolfState.empty(0, 5), Releases.none(0))
    result = Result(Features.empty(np.full(cells, 15 / 139)), Decision.empty(cells))
    chunk = Chunk(force, (intervals or no_slips(cells)).prepared(), 0)
    wrong = classify_cells(block, chunk, Setup(strings, Lags(*near, *long), usual, start), result)
    assert wrong == -1, f"the slips of cell {wrong} do not continue the chunk before, or cannot be"
    return result.features
