"""Fetching the rows of the next cells into the cache while other work goes on.

A chunk is larger than the cache, and waiting for its rows took a fifth of the time. A processor has only some tens of
requests to memory under way at once: a fetch of all rows together would wait as well, so it is done a share at a time.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from bow_classifier.verdict.fingerprint import LEAN
from bow_sim.simd import columns
from bow_sim.simd.jit import part
from bow_sim.simd.lanes import LANES

prefetch: Any = columns.prefetch  # for the type checker: intrinsics are called without their first argument

FIRST_TEST = 15
"""Shares of the bridge force that are fetched in the first test, three in each of five periods."""

SHARES = FIRST_TEST + LANES
"""All shares: one more with each of the cells after the first test."""

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
def fetch_share(rows, share):
    """Fetch one of the `SHARES` of the bridge force, without waiting for it; they count from 0."""
    begin, size = rows.first * rows.bridge_force.shape[1], rows.number * rows.bridge_force.shape[1]
    fetch_samples(rows.bridge_force, begin + size * share // SHARES, begin + size * (share + 1) // SHARES)


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
