"""Blocks of samples in, as they come; chunks of force and slips out, in the form that the classifier takes.

The same is done to a whole recording by :mod:`bow.recordings`. Here a chunk is ready when two more after it are known:
its bow speed is taken from 25 periods around it. And what is loud is known only from what has come so far.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from fractions import Fraction
from math import ceil
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_classifier.features.slips import Intervals
from bow_classifier.measured.force_slips import AROUND, FAINTEST, LOUDEST, bow_speed, intervals, velocity
from bow_classifier.measured.tuning import Tuning

HALF_FILTER = 10
"""Half the length of the filter of ``scipy.signal.resample_poly``, in samples of the lower rate."""

REMEMBERED = 2000
"""Chunks whose bow speeds say what is loud: some 50 s of a violin's G string."""


class Piece(NamedTuple):
    """One chunk of a measured string.

    Attributes
    ----------
    force
        (samples,) float32, bridge force over the bow speed.
    slips
        The slips in it.
    bow_speed
        In the unit of the sensor, its sign the polarity.
    """

    force: NDArray[np.float32]
    slips: Intervals
    bow_speed: float


class Resampler:
    """Changes the sample rate of blocks that come one after another, as ``resample_poly`` does for all of them.

    Parameters
    ----------
    share
        Samples that go out for one that comes in.
    """

    def __init__(self, share: Fraction) -> None:
        self._up, self._down = share.numerator, share.denominator
        self._reach = ceil(HALF_FILTER * max(self._up, self._down) / self._up) + 1
        self._before = ceil(self._reach / self._down) * self._down
        self._samples: NDArray[np.float64] = np.zeros(0)
        self._first = self._done = 0  # of all samples that came in: the first that is kept, the first not gone out

    def take(self, samples: NDArray[np.float64], last: bool = False) -> NDArray[np.float64]:
        """Take in samples; return those that no later ones can change, or with `last` all that are left."""
        if self._up == self._down:
            return samples
        from scipy.signal import resample_poly

        self._samples = np.concatenate([self._samples, samples])
        come = self._first + len(self._samples)
        end = come if last else (come - self._reach) // self._down * self._down
        if end <= self._done:
            return np.zeros(0)
        begin = max(0, self._done - self._before)
        part = self._samples[begin - self._first : end + self._reach - self._first]
        out = np.asarray(resample_poly(part, self._up, self._down, padtype="line"))
        skip = (self._done - begin) // self._down * self._up
        count = ceil((end - self._done) * self._up / self._down)
        self._done = end
        keep = max(0, end - self._before)
        self._samples, self._first = self._samples[keep - self._first :], keep
        return out[skip : skip + count]


class Pieces:
    """Cuts a measured string into chunks.

    Parameters
    ----------
    tuning
        What the string has told.
    offset
        What is subtracted from all samples, in the unit of the sensor.
    """

    def __init__(self, tuning: Tuning, offset: float = 0.0) -> None:
        self.tuning = tuning
        self._offset = offset
        self._resampler = Resampler(tuning.share)
        self._skip = tuning.start
        self._wave: NDArray[np.float64] = np.zeros(0)
        self._speed: NDArray[np.float64] = np.zeros(0)
        self._tail: NDArray[np.float64] | None = None  # the last round trip before _wave
        self._first = 0  # chunk at the beginning of _wave
        self._next = 0  # chunk that goes out next
        self._loud: deque[float] = deque(maxlen=REMEMBERED)
        self._found: dict[int, float] = {}
        self._slipping = False

    def take(self, samples: NDArray[np.float64], last: bool = False) -> Iterator[Piece]:
        """Take in samples, in the unit of the sensor; yield the chunks that are ready; with `last`, all."""
        self._append(self._resampler.take(samples - self._offset, last))
        length = self.tuning.samples
        known = self._first + len(self._wave) // length
        ready = known if last else max(0, known - AROUND)
        for chunk in range(self._next, ready):
            part = slice(max(0, chunk - AROUND - self._first) * length, (chunk + AROUND + 1 - self._first) * length)
            speeds = self._speed[part]
            self._found[chunk] = bow_speed(self.tuning.sign * speeds[: len(speeds) // length * length])
            self._loud.append(self._found[chunk])
        least = FAINTEST * float(np.percentile(self._loud, LOUDEST)) if self._loud else 0.0
        while self._next < ready:
            unit = max(self._found.pop(self._next), least, float(np.finfo(float).tiny))
            yield self._piece(self.tuning.sign * unit)
        self._forget()

    def _append(self, wave: NDArray[np.float64]) -> None:
        skipped = wave[: self._skip]
        if len(skipped):
            self._skip -= len(skipped)
            self._remember(skipped)
            wave = wave[len(skipped) :]
        if not len(wave):
            return
        delay = self.tuning.delay
        before = self._tail if self._tail is not None else np.full(delay, wave[0])
        before = np.concatenate([np.full(delay - len(before), before[0]), before]) if len(before) < delay else before
        speed = velocity(np.concatenate([before, wave]), delay)[delay:]
        self._wave, self._speed = np.concatenate([self._wave, wave]), np.concatenate([self._speed, speed])
        self._remember(wave)

    def _remember(self, wave: NDArray[np.float64]) -> None:
        before = wave if self._tail is None else np.concatenate([self._tail, wave])
        self._tail = before[-self.tuning.delay :]

    def _piece(self, unit: float) -> Piece:
        length = self.tuning.samples
        part = slice((self._next - self._first) * length, (self._next - self._first + 1) * length)
        slip_speed = 1 - self._speed[part] / unit
        slips = intervals(slip_speed, self._slipping)
        self._slipping = bool(intervals(slip_speed[-1:], False).duration.size)
        self._next += 1
        return Piece((self._wave[part] / unit).astype(np.float32), slips, unit)

    def _forget(self) -> None:
        """Drop the chunks that no later one needs."""
        drop = max(0, self._next - AROUND - self._first) * self.tuning.samples
        self._wave, self._speed = self._wave[drop:], self._speed[drop:]
        self._first += drop // self.tuning.samples
