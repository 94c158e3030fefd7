"""Fetching the rows of the next cells into the cache while other work goes on.

A chunk is larger than the cache, and waiting for its rows took a fifth of the time. A processor has only some tens of
requests to memory under way at once: a fetch of all rows together would wait as well, so it is done a share at a time.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from bow_classifier.verdict.fingerprint import LEAN
from bow_sim.simd import columns
from bow_sim.simd.jit import part

prefetch: Any = columns.prefetch  # for the type checker: intrinsics are called without their first argument

_LINE = 16
"""Samples of float32 in a cache line."""


class NextRows(NamedTuple):
    """Rows first ... first + number - 1 of two arrays of float32, (cells, samples), C-contiguous."""

    bridge_force: Any
    history: Any
    first: int
    number: int


@part(**LEAN)
def _fetch(array, first, number, share, shares):
    begin, size = first * array.shape[1], number * array.shape[1]
    for at in range(begin + size * share // shares, begin + size * (share + 1) // shares, _LINE):
        prefetch(array, at)


@part(**LEAN)
def fetch(rows, share, shares):
    """Fetch one of so many equal shares of the `NextRows` into the cache, without waiting for it.

    Parameters
    ----------
    rows : NextRows
    share, shares : int
        Number of the share, from 0 on, and how many they are.
    """
    _fetch(rows.bridge_force, rows.first, rows.number, share, shares)
    _fetch(rows.history, rows.first, rows.number, share, shares)
