"""A bridge force judged without the stream of stick and slip: by what a sensor gives, whatever its unit and sign."""

from __future__ import annotations

import json
import re
import struct
from pathlib import Path

import numpy as np
import pytest
from scipy.io import wavfile
from scipy.signal import resample_poly

import bow
from bow.recorded import read_recording
from bow.recordings import RecordingError
from bow_classifier.measured.force_slips import (
    SLIPPING,
    bow_speed,
    intervals,
    polarity,
    quiet_phase,
    round_trip,
    velocity,
)
from bow_classifier.verdict.regimes import is_helmholtz
from bow_sweep.cli import main

N, DELAY = 139, 15
F0 = 440.0


@pytest.fixture(scope="module")
def played() -> bow.Map:
    """Two rows of Fig 11(d): multiple slip, Helmholtz motion, raucous motion."""
    return bow.sweep("fig11d", nx=8, ny=2, periods=60, progress=False)


@pytest.fixture(scope="module")
def helmholtz(played: bow.Map) -> bow.Cell:
    """A cell that ends in Helmholtz motion."""
    return played.cell(int(np.flatnonzero(played.regime.ravel() == "helmholtz")[0]))


def kinematic(slips: dict[int, int], periods: int = 12) -> np.ndarray:
    """The force of a string without losses that slips in every period: first sample of a slip -> its length.

    While it sticks it moves with the bow, at speed 1; in all slips together it comes back. Slips are as long as the
    round trip, or parts of it, so that the waves repeat.
    """
    v = np.ones(N)
    total = sum(slips.values())
    for onset, length in slips.items():
        v[onset : onset + length] = -(N - total) / total
    v = np.tile(v, periods)
    force = np.zeros(len(v))
    spectrum = np.fft.rfft(v)  # x[t] - x[t - d] = v[t], solved where the left side is not 0
    turn = 1 - np.exp(-2j * np.pi * np.fft.rfftfreq(len(v)) * DELAY)
    known = np.abs(turn) > 1e-9
    force = np.fft.irfft(np.where(known, spectrum / np.where(known, turn, 1), 0), len(v))
    return force


def test_the_velocity_under_the_bow_follows_from_the_force() -> None:
    force = kinematic({40: DELAY})
    found = velocity(force, DELAY)[DELAY:]
    assert bow_speed(found) == pytest.approx(1, abs=1e-6)
    assert polarity(found) == 1
    assert polarity(-found) == -1
    slip = intervals(1 - velocity(force, DELAY)[N : 2 * N], before=False)
    assert slip.onset.tolist() == [40]
    assert slip.duration.tolist() == [DELAY]
    assert slip.slip.tolist() == pytest.approx([N])  # a whole Helmholtz slip


def test_a_slip_that_a_border_cuts_is_told_to_the_next_chunk() -> None:
    speed = np.array([0.0, SLIPPING + 1, SLIPPING + 1])
    assert intervals(speed, before=False).duration.tolist() == [2]
    assert intervals(speed, before=True).slipping.tolist() == [1]


def test_chunks_begin_where_the_string_sticks() -> None:
    speed = np.ones((9, N))
    speed[:, -7:] = speed[:, :8] = -8.0  # it slips over the border
    assert 25 < quiet_phase(speed.ravel(), N) < N - 25


def test_a_good_guess_of_the_round_trip_is_kept(helmholtz: bow.Cell) -> None:
    force = helmholtz.bridge_force.astype(float)
    assert round_trip(force - force.mean(), DELAY) == pytest.approx(DELAY, abs=0.26)


def shares_of_agreement(m: bow.Map, **recorded: float) -> tuple[float, float]:
    """Shares of the tests with the same answer to Helmholtz or not, and with the same regime."""
    rate, noise = recorded.get("rate", 44100), recorded.get("noise", 0.0)
    chance = np.random.default_rng(1)
    same, equal = [], []
    for number in range(m.shape[0] * m.shape[1]):
        c = m.cell(number)
        wave = resample_poly(c.bridge_force - c.bridge_force.mean(), int(rate) // 20, int(c.sample_rate) // 20)
        wave = 5.0 - 0.02 * wave
        wave = wave + noise * np.std(wave) * chance.normal(size=len(wave))
        found = bow.classify(wave, rate, F0 * recorded.get("sharp", 1.0), beta=recorded.get("beta", DELAY / N))
        tests = min(len(found.regime), len(c.tests.regime))
        truth = np.array([c.tests.name(test) for test in range(tests)])
        truth[truth == "helmholtz_extra_slips"] = "helmholtz"
        same += (found.helmholtz[:tests] == is_helmholtz(c.tests.regime[:tests])).tolist()
        equal += (found.regime[:tests] == truth).tolist()
    return float(np.mean(same)), float(np.mean(equal))


@pytest.mark.full
@pytest.mark.parametrize(
    ("recorded", "least", "least_equal"),
    [
        ({}, 0.95, 0.85),
        ({"rate": 48000}, 0.95, 0.85),
        ({"sharp": 1.03}, 0.95, 0.85),
        ({"sharp": 0.97, "noise": 0.1}, 0.95, 0.85),
    ],
    ids=["44.1 kHz", "48 kHz", "sharp", "flat with noise"],
)
def test_force_alone_tells_helmholtz_motion(
    played: bow.Map, recorded: dict[str, float], least: float, least_equal: float
) -> None:
    same, equal = shares_of_agreement(played, **recorded)
    assert same >= least
    assert equal >= least_equal


def test_unit_sign_and_offset_of_a_sensor_change_no_verdict(helmholtz: bow.Cell) -> None:
    force = helmholtz.bridge_force.astype(float)
    one = bow.classify(force, helmholtz.sample_rate, F0, beta=DELAY / N)
    other = bow.classify(40 - 7e-3 * force, helmholtz.sample_rate, F0, beta=DELAY / N)
    assert one.regime.tolist() == other.regime.tolist()
    assert one.regime[-1] == "helmholtz"
    assert other.bow_speed[-1] == pytest.approx(-7e-3 * one.bow_speed[-1])


def test_what_fades_to_noise_is_no_oscillation(helmholtz: bow.Cell) -> None:
    force = helmholtz.bridge_force.astype(float)
    chance = np.random.default_rng(2)
    silence = 0.02 * np.std(force) * chance.normal(size=30 * N)
    found = bow.classify(np.concatenate([force, force[-1] + silence]), helmholtz.sample_rate, F0, beta=DELAY / N)
    assert set(found.regime[-4:]) == {"no_oscillation"}
    assert found.shares["no_oscillation"] < 0.5


def test_the_pitch_is_found_where_it_is_not_known_well(helmholtz: bow.Cell) -> None:
    found = bow.classify(helmholtz.bridge_force, helmholtz.sample_rate, F0 * 1.025, beta=DELAY / N)
    assert found.found
    assert found.f0 == pytest.approx(helmholtz.frequency, rel=2e-3)
    as_given = bow.classify(helmholtz.bridge_force, helmholtz.sample_rate, F0, beta=DELAY / N, f0_within=0)
    assert (as_given.found, as_given.f0) == (False, F0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"x": np.zeros((2, 5000))}, r"x: shape \(2, 5000\); should be \(samples,\), one string, for instance x\[0\]"),
        ({"x": np.zeros((5000, 2))}, r"for instance x\[:, 0\]"),
        ({"x": np.zeros(5000) + 1j}, "x: holds complex128; should be real numbers"),
        ({"x": ["a"] * 5000}, "x: holds <U1; should be real numbers"),
        ({"x": np.full(5000, np.nan)}, "sample 0 is not a finite number"),
        ({"x": np.zeros(5000)}, "all samples are the same"),
        ({"x": np.arange(50.0)}, "x: 50 samples; should be 702 at least, seven periods"),
        ({"sample_rate": 2000.0}, "sample_rate = 2000: should be at least 7040 Hz"),
        ({"f0": -1.0}, "f0 = -1.0: should be a number above 0"),
        ({"beta": 0.6}, "beta = 0.6: should be 0.02 ... 0.35"),
        ({"f0_within": 0.5}, "f0_within = 0.5: should be 0 ... 0.06"),
    ],
    ids=lambda value: "-".join(value) if isinstance(value, dict) else "",
)
def test_a_recording_that_cannot_be_judged_says_why(changes: dict[str, object], words: str) -> None:
    given: dict[str, object] = {"x": np.sin(np.arange(5000) / 7), "sample_rate": 44100.0, "f0": 440.0} | changes
    with pytest.raises(RecordingError, match=words):
        bow.classify(**given)  # type: ignore[arg-type]


def test_the_command_judges_a_wav_file(helmholtz: bow.Cell, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    force = helmholtz.bridge_force
    wavfile.write(tmp_path / "a.wav", int(helmholtz.sample_rate), np.round(900 * force).astype(np.int16))
    np.save(tmp_path / "a.npy", force)
    assert main(["classify", str(tmp_path / "a.wav"), "--f0", "441", "--beta", "0.108"]) == 0
    assert "Helmholtz" in capsys.readouterr().out.splitlines()[-1]
    rate = ["--rate", str(helmholtz.sample_rate)]
    assert main(["classify", str(tmp_path / "a.npy"), *rate, "--f0", "441", "--beta", "0.108", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["regime"][-1] == "helmholtz"


def test_a_wrong_file_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.save(tmp_path / "a.npy", np.sin(np.arange(9999.0)))
    (tmp_path / "b.wav").write_bytes(b"RIFF")
    np.save(tmp_path / "e.npy", np.ones(9999) + 1j)
    np.save(tmp_path / "f.npy", np.zeros((2, 3, 4)))
    wavfile.write(tmp_path / "g.wav", 8000, np.array([np.zeros(9999), np.arange(9999)]).T)
    wavfile.write(tmp_path / "h.wav", 8000, np.zeros(0))
    (tmp_path / "i.wav").write_bytes((tmp_path / "g.wav").read_bytes()[:30])
    (tmp_path / "j.wav").write_bytes((tmp_path / "g.wav").read_bytes()[:-8])
    for words, said in (
        (["e.npy", "--rate", "44100"], "e.npy: holds complex128; should be real numbers"),
        (["f.npy", "--rate", "44100"], "f.npy: shape (2, 3, 4); should be a row of numbers, or a row for each channel"),
        (["g.wav"], "g.wav, channel 0: all samples are the same"),
        (["h.wav"], "h.wav: holds no samples"),
        (["j.wav"], "j.wav: is cut off, with more samples of one channel than of another"),
        (["i.wav"], "i.wav: cannot be read as a recording: it ends within its header"),
        (["a.npy"], "does not say its sample rate; give it"),
        (["a.npy", "--rate", "44100", "--channel", "1"], "channel 1: it has 1, from 0 on"),
        (["b.wav"], "cannot be read as a recording"),
        (["c.wav"], "there is no such file"),
        (["d.mp3"], "should end in .wav, .npy or .mcap"),
    ):
        assert main(["classify", str(tmp_path / words[0]), *words[1:], "--f0", "440"]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert said in line


def test_one_channel_of_several_is_taken(tmp_path: Path) -> None:
    wavfile.write(tmp_path / "a.wav", 8000, np.array([[1, 10], [2, 20]], np.int16))
    found = read_recording(tmp_path / "a.wav", 1)
    assert (found.samples.tolist(), found.sample_rate) == ([10.0, 20.0], 8000.0)


def test_what_should_be_known_of_a_recording_is_noted(
    helmholtz: bow.Cell, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rate, force = int(helmholtz.sample_rate), helmholtz.bridge_force
    high = np.quantile(force, 0.98)
    both = np.array([np.round(900 * force), np.round(900 * np.minimum(force, high))], np.int16).T
    wavfile.write(tmp_path / "a.wav", rate, both)
    whole = (tmp_path / "a.wav").read_bytes()
    extra = b"LIST" + struct.pack("<I", 6) + b"INFOxy"  # as recorders write a title: no sound
    (tmp_path / "a.wav").write_bytes(whole[:12] + extra + whole[12:])
    (tmp_path / "cut.wav").write_bytes(whole[: len(whole) // 8 * 4])
    for name, channel, notes in (
        ("a.wav", 0, ["channel 0 of 0 ... 1 is judged"]),
        ("a.wav", 1, ["channel 1 of 0 ... 1 is judged", r"perhaps clipped: \d+ samples in a row at \d+, beyond .*"]),
        ("cut.wav", 0, [r"the file is cut off after 0\.\d+ s", "channel 0 of 0 ... 1 is judged"]),
    ):
        assert main(["classify", str(tmp_path / name), "--f0", "440", "--channel", str(channel)]) == 0
        out, err = capsys.readouterr()
        found = [line.removeprefix("note: ") for line in out.splitlines() if line.startswith("note: ")]
        assert len(found) == len(notes)
        assert all(re.fullmatch(one, other) for one, other in zip(notes, found, strict=True)), found
        assert err == ""
