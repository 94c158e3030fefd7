"""A measured bridge force judged as a simulated one, without the stream of stick and slip."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bow.recorded import read_recording
from bow_classifier.block_classifier import BlockClassifier, Geometry
from bow_classifier.measured.force_slips import bow_speeds, intervals, velocity
from bow_classifier.measured.samples import CLIPPED, longest_run
from bow_classifier.measured.tuning import BETA, CORNER, WITHIN, Given, RecordingError, Tuning, checked, tune
from bow_classifier.verdict.regimes import REGIMES, is_helmholtz
from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sweep.cell.cell_record import CellTests
from bow_sweep.maps.plane import regime_label

FEWEST_VALUES = 64
"""Different values that a recording must have before equal ones in a row are called clipped."""

__all__ = ["BETA", "Judged", "RecordingError", "classify"]


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
    notes
        What makes the verdicts doubtful, or should be known of the recording: a sentence each.
    """

    tests: CellTests
    f0: float
    found: bool
    beta: float
    bow_speed: NDArray[np.float64]
    start: float
    notes: tuple[str, ...] = ()

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
        lines += [f"note: {note}" for note in self.notes]
        return "\n".join(lines)

    def __repr__(self) -> str:
        shares = ", ".join(f"{name} {share:.0%}" for name, share in self.shares.items())
        return f"<bow.Judged {len(self.time)} tests: {shares}>"


def classify(
    x: ArrayLike | str | Path,
    sample_rate: float | None = None,
    f0: float | None = None,
    *,
    beta: float | None = None,
    f0_within: float = WITHIN,
    thresholds: Thresholds | None = None,
    topic: str | None = None,
    channel: int = 0,
    cell: int = 0,
) -> Judged:
    """Judge a measured bridge force: the regimes of a map, every five periods, without knowing stick and slip.

    The slips are computed from the force (:mod:`bow_classifier.measured.force_slips`), and the classifier of the maps
    does the rest. How well, docs/desk.md says. *helmholtz* and *helmholtz_extra_slips* cannot be told apart, the first
    is said.

    Parameters
    ----------
    x
        (samples,) force at the bridge, of one string; unit, sign and offset do not matter. Or a file that holds it:
        .wav, .npy, .mcap (:func:`bow.recorded.read_recording`, also for `topic`, `channel` and `cell`).
    sample_rate
        Hz. None: what the file says.
    f0
        Frequency of the string, Hz. None: what the file says, which only a run's bag does.
    beta
        Distance of the bow from the bridge over the length of the string; None: what the file says, or 0.1. It is
        refined by half a sample of the round trip at most.
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
    samples: ArrayLike
    name = "x"
    notes: tuple[str, ...] = ()
    if isinstance(x, str | Path):
        read = read_recording(x, channel, topic, cell)
        if None not in (sample_rate, read.sample_rate) and sample_rate != read.sample_rate:
            raise RecordingError(f"sample_rate = {sample_rate}: {x} says {read.sample_rate:g} Hz; leave it out")
        samples, sample_rate = read.samples, read.sample_rate if sample_rate is None else sample_rate
        f0, beta = read.f0 if f0 is None else f0, read.beta if beta is None else beta
        name, notes = read.name, read.notes
    else:
        samples = x
    if sample_rate is None:
        raise RecordingError(f"{_named(x)}: does not say its sample rate; give it (sample_rate=, --rate)")
    if f0 is None:
        raise RecordingError(f"{_named(x)}: does not say the frequency of the string; give it (f0=, --f0)")
    given = Given(sample_rate, f0, BETA if beta is None else beta, f0_within)
    force = checked(samples, given, name)
    string, wave = tune(force, given)
    return _judged(wave, string, thresholds or Thresholds(corner=CORNER), (*notes, *_limits(force)))


def _limits(force: NDArray[np.float64]) -> list[str]:
    """Return a sentence where samples stay at the greatest or smallest value."""
    runs = [(longest_run(force, value), value) for value in (force.max(), force.min())]
    longest, value = max(runs)
    # where there are few different values, equal ones in a row say nothing
    if longest < CLIPPED or len(np.unique(force)) < FEWEST_VALUES:
        return []
    return [f"perhaps clipped: {longest} samples in a row at {value:g}, beyond which there are none"]


def _named(x: ArrayLike | str | Path) -> str:
    return str(x) if isinstance(x, str | Path) else "x"


def _judged(wave: NDArray[np.float64], string: Tuning, thresholds: Thresholds, notes: tuple[str, ...]) -> Judged:
    samples, sign, start = string.samples, string.sign, string.start
    speed = velocity(wave, string.delay)
    chunks = (len(wave) - start) // samples
    wave, speed = (each[start : start + chunks * samples] for each in (wave, speed))
    units = sign * bow_speeds(sign * speed, samples)
    geometry = Geometry(string.period, string.delay, samples)
    classifier = BlockClassifier(geometry, thresholds, 1, periods=chunks * CHUNK_PERIODS)
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
    return Judged(tests, string.f0, string.found, string.beta, units, start / string.period / string.f0, notes)
