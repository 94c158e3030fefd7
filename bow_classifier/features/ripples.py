"""Schelleng ripples as lines of the bridge force's spectrum (S-motion, PHYSICS.md section 9).

S-motion is Helmholtz motion whose ripples, with the period bow-bridge-bow, have grown into a standing wave nearly as
large as the sawtooth: the harmonics of the string's period around 1/beta are then as strong as the first ones.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from bow_classifier.verdict.fingerprint import LEAN
from bow_sim.simd import elementary, lanes
from bow_sim.simd.jit import part
from bow_sim.simd.lanes import LANES

load: Any = lanes.load  # for the type checker: intrinsics are called without their first argument
spread: Any = lanes.spread
store: Any = lanes.store

LOW = 2
"""Harmonics that those of the ripples are compared with."""

BAND = 0.25
"""Harmonics within this share of 1/beta around 1/beta are those of the ripples."""


SLOTS = 16
"""Periods, in whole samples, whose turns are kept for the next cells."""


class Workspace(NamedTuple):
    """The arrays that `ripple_share` works in.

    Attributes
    ----------
    turns
        (SLOTS, 2, 8) float64: cosine and sine of one sample's phase, for eight harmonics.
    kept
        (SLOTS, 2) int64: the period in samples, and the first harmonic of the ripples, that they are for; 0 for none.
    power
        (8,) float64: the power of these harmonics.
    x
        (samples,) float64: one period less its mean.
    """

    turns: Any
    kept: Any
    power: Any
    x: Any


@part(nogil=True, error_model="numpy")
def ripple_workspace(samples):
    """Return the workspace for records of `samples`."""
    return Workspace(np.empty((SLOTS, 2, LANES)), np.zeros((SLOTS, 2), np.int64), np.empty(LANES), np.empty(samples))


@part(**LEAN)
def _powers(x, n, first, turns, kept, power):
    """Write the power of eight harmonics of the n samples of x to power: 1, 2, and six from number `first` on."""
    slot = n % SLOTS
    turn = turns[slot]
    if kept[slot, 0] != n or kept[slot, 1] != first:
        kept[slot, 0], kept[slot, 1] = n, first
        for k in range(LANES):
            number = k + 1 if k < LOW else first + k - LOW
            angle = 2.0 * math.pi * number / n
            turn[0, k], turn[1, k] = elementary.turn(angle)
    c, s = load(turn, 0), load(turn, LANES)
    u, v = spread(1.0), spread(0.0)
    a, b = spread(0.0), spread(0.0)
    for t in range(n):
        a, b = a + u * x[t], b + v * x[t]
        u, v = u * c - v * s, u * s + v * c
    store(power, 0, a * a + b * b)


@part(**LEAN)
def ripple_share(row, period, delay, workspace):
    """Return how strong the lines of the ripples are in the last period of the bridge force.

    Parameters
    ----------
    row : ndarray of float32, shape (samples,)
        Bridge force, one period or more.
    period : float
        Samples; rounded to a whole number.
    delay : int
        Ripple period, samples: round trip bow-bridge-bow.
    workspace : Workspace

    Returns
    -------
    float
        Amplitude of the strongest harmonic near 1/beta (above the second harmonic) over that of the stronger of the
        first two; inf where these are zero. A pure sawtooth has beta, about 0.1.
    """
    turns, kept, power, x = workspace
    end = row.shape[0]
    n = round(period)
    mean = 0.0
    for t in range(n):
        x[t] = row[end - n + t]
        mean += x[t]
    mean /= n
    for t in range(n):
        x[t] -= mean
    low, high = 0.0, 0.0
    ripples = n / delay
    first, last = max(3, math.ceil((1.0 - BAND) * ripples)), min(n // 2, math.floor((1.0 + BAND) * ripples))
    for k in range(first, last + 1, LANES - LOW):
        _powers(x, n, k, turns, kept, power)
        low = max(power[0], power[1])
        for lane in range(min(LANES - LOW, last + 1 - k)):
            high = max(high, power[LOW + lane])
    if not high > 0.0:
        return 0.0
    return math.sqrt(high / low) if low > 0.0 else np.inf
