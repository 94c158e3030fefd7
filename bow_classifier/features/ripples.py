"""Schelleng ripples as lines of the bridge force's spectrum (S-motion, PHYSICS.md section 9).

S-motion is Helmholtz motion whose ripples, of the period bow-bridge-bow, have grown into a standing wave nearly as
large as the sawtooth: the harmonics of the string's period around 1/beta are then as strong as its first ones.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bow_classifier.verdict.fingerprint import LEAN, VERSION
from bow_sim.simd import lanes
from bow_sim.simd.jit import njit
from bow_sim.simd.lanes import LANES

load: Any = lanes.load  # intrinsics are called without the first argument that their types ask for
spread: Any = lanes.spread
store: Any = lanes.store

BAND = 0.25
"""Harmonics this far, in parts of it, from 1/beta are those of the ripples."""


@njit(**LEAN)
def _powers(x, n, first, turn, power):
    """Write the power of eight harmonics of the n samples of x, `first` and on, to power, (LANES,)."""
    for k in range(LANES):
        angle = 2.0 * math.pi * (first + k) / n
        turn[0, k], turn[1, k] = math.cos(angle), math.sin(angle)
    c, s = load(turn, 0), load(turn, LANES)
    u, v = spread(1.0), spread(0.0)
    a, b = spread(0.0), spread(0.0)
    for t in range(n):
        a, b = a + u * x[t], b + v * x[t]
        u, v = u * c - v * s, u * s + v * c
    store(power, 0, a * a + b * b)


@njit(**LEAN)
def ripple_share(row, period, delay, work):
    """Return what `ripple` says of one cell; `work` is room for turns, (2, LANES), powers, (LANES,), and samples."""
    turn, power, x = work
    end = row.shape[0]
    n = round(period)
    mean = 0.0
    for t in range(n):
        x[t] = row[end - n + t]
        mean += x[t]
    mean /= n
    for t in range(n):
        x[t] -= mean
    _powers(x, n, 1, turn, power)
    low, high = max(power[0], power[1]), 0.0
    ripples = n / delay
    first, last = max(3, math.ceil((1.0 - BAND) * ripples)), min(n // 2, math.floor((1.0 + BAND) * ripples))
    for k in range(first, last + 1, LANES):
        _powers(x, n, k, turn, power)
        for lane in range(min(LANES, last + 1 - k)):
            high = max(high, power[lane])
    if not high > 0.0:
        return 0.0
    return math.sqrt(high / low) if low > 0.0 else np.inf


def build(version: int) -> Any:
    """Make the compiled sums, to be cached as this version; see `bow_classifier.verdict.fingerprint`."""

    @njit(nogil=True, cache=True, error_model="numpy")
    def lines(record, period, delay, wanted, share):
        work = np.empty((2, LANES)), np.empty(LANES), np.empty(record.shape[1])
        for i in range(record.shape[0]):
            share[i] = ripple_share(record[i], period[i], delay[i], work) if wanted[i] else 0.0
        return version

    return lines


_lines = build(VERSION)


def ripple(
    record: NDArray[np.float32], period: NDArray[np.float32], delay: NDArray[np.int64], wanted: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return how strong the lines of the ripples are in the last period of the bridge force.

    Parameters
    ----------
    record
        (cells, samples) bridge force, one period at least.
    period
        (cells,) samples; taken to the nearest whole one.
    delay
        (cells,) ripple period, samples: round trip bow-bridge-bow.
    wanted
        (cells,) where to look; the others get 0. Their periods are numbers no longer than the record.

    Returns
    -------
    share
        (cells,) amplitude of the strongest harmonic within a quarter of 1/beta (and above the second), over that of the
        stronger of the first two; inf where these are nothing. A bare sawtooth has beta, about 0.1.
    """
    share = np.empty(len(record))
    _lines(np.ascontiguousarray(record), period, delay, wanted, share)
    return share
