"""What a recording must tell before it can be judged: pitch, round trip of the bow, polarity, where chunks begin.

A recording is judged at a period of a whole number of samples near `PERIOD`, so chosen that the round trip
bow-bridge-bow is a whole number too.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bow_classifier.measured.force_slips import bow_speed, polarity, quiet_phase, round_trip, velocity
from bow_classifier.measured.pitch import NEAR, TAIL_PERIODS, period_of
from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.physics.parameters import CHUNK_PERIODS

PERIOD = 139
"""Samples of a nominal period at which a recording is judged: the paper's, for which thresholds were tuned."""

PERIODS = range(132, 147)
"""Samples that a period may have instead, so that the round trip bow-bridge-bow is a whole number of them."""

BETA = 0.1
"""Bow position that is taken where none is given: usual playing."""

BETAS = (0.02, 0.35)
"""Bow positions that can be judged: a corner is told from a ramp below 0.38 (PHYSICS.md section 7)."""

CORNER = 0.41
"""Least jump of a corner here, in v_b/beta; 0.38 in maps. Ripples that are sharper than a sample of the recording come
out higher than they were: of 0.38, 0.41 and 0.44 this is right most often for strings with and without stiffness."""

WITHIN = 0.03
"""Part of f_0 by which it may be wrong."""

FEWEST_SAMPLES = 16
"""Samples of a period that a recording must have: five harmonics and more."""

NUMBERS = "iufb"
"""Kinds of NumPy's types that a recording may have."""

DENOMINATOR = 1000
"""Rates are taken as a ratio of whole numbers up to this: a period is right to a tenth of a sample in a hundred."""


class RecordingError(ValueError):
    """A recording cannot be judged as asked; the message says what, and what would be right."""


@dataclass(frozen=True)
class Given:
    """What is known of a recording beforehand.

    Attributes
    ----------
    sample_rate
        Hz.
    f0
        Frequency of the string, Hz.
    beta
        Distance of the bow from the bridge over the length of the string.
    within
        Part of f0 by which it may be wrong; 0: it is taken as it is.

    Raises
    ------
    RecordingError
        For a number that cannot be; names it.
    """

    sample_rate: float
    f0: float
    beta: float = BETA
    within: float = WITHIN

    def __post_init__(self) -> None:
        for name, value in (("sample_rate", self.sample_rate), ("f0", self.f0)):
            if not (np.isfinite(value) and value > 0):
                raise RecordingError(f"{name} = {value!r}: should be a number above 0, Hz")
        if self.sample_rate < FEWEST_SAMPLES * self.f0:
            least = f"{FEWEST_SAMPLES * self.f0:g} Hz, {FEWEST_SAMPLES} samples a period"
            raise RecordingError(f"sample_rate = {self.sample_rate:g}: should be at least {least}")
        if not BETAS[0] <= self.beta <= BETAS[1]:
            raise RecordingError(f"beta = {self.beta:g}: should be {BETAS[0]:g} ... {BETAS[1]:g}")
        if not 0 <= self.within <= NEAR / 2:
            raise RecordingError(f"f0_within = {self.within:g}: should be 0 ... {NEAR / 2:g}")

    @property
    def nominal(self) -> float:
        """Samples of a period of f0."""
        return self.sample_rate / self.f0

    def samples(self, periods: float) -> int:
        """Return the samples of so many periods of f0."""
        return int(np.ceil(periods * self.nominal))


@dataclass(frozen=True)
class Tuning:
    """What a recording tells of the string.

    Attributes
    ----------
    f0
        Frequency of the sound, Hz, or the given one.
    found
        Whether f0 was found.
    period
        Samples of a period at which the recording is judged, one of `PERIODS`.
    delay
        Round trip bow-bridge-bow, samples.
    share
        By what the sample rate of the recording is multiplied.
    sign
        1 where slips are negative velocities, else -1: the polarity of the sensor.
    start
        Sample at which the first chunk begins, 0 ... period - 1.
    """

    f0: float
    found: bool
    period: int
    delay: int
    share: Fraction
    sign: float
    start: int

    @property
    def beta(self) -> float:
        """Bow position."""
        return self.delay / self.period

    @property
    def samples(self) -> int:
        """Of a chunk."""
        return CHUNK_PERIODS * self.period


def checked(x: ArrayLike, given: Given, name: str = "x") -> NDArray[np.float64]:
    """Return a recording as an array that can be judged.

    Parameters
    ----------
    x
        (samples,) numbers.
    given
        What is known beforehand.
    name
        What an error calls it.

    Raises
    ------
    RecordingError
        Where it is too short, is of more than one string, holds what is no number, or no sound.
    """
    raw = np.asarray(x)
    if raw.dtype.kind not in NUMBERS:
        raise RecordingError(f"{name}: holds {raw.dtype}; should be real numbers")
    if raw.ndim != 1:
        one = "x[0]" if raw.ndim == 2 and len(raw) < raw.shape[1] else "x[:, 0]"
        example = f", for instance {one}" if raw.ndim == 2 else ""
        raise RecordingError(f"{name}: shape {raw.shape}; should be (samples,), one string{example}")
    force = raw.astype(float)
    if not np.isfinite(force).all():
        raise RecordingError(f"{name}: sample {int(np.flatnonzero(~np.isfinite(force))[0])} is not a finite number")
    needed = (CHUNK_PERIODS + 2) * given.nominal
    if len(force) < needed:
        raise RecordingError(f"{name}: {len(force)} samples; should be {needed:.0f} at least, seven periods")
    if np.ptp(force) == 0:
        raise RecordingError(f"{name}: all samples are the same; should be a sound")
    return force


def tune(force: NDArray[np.float64], given: Given) -> tuple[Tuning, NDArray[np.float64]]:
    """Return what a recording tells of the string, and the recording at the rate at which it is judged, mean 0.

    Parameters
    ----------
    force
        (samples,) as :func:`checked` returns it.
    given
        What is known beforehand.
    """
    pitch = _pitch(force, given) if given.within else None
    f0 = pitch or given.f0
    coarse = resampled(force, share_of(PERIOD * f0 / given.sample_rate))
    delay = round_trip(coarse, given.beta * PERIOD)
    grid = min(PERIODS, key=lambda period: abs(delay * period / PERIOD - round(delay * period / PERIOD)))
    share, whole = share_of(grid * f0 / given.sample_rate), round(delay * grid / PERIOD)
    wave = resampled(force, share)
    speed = velocity(wave, whole)
    sign = polarity(speed)
    start = quiet_phase(sign * speed / bow_speed(sign * speed), grid)
    return Tuning(f0, pitch is not None, grid, whole, share, sign, start), wave


def share_of(ratio: float) -> Fraction:
    """Return a ratio of two sample rates as one of small whole numbers."""
    return Fraction(ratio).limit_denominator(DENOMINATOR)


def resampled(force: NDArray[np.float64], share: Fraction) -> NDArray[np.float64]:
    """Return a recording with `share` times as many samples; its mean is 0."""
    from scipy.signal import resample_poly

    wave = force - force.mean()
    if share == 1:
        return wave
    return np.asarray(resample_poly(wave, share.numerator, share.denominator, padtype="line"))


def _pitch(force: NDArray[np.float64], given: Given) -> float | None:
    """Return the frequency of the sound near f0, Hz: the median of stretches of 20 periods; None if there is none."""
    loud = force / np.ptp(force)  # what is silence does not depend on the unit of the sensor
    length = round(TAIL_PERIODS * given.nominal)
    ends = range(length, len(loud) + 1, length) if len(loud) >= length else [len(loud)]
    found = [period_of(loud[max(0, end - length) : end], round(given.nominal)) for end in ends]
    periods = np.array([period for period in found if period is not None])
    wide = given.within + max(Thresholds().lag_last - 1, 1 - Thresholds().lag_first)
    near = periods[np.abs(periods / given.nominal - 1) <= wide] if periods.size else periods
    return given.sample_rate / float(np.median(near)) if near.size else None
