"""Where two motions part: the deciding step, the parting, and what kind of edge lies between them.

PHYSICS.md section 15.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

APART = 0.3
"""Difference of bridge forces, r.m.s. over a period in units of the final bow speed, from which motions have parted."""

DECIDES_WITHIN = 2
"""Periods from the deciding step to the parting of a *decision*, at most."""

UNSTABLE_SLOPE = 1.0
"""Periods by which the parting of an *unstable* motion is later, at least, where the bracket is narrower by e."""

FIRST_HALVING, FEWEST, DIFFERENT = 12, 8, 4
"""The slope is fitted to the halvings from this one on, whose brackets are at most 1/4096 of a cell; to the last eight
that have a parting where these are fewer. It is 0 unless there are four different partings among them: one that moves
once or twice is not later and later."""

KINDS = ("decision", "grain", "unstable", "threshold")
"""Kinds of edges.

*decision*: the motions part within two periods of the deciding step, a critical event. *grain*: later; an earlier slip
moved by one sample, and the grid of samples is too coarse to come nearer. *unstable*: the narrower the bracket, the
later they part; a small difference grows. *threshold*: they have not parted at the end; only a threshold of the verdict
lies between them."""

DECISION, GRAIN, UNSTABLE, THRESHOLD = range(len(KINDS))


class Parting(NamedTuple):
    """How pairs of motions differ; arrays of shape (pairs,).

    Parameters
    ----------
    step : ndarray of int64
        The deciding step: first sample at which one slips and the other does not; -1 for none.
    release : ndarray of bool
        Whether one of them was released there; else one was captured.
    period : ndarray of int64
        The parting: first nominal period, counted from 0, whose bridge forces differ by more than `APART`; -1 for none.
    """

    step: NDArray[np.int64]
    release: NDArray[np.bool_]
    period: NDArray[np.int64]


def part(
    force: tuple[NDArray[np.float32], NDArray[np.float32]],
    slipping: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    period: int,
    speed: float | NDArray[np.float64] = 1.0,
) -> Parting:
    """Compare pairs of motions.

    Parameters
    ----------
    force, slipping
        (pairs, samples) each: bridge force, and state after each step, of the first and the second of each pair.
    period
        Nominal period, samples.
    speed
        Final bow speed, one or (pairs,).
    """
    differs = slipping[0] != slipping[1]
    any_step = differs.any(axis=1)
    step = np.where(any_step, differs.argmax(axis=1), -1)
    before = np.take_along_axis(slipping[0], np.maximum(step - 1, 0)[:, None], axis=1)[:, 0]
    release = any_step & ~(before & (step > 0))
    apart = _rms(force[0], force[1], period) > APART * np.reshape(speed, (-1, 1))
    parting = np.where(apart.any(axis=1), apart.argmax(axis=1), -1)
    return Parting(step, release, parting)


def _rms(a: NDArray[np.float32], b: NDArray[np.float32], period: int) -> NDArray[np.float64]:
    """Return the r.m.s. difference in each nominal period, (pairs, periods)."""
    difference = np.subtract(a, b, dtype=np.float64).reshape(len(a), a.shape[1] // period, period)
    return np.sqrt(np.einsum("ijk,ijk->ij", difference, difference) / period)


def slope_of(width: NDArray[np.float64], period: NDArray[np.int64]) -> float:
    """Return by how many periods the parting is later where the bracket is narrower by e; 0 where that is not known.

    It is the median of the slopes between all pairs of halvings (Theil and Sen).

    Parameters
    ----------
    width, period
        (halvings,) width of the bracket, and parting, -1 for none.
    """
    parted = np.flatnonzero((period >= 0) & (width > 0))
    narrow = parted[parted >= FIRST_HALVING]
    used = narrow if len(narrow) >= FEWEST else parted[-FEWEST:]
    if len(used) < FEWEST or len(np.unique(period[used])) < DIFFERENT:
        return 0.0
    i, j = np.triu_indices(len(used), 1)
    narrower = np.log(width[used[i]]) - np.log(width[used[j]])
    later = (period[used[j]] - period[used[i]]).astype(float)
    return float(np.median(later / narrower))


def kind_of(steps: NDArray[np.int64], period: int, slope: float, nominal: int) -> int:
    """Return the kind of an edge, an index into `KINDS`.

    An edge whose deciding step is there, and has not moved in the second half of the halvings, is not *unstable*.

    Parameters
    ----------
    steps
        (halvings,) deciding step in each bracket, -1 for none.
    period
        Parting in the narrowest bracket, -1 for none.
    slope
        :func:`slope_of` all brackets.
    nominal
        Period of the string, samples.
    """
    step = int(steps[-1])
    if slope > UNSTABLE_SLOPE and (step < 0 or step != steps[len(steps) // 2]):
        return UNSTABLE
    if period < 0:
        return THRESHOLD
    if step >= 0 and period - step // nominal <= DECIDES_WITHIN:
        return DECISION
    return GRAIN
