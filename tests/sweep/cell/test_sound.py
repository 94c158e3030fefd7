"""A bridge force as sound: its pitch, its ends, its level, its length; the body it may pass through."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from scipy.io import wavfile

from bow_sim.kernel.block import transient
from bow_sim.physics.parameters import Parameters
from bow_sweep.cell import sound as made
from bow_sweep.cell.body import MODES, filtered
from bow_sweep.cell.sound import RATE, SoundError, looped, resampled, save_wav, simulated, sound, sound_of, wav_bytes

CELL = Parameters(model="delta_cremer", v_mid=0.7, f_asym=5.5, periods=60)


@pytest.fixture(scope="module")
def force() -> np.ndarray:
    """The bridge force of the paper's Figs 5 and 6, which ends in Helmholtz motion."""
    return transient(CELL)["bridge_force"].astype(np.float32)


def strongest(wave: np.ndarray, low: float = 30, high: float = 20_000) -> float:
    """The frequency of the strongest sinusoid, Hz, to a small part of a cent."""
    padded = 16 * len(wave)
    power = np.abs(np.fft.rfft(wave * np.hanning(len(wave)), padded))
    frequency = np.fft.rfftfreq(padded, 1 / RATE)
    power[(frequency < low) | (frequency > high)] = 0
    best = int(np.argmax(power))
    left, middle, right = np.log(power[best - 1 : best + 2])
    return float((best + 0.5 * (left - right) / (left - 2 * middle + right)) * RATE / padded)


def cents(frequency: float, reference: float) -> float:
    return 1200 * float(np.log2(frequency / reference))


def level_at(wave: np.ndarray, frequency: float) -> float:
    window = np.hanning(len(wave))
    phase = np.exp(-2j * np.pi * frequency / RATE * np.arange(len(wave)))
    return float(20 * np.log10(2 * abs((wave * window) @ phase) / window.sum()))


def test_the_pitch_is_that_of_the_string(force: np.ndarray) -> None:
    heard = sound_of(force, CELL, 2.0)
    assert heard.how == "simulated on"
    steady = heard.samples[RATE:]
    assert abs(cents(strongest(steady, 300, 600), 61_160 / 139)) < 1


def test_a_repeated_ending_keeps_the_pitch(force: np.ndarray) -> None:
    heard = sound(force, CELL.sample_rate, seconds=2.0, period=139)
    assert len(heard) == 2 * RATE
    assert abs(cents(strongest(heard[RATE:], 300, 600), 61_160 / 139)) < 1


@pytest.mark.parametrize("rate", [44_100.0, 48_000.0, 61_160.0, 61_160.7, 96_000.0, 250_000.0])
def test_a_sinusoid_of_any_rate_keeps_frequency_and_amplitude(rate: float) -> None:
    tone = np.sin(2 * np.pi * 1000 / rate * np.arange(int(rate)))
    out = resampled(tone, rate)
    middle = out[RATE // 4 : 3 * RATE // 4]
    assert abs(cents(strongest(middle), 1000)) < 0.01
    assert np.abs(middle).max() == pytest.approx(1, abs=2e-3)
    assert abs(len(out) - RATE) <= 1


def test_what_cannot_be_heard_is_not_folded_into_what_can() -> None:
    rate = 61_160.0
    tone = np.sin(2 * np.pi * 28_000 / rate * np.arange(int(rate)))  # would be heard at 20 kHz
    out = resampled(tone, rate)[RATE // 4 : 3 * RATE // 4]
    assert np.abs(out).max() < 1e-4


@pytest.mark.parametrize("body", [False, True])
def test_its_ends_do_not_click(force: np.ndarray, body: bool) -> None:
    heard = sound(force, CELL.sample_rate, seconds=1.0, period=139, body=body)
    assert heard[0] == heard[-1] == 0
    usual = np.abs(np.diff(heard)).max()
    for end in (heard[:10], heard[-10:]):
        assert np.abs(end).max() < 2e-3
        assert np.abs(np.diff(end)).max() < 0.01 * usual


def test_a_repeated_ending_of_a_steady_motion_is_the_motion_that_goes_on(force: np.ndarray) -> None:
    true = simulated(CELL, 0.3)
    wave = looped(force, 139, len(true))
    assert wave[: len(force) - 139].tolist() == force[: len(force) - 139].tolist()
    assert np.abs(wave - true).max() < 0.06 * np.ptp(true)
    steps = np.abs(np.diff(wave))
    assert steps[len(force) - 200 :].max() <= 1.02 * steps[len(force) - 1500 : len(force) - 200].max()


@pytest.mark.parametrize("body", [False, True])
def test_the_level_is_set_and_the_mean_is_zero(force: np.ndarray, body: bool) -> None:
    heard = sound_of(force, CELL, None, body)
    assert heard.peak_db == pytest.approx(made.PEAK_DB, abs=1e-3)
    assert abs(heard.samples.mean()) < 3e-3
    assert "peak -3.0 dB" in heard.describe()
    assert ("violin" in heard.describe()) == body


def test_a_steady_ending_begins_without_a_thump(force: np.ndarray) -> None:
    tail = force[-20 * 139 :]
    top = int(np.argmax(tail[:139]))  # the mean is far below the first sample
    heard = sound(tail[top:], CELL.sample_rate)
    slow = np.convolve(heard, np.ones(218) / 218, "valid")  # two periods
    assert np.abs(slow).max() < 0.1


def test_a_string_at_rest_is_silent() -> None:
    heard = sound(np.full(5000, 2.5, np.float32), 61_160.0)
    assert not heard.any()
    assert len(heard) == pytest.approx(5000 * RATE / 61_160, abs=1)


def test_the_length_is_exact(force: np.ndarray) -> None:
    for seconds in (0.05, 0.1, 0.731, 2.5):
        assert len(sound_of(force, CELL, seconds).samples) == round(seconds * RATE)
    assert sound_of(force, CELL, 0.1).how == "its beginning"


def test_simulating_on_begins_with_the_same_samples(force: np.ndarray) -> None:
    longer = simulated(CELL, 0.5)
    assert len(longer) >= 0.5 * CELL.sample_rate
    assert longer[: len(force)].tobytes() == force.tobytes()


def test_a_waveform_of_another_kernel_is_repeated_and_that_is_said(force: np.ndarray) -> None:
    other = force.copy()
    other[5000] = np.nextafter(other[5000], np.float32(9))
    assert "periods repeated: the kernel here makes another waveform" in sound_of(other, CELL, 1.0).how


def test_the_same_cell_gives_the_same_bytes(force: np.ndarray) -> None:
    first, again = (wav_bytes(sound_of(force.copy(), CELL, 1.0, True).samples) for _ in range(2))
    assert first == again


def test_a_wav_file_is_what_others_read(force: np.ndarray, tmp_path: Path) -> None:
    heard = sound(force, CELL.sample_rate)
    save_wav(tmp_path / "t.wav", heard)
    rate, samples = wavfile.read(tmp_path / "t.wav")
    assert (rate, samples.dtype, samples.ndim) == (48_000, np.int16, 1)
    assert np.abs(samples / 32767 - heard).max() <= 0.5 / 32767 + 1e-7
    assert wavfile.read(io.BytesIO(wav_bytes(heard)))[0] == 48_000


@pytest.mark.parametrize("name", ["t.mp3", "t", "t.wav.txt"])
def test_another_suffix_is_refused_and_nothing_written(name: str, tmp_path: Path) -> None:
    with pytest.raises(SoundError, match=r"should end in \.wav"):
        save_wav(tmp_path / name, np.zeros(10))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("seconds", [0.0, -1.0, 0.01, 61.0, float("nan"), float("inf")])
def test_a_length_that_cannot_be_is_refused(seconds: float, force: np.ndarray) -> None:
    with pytest.raises(SoundError, match=r"should be 0.05 to 60 s"):
        sound_of(force, CELL, seconds)


def test_without_a_period_nothing_can_be_repeated(force: np.ndarray) -> None:
    with pytest.raises(SoundError, match="period is not given"):
        sound(force, CELL.sample_rate, seconds=3.0)
    with pytest.raises(SoundError, match="two periods at least"):
        looped(force[:150], 139, 1000)


def test_the_body_is_loud_at_its_modes_and_stable() -> None:
    impulse = np.zeros(RATE)
    impulse[0] = 1.0
    answer = filtered(impulse, RATE)
    assert np.abs(answer[RATE // 2 :]).max() < 1e-6
    response = np.abs(np.fft.rfft(answer))  # a line for each Hz
    for mode in (MODES[0], MODES[2], MODES[3]):  # CBR is on the shoulder of B1-
        near = response[int(mode.frequency) - 40 : int(mode.frequency) + 41]
        assert abs(int(np.argmax(near)) - 40) <= 12, mode.name
    hill, valley = response[2000:3000].mean(), response[900:1100].mean()
    assert 20 * np.log10(hill / valley) > 4


def test_the_body_leaves_the_pitch_and_colours_the_harmonics(force: np.ndarray) -> None:
    plain, coloured = (sound_of(force, CELL, 1.0, body).samples[RATE // 2 :] for body in (False, True))
    first = 61_160 / 139
    change = [level_at(coloured, n * first) - level_at(plain, n * first) for n in (1, 2, 6)]
    assert change[0] - change[1] > 5  # near B1-, and in the gap above B1+
    assert change[2] - change[1] > 5  # on the bridge hill
