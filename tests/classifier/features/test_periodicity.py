from __future__ import annotations

import numpy as np
import pytest
from kinematics import HEIGHT, N, helmholtz
from reference import periodicity as slow

from bow_classifier.features.periodicity import periodicity

LAGS = (135, 145)
START = LAGS[1] + 1


def judge(x, end, lags=LAGS):
    """Return correlation, period and deviation over the five periods before `end`."""
    start = max(START, lags[1] + 1)
    record = np.concatenate([np.zeros(start), x])[None, end - 5 * N : end + start].astype(np.float32)
    result = periodicity(record, start, N, lags)
    return float(result.correlation[0]), float(result.period[0]), float(result.deviation[0])


def test_agrees_with_the_definition_on_any_signal():
    rng = np.random.default_rng(7)
    for k in range(40):
        t = np.arange(10 * N)
        x = rng.normal(0, rng.uniform(0, 1), t.size) + rng.uniform(0, 50)
        for harmonic in range(1, 6):
            x += rng.normal() * np.sin(2 * np.pi * harmonic * t / rng.uniform(134, 146) + rng.uniform(0, 6))
        x = x.astype(np.float32).astype(float)
        end = 5 * N * (1 + k % 2)
        expected = slow(x, end, N, range(LAGS[0], LAGS[1] + 1))
        found = judge(x, end)
        np.testing.assert_allclose(found[:2], expected, atol=1e-6, rtol=1e-6)
        np.testing.assert_allclose(found[2], x[end - 5 * N : end].std(), rtol=1e-9)


@pytest.mark.parametrize("period", [136.2, 137.5, 139, 140.3, 143.9])
def test_the_place_of_the_maximum_is_the_period(period):
    t = np.arange(10 * N)
    correlation, place, _ = judge(np.sin(2 * np.pi * t / period) * 3 + 20, 10 * N)
    assert correlation > 0.999
    assert place == pytest.approx(period, abs=0.02)


def test_a_period_outside_the_lags_is_no_maximum():
    t = np.arange(10 * N)
    assert np.isnan(judge(np.sin(2 * np.pi * t / 147), 10 * N)[:2]).all()
    assert judge(np.sin(2 * np.pi * t / 147), 10 * N, (135, 150))[1] == pytest.approx(147, abs=0.1)


def test_two_equal_neighbours_are_one_maximum():
    twice = np.concatenate([np.ones(20), np.zeros(119), np.ones(20), np.zeros(120)])  # 139 and 140 samples in turn
    correlation, place, _ = judge(np.tile(twice, 6), 10 * N)
    assert 0.5 < correlation <= 1
    assert 139 <= place <= 140


def test_a_correlation_never_exceeds_one():
    x = np.tile(np.r_[1.0, np.zeros(N - 1)], 12)
    x += np.roll(x, 1) * 0.9
    assert judge(x, 10 * N)[0] <= 1


@pytest.mark.parametrize("level", [0.0, 3.3, 1e6])
def test_a_constant_has_no_correlation_and_no_deviation(level):
    correlation, place, deviation = judge(np.full(10 * N, level), 10 * N)
    assert np.isnan([correlation, place]).all()
    assert deviation == 0


def test_before_the_bow_starts_nothing_correlates():
    assert np.isnan(judge(helmholtz(5 * N).bridge_force, 5 * N)[0])


def test_motion_that_stops_for_a_whole_period_has_no_correlation():
    x = helmholtz(10 * N).bridge_force * 1e4 + np.random.default_rng(0).normal(size=10 * N)
    x[7 * N - 5 : 8 * N + 30] = x[7 * N - 5]
    expected = slow(x.astype(np.float32).astype(float), 10 * N, N, range(135, 146))
    np.testing.assert_allclose(judge(x, 10 * N)[:2], expected)


def test_a_large_mean_costs_no_accuracy():
    x = helmholtz(10 * N).bridge_force
    shifted = (x.astype(np.float32) + np.float32(2**20)).astype(float)
    assert judge(shifted, 10 * N)[0] == pytest.approx(judge(shifted - 2**20, 10 * N)[0], abs=1e-9)


def test_noise_lowers_the_correlation():
    rng = np.random.default_rng(3)
    x, noise = helmholtz(10 * N).bridge_force, rng.normal(size=10 * N) * HEIGHT
    found = [judge(x + share * noise, 10 * N)[0] for share in (0.0, 0.02, 0.05, 0.1)]
    assert found == sorted(found, reverse=True)


def test_infinite_and_undefined_samples_have_no_period():
    x = helmholtz(10 * N).bridge_force
    for wrong in (np.nan, np.inf):
        x[8 * N] = wrong
        assert np.isnan(judge(x, 10 * N)[0])


@pytest.mark.parametrize("lags", [(139, 145), (135, 139), (0, 145), (135, 146)])
def test_lags_that_do_not_enclose_the_period_are_refused(lags):
    with pytest.raises(ValueError, match="enclose the period"):
        periodicity(np.zeros((1, 146 + 5 * N), np.float32), 146, N, lags)
