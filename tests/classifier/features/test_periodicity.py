from __future__ import annotations

import numpy as np
import pytest
from kinematics import HEIGHT, N, helmholtz
from reference import periodicity as slow
from window import measure

from bow_classifier.block_classifier import BlockClassifier, Geometry
from bow_classifier.verdict.thresholds import Thresholds

LAGS = (135, 145)
START = LAGS[1] + 1


def first_test(x, end, lags=LAGS):
    """Return correlation, period and deviation over the five periods before `end`."""
    start = max(START, lags[1] + 1)
    record = np.concatenate([np.zeros(start), x])[None, end - 5 * N : end + start]
    result = measure(record, start, near=lags)
    return float(result.correlation[0]), float(result.period[0]), float(result.loudness[0])


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
        found = first_test(x, end)
        np.testing.assert_allclose(found[:2], expected, atol=1e-6, rtol=1e-6)
        np.testing.assert_allclose(found[2], x[end - 5 * N : end].std(), rtol=1e-9)


@pytest.mark.parametrize("period", [136.2, 137.5, 139, 140.3, 143.9])
def test_the_place_of_the_maximum_is_the_period(period):
    t = np.arange(10 * N)
    correlation, place, _ = first_test(np.sin(2 * np.pi * t / period) * 3 + 20, 10 * N)
    assert correlation > 0.999
    assert place == pytest.approx(period, abs=0.02)


def test_a_period_outside_the_lags_is_no_maximum():
    t = np.arange(10 * N)
    assert np.isnan(first_test(np.sin(2 * np.pi * t / 147), 10 * N)[:2]).all()
    assert first_test(np.sin(2 * np.pi * t / 147), 10 * N, (135, 150))[1] == pytest.approx(147, abs=0.1)


def test_two_equal_neighbours_are_one_maximum():
    twice = np.concatenate([np.ones(20), np.zeros(119), np.ones(20), np.zeros(120)])  # 139 and 140 samples in turn
    correlation, place, _ = first_test(np.tile(twice, 6), 10 * N)
    assert 0.5 < correlation <= 1
    assert 139 <= place <= 140


def test_a_correlation_never_exceeds_one():
    x = np.tile(np.r_[1.0, np.zeros(N - 1)], 12)
    x += np.roll(x, 1) * 0.9
    assert first_test(x, 10 * N)[0] <= 1


@pytest.mark.parametrize("level", [0.0, 3.3, 1e6])
def test_a_constant_has_no_correlation_and_no_deviation(level):
    correlation, place, deviation = first_test(np.full(10 * N, level), 10 * N)
    assert np.isnan([correlation, place]).all()
    assert deviation == 0


def test_before_the_bow_starts_nothing_correlates():
    assert np.isnan(first_test(helmholtz(5 * N).bridge_force, 5 * N)[0])


def test_motion_that_stops_for_a_whole_period_has_no_correlation():
    x = helmholtz(10 * N).bridge_force * 1e4 + np.random.default_rng(0).normal(size=10 * N)
    x[7 * N - 5 : 8 * N + 30] = x[7 * N - 5]
    expected = slow(x.astype(np.float32).astype(float), 10 * N, N, range(135, 146))
    np.testing.assert_allclose(first_test(x, 10 * N)[:2], expected)


def test_a_large_mean_costs_no_accuracy():
    x = helmholtz(10 * N).bridge_force
    shifted = (x.astype(np.float32) + np.float32(2**20)).astype(float)
    assert first_test(shifted, 10 * N)[0] == pytest.approx(first_test(shifted - 2**20, 10 * N)[0], abs=1e-9)


def test_noise_lowers_the_correlation():
    rng = np.random.default_rng(3)
    x, noise = helmholtz(10 * N).bridge_force, rng.normal(size=10 * N) * HEIGHT
    found = [first_test(x + share * noise, 10 * N)[0] for share in (0.0, 0.02, 0.05, 0.1)]
    assert found == sorted(found, reverse=True)


def test_infinite_and_undefined_samples_have_no_period():
    x = helmholtz(10 * N).bridge_force
    for wrong in (np.nan, np.inf):
        x[8 * N] = wrong
        assert np.isnan(first_test(x, 10 * N)[0])


@pytest.mark.parametrize("period", [8, 139, 4096])
def test_the_lags_enclose_the_period_whatever_the_thresholds(period):
    for first, last in ((0.2001, 1.0001), (0.971, 1.043), (0.9999, 4.999)):
        geometry = Geometry(period, 1, 5 * period)
        lags = BlockClassifier(geometry, Thresholds(lag_first=first, lag_last=last), 1)._setup.lags
        assert 0 < lags.first < period < lags.last


@pytest.mark.parametrize(
    ("period", "samples", "lag_first"), [(139, 694, 0.9), (139, 0, 0.9), (2, 4, 0.9), (2, 8, 0.21)]
)
def test_a_chunk_that_is_not_whole_periods_or_too_short_for_the_lags_is_refused(period, samples, lag_first):
    with pytest.raises(ValueError, match="a chunk should be whole periods, of 2 samples at least, and 8 in all"):
        BlockClassifier(Geometry(period, 1, samples), Thresholds(lag_first=lag_first), 1)
