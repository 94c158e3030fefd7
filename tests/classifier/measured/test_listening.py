"""When a live signal is judged, and what is said of one that cannot be."""

from __future__ import annotations

import numpy as np
import pytest
from measured import BETA, F0, RATE, blocks, played

from bow_classifier.measured.listening import PAUSE_S, Begin, End, Listener
from bow_classifier.measured.tuning import Given


def heard(wave: np.ndarray, listener: Listener | None = None, **known: float) -> list[Begin | End | str]:
    """What a listener makes of a signal: its stretches, and "test" for each chunk."""
    listener = listener or Listener(Given(RATE, F0, BETA), **known)
    events: list[object] = []
    for block, now in blocks(wave):
        events += listener.take(block, now)
    events += listener.end("the end")
    return [event if isinstance(event, Begin | End) else "test" for event in events]


def noise(seconds: float, level: float = 1e-5) -> np.ndarray:
    return level * np.random.default_rng(5).normal(size=round(seconds * RATE))


def test_a_sound_is_judged_from_its_beginning() -> None:
    events = heard(played(0.8))
    assert isinstance(events[0], Begin)
    assert events[0].tuning.f0 == pytest.approx(F0, rel=1e-3)
    assert events[-1] == End("the end")
    assert 0.8 * F0 / 5 - 2 < events.count("test") <= 0.8 * F0 / 5


def test_noise_is_not_judged_and_the_sound_after_it_is() -> None:
    events = heard(np.concatenate([noise(0.7), played(0.6) - 2.5]))
    assert isinstance(events[0], Begin)
    assert events.count("test") >= 0.6 * F0 / 5 - 1


def test_silence_ends_a_stretch_and_the_next_note_begins_another() -> None:
    note = played(0.6) - 2.5
    events = heard(np.concatenate([note, noise(2.3), note]))
    assert [type(event) for event in events if event != "test"] == [Begin, End, Begin, End]
    assert End("silence for 2 s") in events


def test_above_a_level_everything_is_judged() -> None:
    raucous = noise(0.8, 1.0)
    assert heard(raucous) == []
    assert isinstance(heard(raucous, level=0.1)[0], Begin)
    assert heard(raucous, level=10.0) == []


def test_samples_that_are_no_numbers_end_a_stretch() -> None:
    wave = played(1.4)
    wave[round(0.7 * RATE)] = np.nan
    listener = Listener(Given(RATE, F0, BETA))
    events = heard(wave, listener)
    assert [type(event) for event in events if event != "test"] == [Begin, End, Begin, End]
    assert "1 of 480 samples are no finite numbers" in listener.complaints.popleft()


def test_nothing_that_comes_ends_a_stretch() -> None:
    listener = Listener(Given(RATE, F0, BETA))
    for block, now in blocks(played(0.6)):
        list(listener.take(block, now))
    assert listener.judging
    assert list(listener.pass_time(0.6 + 0.9 * PAUSE_S)) == []
    assert list(listener.pass_time(0.61 + PAUSE_S))[-1] == End("nothing came for 1 s")
    assert not listener.judging


def test_a_wrong_rate_is_said_once() -> None:
    listener = Listener(Given(RATE, F0, BETA))
    for block, now in blocks(played(0.6).repeat(20)[: round(11 * RATE)]):
        list(listener.take(block, now * 48000 / 44100))
    (said,) = (each for each in listener.complaints if "second" in each)
    assert said == "44100 samples come in a second; sample_rate is 48000"


@pytest.mark.parametrize(
    ("wave", "words"),
    [
        (np.full(48000, 3.3), "all samples are the same"),
        (noise(1.0), "no sound within 3% of 440 Hz"),
        (played(0.8, f0=330), "no sound within 3% of 440 Hz"),
    ],
    ids=["constant", "noise", "another note"],
)
def test_what_is_not_judged_is_said(wave: np.ndarray, words: str) -> None:
    listener = Listener(Given(RATE, F0, BETA))
    for block, now in blocks(wave):
        list(listener.take(block, now))
    assert words in listener.state


def test_a_clipped_signal_is_said() -> None:
    listener = Listener(Given(RATE, F0, BETA))
    for block, now in blocks(np.clip(played(0.6), 2.49, 2.51)):
        list(listener.take(block, now))
    assert "clipped" in listener.complaints[0]
    assert "in a row at 2." in listener.complaints[0]
