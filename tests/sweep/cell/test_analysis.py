"""The steady end of a waveform: period, spectrum, harmonics, against waves whose parts are known."""

from __future__ import annotations

import numpy as np
import pytest

from bow_sim.kernel.block import transient
from bow_sim.physics.parameters import Parameters
from bow_sweep.cell import analysis

RATE = 61_160.0


def wave(period: float, amplitudes: list[float], samples: int = 8000, mean: float = 2.0) -> np.ndarray:
    """A sum of harmonics of a period in samples."""
    phase = 2 * np.pi * np.arange(samples) / period
    return mean + sum(a * np.sin(n * phase + n) for n, a in enumerate(amplitudes, 1))


@pytest.mark.parametrize("period", [139.0, 139.43, 133.7, 145.2])
def test_a_period_is_found_between_the_samples(period: float) -> None:
    assert analysis.period_of(wave(period, [1, 0.5, 0.3, 0.2]), 139) == pytest.approx(period, abs=0.003)


def test_a_wave_at_rest_or_too_short_has_no_period() -> None:
    assert analysis.period_of(np.full(8000, 3.0), 139) is None
    assert analysis.period_of(1e-5 * wave(139, [1.0]), 139) is None
    assert analysis.period_of(wave(139, [1.0], samples=300), 139) is None
    assert analysis.period_of(wave(139 * 1.5, [1.0]), 139) is None
    noise = np.random.default_rng(1).normal(size=8000)
    assert analysis.period_of(noise, 139) is None
    assert analysis.period_of(wave(139.4, [1, 0.5, 0.3, 0.2]) + 0.3 * noise, 139) == pytest.approx(139.4, abs=0.1)


def test_harmonics_have_their_amplitudes() -> None:
    amplitudes = [1.0, 0.1, 0.5, 0.003]
    found = analysis.harmonics(wave(139.43, amplitudes), RATE, 139.43)
    assert found.level[:4] == pytest.approx(20 * np.log10(amplitudes), abs=0.05)
    assert found.frequency[0] == pytest.approx(RATE / 139.43)
    assert found.number[-1] == 69
    assert found.level[4:].max() < -70


def test_a_single_period_has_harmonics_too() -> None:
    found = analysis.harmonics(wave(139.0, [1.0], mean=5.0), RATE, 139.0, periods=1)
    assert found.level[0] == pytest.approx(0, abs=0.1)


def test_a_spectrum_shows_the_harmonics_at_their_frequencies() -> None:
    found = analysis.spectrum(wave(139.0, [1.0, 0.1]), RATE, 139.0)
    first = RATE / 139
    assert found.frequency[np.argmax(found.level)] == pytest.approx(first, abs=found.frequency[1])
    assert found.level.max() == pytest.approx(0, abs=0.01)
    second = found.level[np.argmin(np.abs(found.frequency - 2 * first))]
    assert second == pytest.approx(-20, abs=0.01)
    assert found.frequency[-1] == pytest.approx(RATE / 2)
    assert found.level[0] < -60  # the mean is removed


def test_a_spectrum_of_rest_is_finite() -> None:
    found = analysis.spectrum(np.zeros(3000), RATE)
    assert np.isfinite(found.level).all()


def test_the_tail_is_whole_periods() -> None:
    ramp = np.arange(10_000)
    assert len(analysis.steady_tail(ramp, 139.4, 20)) == 2788
    assert analysis.steady_tail(ramp, 139.4, 20)[-1] == 9999
    assert len(analysis.steady_tail(ramp[:1000], 139.4, 20)) == 976
    assert len(analysis.steady_tail(ramp[:100], 139.4)) == 100


def test_helmholtz_motion_falls_like_a_sawtooth_and_misses_the_harmonics_with_a_node_at_the_bow() -> None:
    p = Parameters(model="delta_cremer", v_mid=0.7, f_asym=5.5)
    force = transient(p)["bridge_force"]
    period = analysis.period_of(force, p.period)
    assert period == pytest.approx(139, abs=0.05)
    level = analysis.harmonics(force, p.sample_rate, period).level
    assert level[0] - level[3] == pytest.approx(20 * np.log10(4), abs=2)  # 1/n
    assert level[8] < level[7] - 3  # beta = 15/139: the node of harmonic 9.27 lies under the bow


def test_cents_are_positive_for_a_sharp_note() -> None:
    assert analysis.cents(139 / 2, 139) == pytest.approx(1200)
    assert analysis.cents(140, 139) < 0
