"""Fetching the rows of the next cells into the cache while other work goes on.

A chunk is larger than the cache, and waiting for its rows took a fifth of the time. A processor has only some tens of
requests to memory under way at once: a fetch of all rows together would wait as well, so a row is fetched with each
cell, a third of it at a time.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from bow_classifier.verdict.fingerprint import LEAN
from bow_sim.simd import columns
from bow_sim.simd.jit import part

prefetch: Any = columns.prefetch  # for the type checker: intrinsics are called without their first argument

_LINE = 16
"""Samples of float32 in a cache line."""


class NextRows(NamedTuple):
    """Eight rows, or those that are left, of two arrays of float32, (cells, samples), C-contiguous.

    Attributes
    ----------
    bridge_force
        All of a row is fetched.
    before
        Only the last `near` samples of a row are.
    near
        Samples.
    first, number : int
        The first of the rows, and how many they are.
    """

    bridge_force: Any
    before: Any
    near: int
    first: int
    number: int


@part(**LEAN)
def fetch_third(rows, lane, third):
    """Fetch a third (0, 1 or 2) of the bridge force of one of the rows, without waiting for it; lanes count from 0."""
    if lane < rows.number:
        samples = rows.bridge_force.shape[1]
        begin = (rows.first + lane) * samples
        fetch_samples(rows.bridge_force, begin + third * samples // 3, begin + (third + 1) * samples // 3)


@part(**LEAN)
def fetch_before(rows, lane):
    """Fetch what precedes the bridge force of one of the rows, without waiting for it; lanes count from 0."""
    if lane < rows.number:
        end = (rows.first + lane + 1) * rows.before.shape[1]
        fetch_samples(rows.before, end - rows.near, end)


@part(**LEAN)
def fetch_samples(array, begin, end):
    """Fetch samples begin ... end - 1 of a flat array of float32, without waiting for them."""
    for at in range(begin, end, _LINE):
        prefetch(array, at)
    prefetch(array, end - 1)


@part(**LEAN)
def fetch_intervals(intervals, rows):
    """Fetch the slip intervals of the rows, without waiting for them."""
    if rows.number > 0:
        begin, end = np.int64(intervals.offsets[rows.first]), np.int64(intervals.offsets[rows.first + rows.number])
        for at in range(begin, end, _LINE):
            prefetch(intervals.onset, at)
            prefetch(intervals.duration, at)
            prefetch(intervals.slip, at)
            prefetch(intervals.slip, at + _LINE // 2)
