"""The slips of a string, from its bridge force alone.

A wave that leaves the bow towards the bridge comes back inverted after d samples, the round trip bow-bridge-bow. With x
the outgoing wave, which is what a bridge force shows, the string under the bow moves with the velocity
``y[t] = x[t] - x[t - d]``, but for what the bridge takes away and for torsion. While the string sticks, y is the bow
speed, so y has this value most of the time: that is the unit, and its sign the polarity of the sensor. The string slips
where ``1 - y``, in this unit, is above `SLIPPING` (PHYSICS.md sections 2 and 7).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bow_classifier.features.slips import Intervals

SLIPPING = 1.5
"""Slip speed above which the string slips, in bow speeds. In Helmholtz motion it is 1/beta, about ten; the velocity of
a sticking string's centre differs from the bow speed by its torsion. Of 1.5, 2.5 and 3.5 the first gives the most
regimes as the recorded slips do."""

START = 75
"""Percentile of y from which the search for the bow speed begins: above what slips, and within what sticks."""

ROUNDS = 4
"""Of this search; it no longer changes then."""

AROUND = 2
"""Chunks before and after one, whose velocities its bow speed is taken from as well: 25 periods together."""

NEAR_BOW, FINER, SEARCHED = 0.06, 4, 300
"""Part of a round trip by which a given one may be wrong; steps of a sample in which it is looked for; how many round
trips of a recording are looked at: thirty periods of usual playing. A third of a sample too much leaves pieces of the
ripples where they should cancel, and they are taken for corners."""

TRUST = 2.0
"""By how much worse a round trip at the end of this range is taken to be: strong ripples may look even at another.
With this a guess is moved by a quarter or half of a sample at most: it is refined, not found."""

FAINTEST = 0.2
"""Least bow speed of a chunk over that of the loudest ones. A quieter chunk is judged as if it were as loud: what moves
there is noise, or the end of a sound."""

LOUDEST = 90
"""Percentile of the bow speeds that stands for the loudest chunks."""


def velocity(force: NDArray[np.float64], delay: int) -> NDArray[np.float64]:
    """Return the velocity of the string under the bow, (samples,), in the unit of the force.

    Parameters
    ----------
    force
        (samples,) bridge force.
    delay
        Round trip bow-bridge-bow, samples. Before its first sample the force is taken to be constant.
    """
    return force - np.concatenate([np.full(min(delay, len(force)), force[0]), force[:-delay]])


def polarity(speed: NDArray[np.float64]) -> float:
    """Return 1 where slips are negative velocities, as in this package, else -1: slips are short and fast."""
    return -1.0 if float(np.mean((speed - speed.mean()) ** 3)) > 0 else 1.0


def bow_speed(speed: NDArray[np.float64]) -> float:
    """Return the bow speed: the median of the velocities at which the string sticks, in the unit of the force."""
    found = float(np.percentile(speed, START))
    if found <= 0:
        found = float(np.percentile(np.abs(speed), START))
    for _ in range(ROUNDS):
        sticking = speed[speed > found * (1 - SLIPPING)]
        median = float(np.median(sticking)) if sticking.size else 0.0
        if median <= 0:
            break
        found = median
    return found


def bow_speeds(speed: NDArray[np.float64], samples: int) -> NDArray[np.float64]:
    """Return the bow speed in each chunk, (chunks,), in the unit of the force; above 0.

    Parameters
    ----------
    speed
        (chunks * samples,) velocity under the bow, slips negative.
    samples
        Length of a chunk.
    """
    chunks = len(speed) // samples
    borders = [(max(0, k - AROUND) * samples, (k + AROUND + 1) * samples) for k in range(chunks)]
    found = np.array([bow_speed(speed[first:last]) for first, last in borders])
    least = FAINTEST * float(np.percentile(found, LOUDEST))
    return np.maximum(found, max(least, np.finfo(float).tiny))


def round_trip(force: NDArray[np.float64], guess: float) -> float:
    """Return the round trip bow-bridge-bow, samples, to `FINER` parts of one: that at which y varies least in sticking.

    Parameters
    ----------
    force
        (samples,) bridge force, mean 0.
    guess
        Samples; it is looked for within `NEAR_BOW` of it, in the last `SEARCHED` round trips.
    """
    from scipy.signal import resample_poly

    wave = resample_poly(force[-int(SEARCHED * guess) :], FINER, 1, padtype="line")
    first, last = (max(1, round(FINER * guess * (1 + side * NEAR_BOW))) for side in (-1, 1))
    delays = np.arange(first, last + 1)
    apart = (delays / (FINER * guess) - 1) / NEAR_BOW
    scores = [_unevenness(velocity(wave, delay)) for delay in delays.tolist()]
    return float(delays[np.argmin(scores * (1 + TRUST * apart**2))]) / FINER


def quiet_phase(speed: NDArray[np.float64], period: int) -> int:
    """Return the sample of a period, 0 ... period - 1, around which the string slips least: where chunks should begin.

    A slip that ends near the border of two chunks may count in either.

    Parameters
    ----------
    speed
        (samples,) velocity under the bow over the bow speed, slips negative.
    period
        Nominal period, samples.
    """
    slipping = (1 - speed[: len(speed) // period * period].reshape(-1, period) > SLIPPING).mean(axis=0)
    half = period // 2
    thrice = np.concatenate([slipping[-half:], slipping, slipping[:half]])
    around = np.convolve(thrice, np.bartlett(2 * half + 1), "valid")
    return int(np.argmin(around))


def _unevenness(speed: NDArray[np.float64]) -> float:
    """Return the r.m.s. deviation of the velocity in sticking from the bow speed, over it."""
    speed = polarity(speed) * speed
    unit = bow_speed(speed)
    sticking = speed[speed > unit * (1 - SLIPPING)]
    return float(np.sqrt(np.mean((sticking / unit - 1) ** 2))) if sticking.size and unit > 0 else np.inf


def intervals(slip_speed: NDArray[np.float64], before: bool) -> Intervals:
    """Return the slips of one chunk of one string in the form that the classifier takes.

    Parameters
    ----------
    slip_speed
        (samples,) slip speed over the bow speed.
    before
        Whether the string slips before the first sample.
    """
    slipping = slip_speed > SLIPPING
    edges = np.flatnonzero(np.diff(np.concatenate([[False], slipping, [False]]).astype(np.int8)))
    onset, end = edges[::2], edges[1::2]
    total = np.concatenate([[0.0], np.cumsum(slip_speed)])
    return Intervals(
        slipping=np.array([before], np.uint8),
        offsets=np.array([0, len(onset)], np.uint32),
        onset=onset.astype(np.uint32),
        duration=(end - onset).astype(np.uint32),
        slip=total[end] - total[onset],
    )
