"""Windows of eight cells: the bridge force as it comes, (cells, samples), transposed so that each cell has its lane."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from bow_classifier.verdict.fingerprint import LEAN
from bow_sim.simd import columns, lanes
from bow_sim.simd.jit import part
from bow_sim.simd.lanes import LANES

load: Any = lanes.load  # for the type checker: intrinsics are called without their first argument
some_columns: Any = columns.columns
summed_columns: Any = columns.summed_columns


class EightCells(NamedTuple):
    """Eight cells, or those that are left: the last one then stands for those that are missing.

    Attributes
    ----------
    bridge_force, before
        (cells of the block, samples) float32, C-contiguous: the chunk, and what comes before it; 8 samples or more.
    first, number : int
        The first of the cells, and how many they are.
    """

    bridge_force: Any
    before: Any
    first: int
    number: int


@part(**LEAN)
def take_window(source, cells, begin, n, less, x, place):
    """Write n samples from `begin` on, less a level of each cell, to x from row `place` on.

    Parameters
    ----------
    source : ndarray of float32, shape (cells of the block, samples)
        One of the two arrays of `cells`.
    cells : EightCells
    begin, n : int
        Samples; n may be any number as long as they are all there.
    less : lanes of float64
        The level of each cell.
    x : ndarray of float64, flat
        Rows of eight cells. Up to seven rows beyond the n are changed, too, or before them where the record ends.
    place : int

    Returns
    -------
    lanes of float64
        Sum of the samples, less the level, and of their squares.
    """
    width = source.shape[1]
    at = cells.first * width + begin
    whole = n // LANES * LANES
    total, square, total_odd, square_odd = summed_columns(
        source, at, width, cells.number, whole, less, x, place * LANES
    )
    if whole < n:
        t = min(whole, width - LANES - begin)  # the last group of all overlaps the one before
        some_columns(source, at + t, width, cells.number, less, x, (place + t) * LANES)
        for row in range(place + whole, place + n - 1, 2):
            even, odd = load(x, row * LANES), load(x, (row + 1) * LANES)
            total, square = total + even, square + even * even
            total_odd, square_odd = total_odd + odd, square_odd + odd * odd
        if n % 2:
            last = load(x, (place + n - 1) * LANES)
            total, square = total + last, square + last * last
    return total + total_odd, square + square_odd


@part(nogil=True, error_model="numpy")
def line_aligned(size):
    """Return zeros, (size,) float64, that begin at a cache line; loads of eight that cross one take twice as long."""
    raw = np.zeros(size + LANES)
    start = -raw.ctypes.data % 64 // 8
    return raw[start : start + size]
