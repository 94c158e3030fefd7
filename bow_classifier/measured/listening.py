"""When judging of a live signal begins and ends, and what is wrong with the signal.

A *stretch* is a part of the signal without gap or silence: one note. Of each the first periods tell pitch, bow position
and polarity; it is then judged from its beginning.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bow_classifier.measured.pieces import Piece, Pieces
from bow_classifier.measured.samples import CLIPPED, longest_run
from bow_classifier.measured.tuning import Given, Tuning, tune

SETTLE_PERIODS = 200
"""Periods from which a stretch is tuned, a second of a violin's G string: as long as a bow takes to get to work."""

RETRY_PERIODS = 20
"""Between two looks whether there is a sound yet."""

QUIET, QUIET_S = 0.01, 2.0
"""A stretch ends when the signal has for so many seconds been below this part of its loudest: the bow is lifted."""

LOUDNESS_PERIODS = 5
"""Periods over which loudness is measured."""

PAUSE_S = 1.0
"""A stretch ends when nothing comes for so long, unless something else is asked for."""

RATE_S, RATE_OFF = 5.0, 0.03
"""It is said that the rate of arrival is not the sample rate if it differs by more than this part of it, over so many
seconds and again over as many: a busy machine is late too, but not by the same part."""

COMPLAINTS = 100
"""Complaints that are kept, at most; the oldest are dropped first."""


@dataclass(frozen=True)
class Begin:
    """A stretch begins."""

    tuning: Tuning


@dataclass(frozen=True)
class End:
    """A stretch has ended, and why."""

    why: str


class Listener:
    """Finds the stretches in a signal, and cuts them into chunks.

    Parameters
    ----------
    given
        What is known of it.
    level
        R.m.s. below which the signal is silence, in its own unit. 0: not known; then a stretch begins where the signal
        is periodic near f0, else also where it is not.
    pause
        Seconds without samples that end a stretch.

    Attributes
    ----------
    state
        What it does, in words.
    complaints
        What is wrong with the signal; remove them with ``popleft``.
    """

    def __init__(self, given: Given, level: float = 0.0, pause: float = PAUSE_S) -> None:
        self._given, self._level, self._pause = given, level, pause
        self.state = f"listens for a sound near {given.f0:g} Hz"
        self.complaints: deque[str] = deque(maxlen=COMPLAINTS)
        self._settle, self._retry = given.samples(SETTLE_PERIODS), given.samples(RETRY_PERIODS)
        self._extremes = (np.inf, -np.inf)
        self._clipped = 0
        self._pieces: Pieces | None = None
        self._restart()
        self._arrived_at: float | None = None
        self._rate_since, self._rate_samples, self._rate_found, self._rate_said = 0.0, 0, given.sample_rate, False

    def _restart(self) -> None:
        self._buffer: NDArray[np.float64] = np.zeros(0)
        self._since_try = self._quiet = 0
        self._loudest = 0.0
        self._measured: NDArray[np.float64] = np.zeros(0)  # not long enough yet to measure loudness

    @property
    def judging(self) -> bool:
        """Whether a stretch is in progress."""
        return self._pieces is not None

    def take(self, samples: NDArray[np.float64], now: float) -> Iterator[Begin | Piece | End]:
        """Take in samples that have come at `now`, seconds; yield what follows from them."""
        self._watch_rate(len(samples), now)
        bad = np.flatnonzero(~np.isfinite(samples))
        if bad.size:
            self.complaints.append(f"{bad.size} of {len(samples)} samples are no finite numbers; they are left out")
            yield from self.end("samples that are no numbers")
            return
        if not len(samples):
            return
        self._watch_limits(samples)
        if self._pieces is None:
            yield from self._listen(samples)
        else:
            yield from self._pieces.take(samples)
            if self._is_silent(samples):
                yield from self.end(f"silence for {QUIET_S:g} s")

    def pass_time(self, now: float) -> Iterator[Begin | Piece | End]:
        """End the stretch where nothing has come for too long."""
        if self._arrived_at is not None and now - self._arrived_at > self._pause:
            self._arrived_at = None
            if self.judging or len(self._buffer):
                yield from self.end(f"nothing came for {self._pause:g} s")

    def end(self, why: str) -> Iterator[Begin | Piece | End]:
        """End the stretch, if there is one, and listen for the next."""
        pieces, self._pieces = self._pieces, None
        self._restart()
        self.state = f"listens for a sound near {self._given.f0:g} Hz; before: {why}"
        if pieces is not None:
            yield from pieces.take(np.zeros(0), last=True)
            yield End(why)

    def _listen(self, samples: NDArray[np.float64]) -> Iterator[Begin | Piece | End]:
        self._buffer = np.concatenate([self._buffer, samples])
        self._since_try += len(samples)
        if len(self._buffer) < self._settle or self._since_try < self._retry:
            return
        self._since_try = 0
        heard = self._buffer = self._buffer[-max(self._settle, len(samples)) :]
        if np.ptp(heard) == 0:
            self.state = "all samples are the same: is the sensor connected?"
            return
        if np.std(heard) <= self._level:
            self.state = f"silence: r.m.s. {np.std(heard):.3g}, level is {self._level:g}"
            return
        tuning, _ = tune(heard, self._given)
        if self._given.within and not tuning.found and not self._level:  # above a level all is sound, also raucous
            self.state = f"no sound within {self._given.within:.0%} of {self._given.f0:g} Hz"
            return
        self.state = f"judges: f0 {tuning.f0:.2f} Hz, beta {tuning.beta:.3f}"
        self._pieces = Pieces(tuning, float(heard.mean()))
        self._restart()
        yield Begin(tuning)
        yield from self._pieces.take(heard)
        self._is_silent(heard)

    def _is_silent(self, samples: NDArray[np.float64]) -> bool:
        """Whether the signal has been silent for `QUIET_S`."""
        wave = np.concatenate([self._measured, samples])
        length = self._given.samples(LOUDNESS_PERIODS)
        whole = len(wave) // length
        self._measured = wave[whole * length :]
        for loudness in np.std(wave[: whole * length].reshape(whole, length), axis=1).tolist():
            self._loudest = max(self._loudest, loudness)
            self._quiet = self._quiet + length if loudness <= max(self._level, QUIET * self._loudest) else 0
        return self._quiet >= QUIET_S * self._given.sample_rate

    def _watch_rate(self, count: int, now: float) -> None:
        """Compare how fast samples arrive with the sample rate, from the first one after a pause on."""
        if self._arrived_at is None:
            self._rate_since, self._rate_samples = now, 0
        else:
            self._rate_samples += count
        self._arrived_at = now
        passed, rate = now - self._rate_since, self._given.sample_rate
        if passed < RATE_S:
            return
        found, before = self._rate_samples / passed, self._rate_found
        self._rate_since, self._rate_samples, self._rate_found = now, 0, found
        is_off = abs(found / rate - 1) > RATE_OFF and abs(found / before - 1) < RATE_OFF  # and not a busy machine
        if is_off and not self._rate_said:
            self.complaints.append(f"{found:.0f} samples come in a second; sample_rate is {rate:g}")
        self._rate_said |= is_off

    def _watch_limits(self, samples: NDArray[np.float64]) -> None:
        """Note samples that stay at the largest or smallest value."""
        lowest, highest = (float(samples.min()), float(samples.max()))
        self._extremes = (min(self._extremes[0], lowest), max(self._extremes[1], highest))
        if lowest == highest:
            return
        for value in self._extremes:
            longest = longest_run(samples, value)
            if longest >= CLIPPED:
                self._clipped += 1
                if self._clipped == 1 or not self._clipped % 1000:
                    self.complaints.append(
                        f"clipped: {longest} samples in a row at {value:g}; lower the gain of the sensor"
                    )
