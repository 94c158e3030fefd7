"""A measured bridge force judged as a simulated one, without the stream of stick and slip."""

from __future__ import annotations

import struct
from collections import Counter
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bow.force_slips import bow_speed, bow_speeds, intervals, polarity, quiet_phase, round_trip, velocity
from bow_classifier.block_classifier import BlockClassifier, Geometry
from bow_classifier.verdict.regimes import REGIMES, is_helmholtz
from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sweep.cell.analysis import NEAR, TAIL_PERIODS, period_of
from bow_sweep.cell.cell_record import CellTests
from bow_sweep.maps.plane import regime_label

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

DENOMINATOR = 1000
"""Rates are taken as a ratio of whole numbers up to this: a period is right to a tenth of a sample in a hundred."""


class RecordingError(ValueError):
    """A recording cannot be judged as asked; the message says what, and what would be right."""


@dataclass(frozen=True, eq=False)
class Judged:
    """What the classifier says of a recording. :func:`bow.classify` returns it; printed, it is a list of its regimes.

    Attributes
    ----------
    tests
        The result of each test, one after every five periods; its `regime` are codes.
    f0
        Nominal frequency that was found, Hz, or the given one where the sound is nowhere periodic near it.
    found
        Whether f0 was found.
    beta
        Bow position that was found near the given one.
    bow_speed
        (tests,) bow speed in the unit of the recording, its sign the polarity of the sensor.
    start
        Where the first test begins, seconds: less than a period.
    """

    tests: CellTests
    f0: float
    found: bool
    beta: float
    bow_speed: NDArray[np.float64]
    start: float

    @property
    def time(self) -> NDArray[np.float64]:
        """(tests,) end of each test, seconds."""
        return self.start + np.asarray(self.tests.periods) / self.f0

    @property
    def regime(self) -> NDArray[np.str_]:
        """(tests,) name of the regime."""
        return np.array(self.tests.regime_names)[self.tests.regime]

    @property
    def helmholtz(self) -> NDArray[np.bool_]:
        """(tests,) whether it is Helmholtz motion."""
        return self.tests.helmholtz

    @property
    def shares(self) -> dict[str, float]:
        """The share of the tests that found each regime, the largest first."""
        return {name: number / len(self.regime) for name, number in Counter(self.regime.tolist()).most_common()}

    def __str__(self) -> str:
        pitch = f"f0 {self.f0:.2f} Hz{'' if self.found else ' as given: not periodic near it'}"
        lines = [f"{len(self.time)} tests, {self.time[-1]:.2f} s; {pitch}; beta {self.beta:.3f}"]
        for first, last, name in self.tests.runs():
            lines.append(f"{first / self.f0:8.3f} - {last / self.f0:.3f} s  {regime_label(name)}")
        return "\n".join(lines)

    def __repr__(self) -> str:
        shares = ", ".join(f"{name} {share:.0%}" for name, share in self.shares.items())
        return f"<bow.Judged {len(self.time)} tests: {shares}>"


def classify(
    x: ArrayLike,
    sample_rate: float,
    f0: float,
    *,
    beta: float = BETA,
    f0_within: float = WITHIN,
    thresholds: Thresholds | None = None,
) -> Judged:
    """Judge a measured bridge force: the regimes of a map, every five periods, without knowing stick and slip.

    The slips are computed from the force (:mod:`bow.force_slips`), and the classifier of the maps does the rest. How
    well, docs/desk.md says. *helmholtz* and *helmholtz_extra_slips* cannot be told apart, the first is said.

    Parameters
    ----------
    x
        (samples,) force at the bridge, of one string; unit, sign and offset do not matter.
    sample_rate
        Hz.
    f0
        Frequency of the string, Hz.
    beta
        Distance of the bow from the bridge over the length of the string. It is refined by half a sample of the round
        trip at most.
    f0_within
        Part of f0 by which it may be wrong: the period of the sound is looked for there. 0 takes f0 as it is.
    thresholds
        None: those of the maps, with `CORNER`.

    Raises
    ------
    RecordingError
        For a recording that cannot be judged; says what would be right. It is a ValueError.

    Examples
    --------
    >>> import bow
    >>> c = bow.sweep("fig11c", nx=4, ny=2, periods=60, progress=False).cell(5)
    >>> bow.classify(c.bridge_force, c.sample_rate, f0=440, beta=15 / 139)
    <bow.Judged 11 tests: multiple_slip 73%, multiple_flyback 18%, aperiodic 9%>
    """
    force = _checked(x, sample_rate, f0, beta, f0_within)
    pitch = _pitch(force, sample_rate, f0, f0_within) if f0_within else None
    nominal = pitch or f0
    delay = round_trip(_resampled(force, PERIOD * nominal / sample_rate), beta * PERIOD)
    grid = min(PERIODS, key=lambda period: abs(delay * period / PERIOD - round(delay * period / PERIOD)))
    wave = _resampled(force, grid * nominal / sample_rate)
    string = Geometry(grid, round(delay * grid / PERIOD), CHUNK_PERIODS * grid)
    return _judged(wave, string, thresholds or Thresholds(corner=CORNER), nominal, pitch is not None)


def _checked(x: ArrayLike, sample_rate: float, f0: float, beta: float, within: float) -> NDArray[np.float64]:
    force = np.asarray(x, float)
    if force.ndim != 1:
        raise RecordingError(f"x: shape {force.shape}; should be (samples,), one string")
    if not np.isfinite(force).all():
        raise RecordingError(f"x: sample {int(np.flatnonzero(~np.isfinite(force))[0])} is not a finite number")
    for name, value in (("sample_rate", sample_rate), ("f0", f0)):
        if not (np.isfinite(value) and value > 0):
            raise RecordingError(f"{name} = {value!r}: should be a number above 0, Hz")
    if sample_rate < FEWEST_SAMPLES * f0:
        least = f"{FEWEST_SAMPLES * f0:g} Hz, {FEWEST_SAMPLES} samples a period"
        raise RecordingError(f"sample_rate = {sample_rate:g}: should be at least {least}")
    if not BETAS[0] <= beta <= BETAS[1]:
        raise RecordingError(f"beta = {beta:g}: should be {BETAS[0]:g} ... {BETAS[1]:g}")
    if not 0 <= within <= NEAR / 2:
        raise RecordingError(f"f0_within = {within:g}: should be 0 ... {NEAR / 2:g}")
    needed = (CHUNK_PERIODS + 2) * sample_rate / f0
    if len(force) < needed:
        raise RecordingError(f"x: {len(force)} samples; should be {needed:.0f} at least, seven periods")
    if np.ptp(force) == 0:
        raise RecordingError("x: all samples are the same; should be a sound")
    return force


def _pitch(force: NDArray[np.float64], sample_rate: float, f0: float, within: float) -> float | None:
    """Return the frequency of the sound near f0, Hz: the median of stretches of 20 periods; None if there is none."""
    nominal = sample_rate / f0
    length = round(TAIL_PERIODS * nominal)
    ends = range(length, len(force) + 1, length) if len(force) >= length else [len(force)]
    found = [period_of(force[max(0, end - length) : end], round(nominal)) for end in ends]
    periods = np.array([period for period in found if period is not None])
    wide = within + max(Thresholds().lag_last - 1, 1 - Thresholds().lag_first)
    near = periods[np.abs(periods / nominal - 1) <= wide] if periods.size else periods
    return sample_rate / float(np.median(near)) if near.size else None


def _resampled(force: NDArray[np.float64], ratio: float) -> NDArray[np.float64]:
    """Return a recording with `ratio` times as many samples; its mean is 0."""
    from scipy.signal import resample_poly

    share = Fraction(ratio).limit_denominator(DENOMINATOR)
    wave = force - force.mean()
    if share == 1:
        return wave
    return np.asarray(resample_poly(wave, share.numerator, share.denominator, padtype="line"))


def _judged(wave: NDArray[np.float64], string: Geometry, thresholds: Thresholds, f0: float, found: bool) -> Judged:
    samples, delay = string.samples, string.bow_bridge
    speed = velocity(wave, delay)
    sign = polarity(speed)
    start = quiet_phase(sign * speed / bow_speed(sign * speed), string.period)
    chunks = (len(wave) - start) // samples
    wave, speed = (each[start : start + chunks * samples] for each in (wave, speed))
    units = sign * bow_speeds(sign * speed, samples)
    classifier = BlockClassifier(string, thresholds, 1, periods=chunks * CHUNK_PERIODS)
    slipping, verdicts = False, []
    for chunk in range(chunks):
        part = slice(chunk * samples, (chunk + 1) * samples)
        slip_speed = 1 - speed[part] / units[chunk]
        force = (wave[part] / units[chunk]).astype(np.float32)[None]
        verdicts.append(classifier.classify(force, intervals(slip_speed, slipping)))
        slipping = bool(intervals(slip_speed[-1:], False).duration.size)
    layers = {name: np.concatenate([getattr(each, name) for each in verdicts]) for name in verdicts[0]._fields}
    helmholtz = is_helmholtz(layers["regime"])
    layers["regime"] = np.where(helmholtz, REGIMES.index("helmholtz"), layers["regime"]).astype(np.uint8)
    periods = np.arange(1, chunks + 1) * CHUNK_PERIODS
    tests = CellTests(periods=periods, helmholtz=helmholtz, regime_names=REGIMES, **layers)
    return Judged(tests, f0, found, delay / string.period, units, start / string.period / f0)


def read_recording(path: str | Path, channel: int = 0) -> tuple[NDArray[np.float64], float | None]:
    """Return the samples of a file and its sample rate, None where the file does not say it.

    Parameters
    ----------
    path
        A WAV file, or a NumPy file .npy with a row of numbers, or a row for each channel.
    channel
        Which one to take of several, from 0.

    Raises
    ------
    RecordingError
        For another file, or a channel that there is not.
    """
    place = Path(path)
    rate: float | None = None
    try:
        if place.suffix.lower() == ".wav":
            from scipy.io import wavfile

            whole, data = wavfile.read(place)
            rate, rows = float(whole), np.asarray(data, float).reshape(len(data), -1).T
        elif place.suffix.lower() == ".npy":
            rows = np.atleast_2d(np.asarray(np.load(place, allow_pickle=False), float))
        else:
            raise RecordingError(f"{place}: should end in .wav or .npy")
    except FileNotFoundError:
        raise RecordingError(f"{place}: there is no such file") from None
    except (OSError, ValueError, TypeError, struct.error) as error:
        if isinstance(error, RecordingError):
            raise
        raise RecordingError(f"{place}: cannot be read as a recording: {error}") from None
    if rows.ndim != 2 or not 0 <= channel < len(rows):
        raise RecordingError(f"{place}: channel {channel}: it has {len(rows)}, from 0 on")
    return rows[channel], rate
