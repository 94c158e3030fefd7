"""A bridge force as sound: 48 kHz, without clicks at its ends, at a set level and of a set length.

The outgoing wave at the bridge is what drives a violin's body, so it is what is heard, with or without the body
(:mod:`bow_sweep.cell.body`). SciPy's polyphase resampler changes the rate.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bow_sim.atomic_files import replacing
from bow_sim.physics.parameters import CHUNK_PERIODS, Parameters
from bow_sweep.cell import analysis
from bow_sweep.cell.body import filtered

RATE = 48_000
"""Samples per second of a sound."""

PEAK_DB = -3.0
"""Largest sample of a sound, dB relative to full scale."""

FADE_IN, FADE_OUT = 0.005, 0.030
"""Seconds over which a sound begins and ends."""

LOWEST = 20.0
"""Hz: what is slower is no sound. The mean of the bridge force is removed with it."""

START_S = 0.01
"""Seconds at the beginning of a waveform whose mean it is taken to come from."""

MOST_SECONDS = 60.0

_ZEROS, _BETA, _CUTOFF = 48, 10.0, 0.92
"""The filter of the resampler: zero crossings on each side, Kaiser window (about -100 dB), corner relative to the lower
of the two half rates: the audible range passes, and what would be folded into it does not."""

_DENOMINATOR = 4000
"""Rates are taken as a ratio of whole numbers up to this: pitch is right to a thousandth of a cent."""

LOOP_PERIODS = 10
"""At most so many periods at the end of a waveform are repeated where it cannot be simulated on: as many as come
nearest to a whole number of samples, so that the pitch is kept."""


class SoundError(ValueError):
    """A sound cannot be made as asked; the message says what would be right."""


@dataclass(frozen=True, eq=False)
class Sound:
    """A sound and what was done for it.

    Attributes
    ----------
    samples
        (samples,) float32 at `RATE`, between -1 and 1.
    how
        How its length was reached, in words.
    """

    samples: NDArray[np.float32]
    how: str

    @property
    def seconds(self) -> float:
        """Length."""
        return len(self.samples) / RATE

    @property
    def peak_db(self) -> float:
        """Largest sample, dB relative to full scale; -inf for silence."""
        return _decibels(float(np.max(np.abs(self.samples), initial=0.0)))

    @property
    def rms_db(self) -> float:
        """Root of the mean square, dB relative to full scale; -inf for silence."""
        return _decibels(float(np.sqrt(np.mean(np.square(self.samples, dtype=np.float64)))) if len(self.samples) else 0)

    def describe(self) -> str:
        """Return length, rate and level in a line."""
        level = f"peak {self.peak_db:.1f} dB, RMS {self.rms_db:.1f} dB of full scale"
        silent = not np.any(self.samples)
        return f"{self.seconds:.2f} s at {RATE} Hz, {'silent' if silent else level}; {self.how}"


def _decibels(value: float) -> float:
    return float(20 * np.log10(value)) if value > 0 else -np.inf


def sound(
    force: NDArray[np.floating],
    sample_rate: float,
    *,
    seconds: float | None = None,
    period: int | None = None,
    body: bool = False,
) -> NDArray[np.float32]:
    """Return a bridge force as sound.

    Parameters
    ----------
    force
        (samples,) bridge force.
    sample_rate
        Hz.
    seconds
        Length of the sound; None: as long as the waveform. Where the waveform is shorter its last periods are repeated,
        joined where they fit best; :func:`simulated` continues it by simulating on instead.
    period
        Nominal period of the string, samples; needed to repeat periods.
    body
        Filter by a violin's body, see :mod:`bow_sweep.cell.body`.

    Returns
    -------
    ndarray of float32, shape (samples,)
        At `RATE`; the first and the last sample are 0, the largest is `PEAK_DB`. A waveform at rest is silent.

    Raises
    ------
    SoundError
        For a length that cannot be, or no period where it is needed.
    """
    wave = np.asarray(force, float)
    count = None
    if seconds is not None:
        check_seconds(seconds)
        count = round(seconds * RATE)
        needed = int(np.ceil(seconds * sample_rate)) + 1
        if len(wave) < needed:
            if period is None:
                raise SoundError(f"{seconds:g} s: longer than the waveform, and its period is not given")
            wave = looped(wave, period, needed)
        wave = wave[:needed]
    out = resampled(wave - wave[:1], sample_rate)  # from the first sample on, so that the filter begins at rest
    out = out[:count] if count is not None else out
    if np.ptp(wave, axis=0) < analysis.SILENCE:
        return np.zeros(len(out), np.float32)
    out = _without_drift(out)
    if body:
        out = filtered(out, RATE)
    out = _faded(out)
    scale = 10 ** (PEAK_DB / 20) / max(float(np.max(np.abs(out))), 1e-300)
    return np.asarray(out * scale + 0.0, np.float32)  # + 0.0: no negative zeros


def check_seconds(seconds: float) -> None:
    """Raise SoundError for a length that cannot be."""
    if not 0.05 <= seconds <= MOST_SECONDS:
        raise SoundError(f"{seconds:g} s: a sound should be 0.05 to {MOST_SECONDS:g} s long")


def resampled(wave: NDArray[np.float64], sample_rate: float) -> NDArray[np.float64]:
    """Return a waveform at `RATE`, (samples,)."""
    from scipy.signal import firwin, resample_poly

    ratio = Fraction(RATE / sample_rate).limit_denominator(_DENOMINATOR)
    up, down = ratio.numerator, ratio.denominator
    if up == down or not len(wave):
        return wave
    wide = max(up, down)
    taps = firwin(2 * _ZEROS * wide + 1, _CUTOFF / wide, window=("kaiser", _BETA))
    return np.asarray(resample_poly(wave, up, down, window=taps))


def _without_drift(wave: NDArray[np.float64]) -> NDArray[np.float64]:
    """Take out what is slower than `LOWEST`; before its first sample the wave is taken to rest at its mean."""
    from scipy.signal import butter, sosfilt, sosfilt_zi

    sections = butter(2, LOWEST, "highpass", fs=RATE, output="sos")
    before = float(np.mean(wave[: round(START_S * RATE)])) if len(wave) else 0.0
    return np.asarray(sosfilt(sections, wave, zi=sosfilt_zi(sections) * before)[0])


def _faded(wave: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a waveform that begins and ends with 0, along half a cosine."""
    out = wave.copy()
    for length, part in ((FADE_IN, slice(None)), (FADE_OUT, slice(None, None, -1))):
        count = min(round(length * RATE), len(out) // 2)
        out[part][:count] *= 0.5 - 0.5 * np.cos(np.pi * np.arange(count) / count)
    return out


def looped(force: NDArray[np.floating], period: int, samples: int) -> NDArray[np.float64]:
    """Return a waveform of `samples`, continued by its last periods again and again.

    Each repetition begins where the waveform is most like its end, over a crossfade of one period: a steady motion goes
    on without a seam, an unsteady one repeats itself.

    Parameters
    ----------
    force
        (n,) bridge force.
    period
        Nominal period, samples.
    samples
        Length to reach.
    """
    wave = np.asarray(force, float)
    true = analysis.period_of(wave, period) or float(period)
    counts = np.arange(1, min(LOOP_PERIODS, max(1, int(len(wave) / true) - 1)) + 1)
    length = round(float(true * counts[np.argmin(np.abs(counts * true - np.round(counts * true)) / counts)]))
    fade = min(period, len(wave) - length)
    if len(wave) < 2 * period or fade < 1:
        raise SoundError(f"a waveform of {len(wave)} samples: should have two periods at least, of {period} samples")
    rise = 0.5 - 0.5 * np.cos(np.pi * (np.arange(fade) + 0.5) / fade)
    parts, size = [wave[: len(wave) - fade]], len(wave) - fade
    seam = wave[-fade:] * (1 - rise) + wave[-fade - length : len(wave) - length] * rise
    again = np.concatenate([seam, wave[len(wave) - length : len(wave) - fade]]) if fade < length else seam[:length]
    while size < samples:
        parts.append(again)
        size += len(again)
    return np.concatenate(parts)[:samples]


def simulated(parameters: Parameters, seconds: float) -> NDArray[np.float32]:
    """Return the bridge force of a cell simulated for at least so many seconds.

    Parameters
    ----------
    parameters
        Of the cell; their `periods` are not used. A longer simulation begins with the samples of a shorter one.
    seconds
        Length of the sound.

    Raises
    ------
    SoundError
        For a length that cannot be.
    """
    from bow_sim.kernel.block import Block

    check_seconds(seconds)
    chunks = int(seconds * parameters.sample_rate) // (CHUNK_PERIODS * parameters.period) + 1
    block = Block(parameters, {"f_asym": [parameters.f_asym]})
    return np.concatenate([block.advance().bridge_force[0] for _ in range(chunks)])


def sound_of(
    force: NDArray[np.floating], parameters: Parameters, seconds: float | None = None, body: bool = False
) -> Sound:
    """Return the sound of a cell; where it should last longer than the waveform, the string is simulated on.

    Parameters
    ----------
    force
        (samples,) bridge force, from the first sample on.
    parameters
        Of the cell.
    seconds
        Length; None: that of the waveform.
    body
        As in :func:`sound`.

    Raises
    ------
    SoundError
        For a length that cannot be.
    """
    rate, how = parameters.sample_rate, "the waveform as it is"
    wave = np.asarray(force, np.float32)
    if seconds is not None and seconds * rate + 1 > len(wave):
        longer = simulated(parameters, seconds)
        if np.array_equal(longer[: len(wave)], wave):
            wave, how = longer, "simulated on"
        else:
            how = "its last periods repeated: the kernel here makes another waveform"
    elif seconds is not None:
        how = "its beginning"
    if body:
        how += ", through a violin's body"
    return Sound(sound(wave, rate, seconds=seconds, period=parameters.period, body=body), how)


def check_wav(path: Path) -> None:
    """Raise SoundError if a file should not be a WAV file by its suffix."""
    if path.suffix.lower() != ".wav":
        what = f"as {path.suffix}" if path.suffix else "without a suffix"
        raise SoundError(f"{path}: cannot write sound {what}; should end in .wav")


def wav_bytes(samples: NDArray[np.floating]) -> bytes:
    """Return a sound as the bytes of a WAV file, 16 bit, one channel, `RATE`."""
    from scipy.io import wavfile

    scaled = np.round(32767 * np.clip(np.asarray(samples, float), -1, 1)).astype(np.int16)
    file = io.BytesIO()
    wavfile.write(file, RATE, scaled)
    return file.getvalue()


def save_wav(path: Path, samples: NDArray[np.floating]) -> None:
    """Write a sound as a WAV file; readers see the old file or the complete new one.

    Raises
    ------
    SoundError
        If the suffix is not .wav.
    OSError
        If the file cannot be written.
    """
    check_wav(path)
    with replacing(path) as file:
        file.write(wav_bytes(samples))
