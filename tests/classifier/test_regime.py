from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from bow_classifier import thresholds
from bow_classifier.regime import decide, history
from bow_classifier.thresholds import REGIMES, THRESHOLD_PRESETS, Thresholds
from bow_sim.model import ParameterError


def test_codes_of_regimes_are_in_bags_and_never_change():
    codes = ("no_oscillation", "helmholtz", "multiple_slip", "multiple_flyback", "other_periodic", "aperiodic")
    assert REGIMES[: len(codes)] == codes
    for name in REGIMES:
        assert REGIMES[getattr(thresholds, name.upper())] == name


def test_the_preset_trial_has_the_thresholds_of_the_trial_implementation():
    trial = THRESHOLD_PRESETS["trial"]
    assert (trial.correlation, trial.slip, trial.corner) == (0.95, 0.04, 0.40)
    assert trial.lags(139) == (135, 145)
    assert Thresholds.from_mapping({}) == Thresholds.from_mapping({"preset": "trial"}) == trial


def test_every_threshold_has_a_unit_a_range_and_a_reason():
    for field in dataclasses.fields(Thresholds):
        assert field.metadata["range"].holds(field.default)
        assert len(field.metadata["doc"]) > 20
        assert "unit" in field.metadata


def test_settings_read_back_bit_for_bit():
    thresholds = Thresholds(correlation=0.1 + 0.2, slip=1 / 3, corner=0.7 / 3)
    settings = thresholds.settings()
    assert list(settings) == sorted(settings)
    assert Thresholds.from_mapping(dict(line.split("=") for line in settings)) == thresholds


def test_the_hash_follows_thresholds_and_sources(monkeypatch):
    assert re.fullmatch("[0-9a-f]{16}", Thresholds().hash)
    assert Thresholds().hash == Thresholds(correlation=0.95).hash != Thresholds(correlation=0.94).hash
    before = Thresholds().hash
    monkeypatch.setattr(thresholds, "source_hash", lambda: "another source")
    assert Thresholds().hash != before


@pytest.mark.parametrize(
    ("mapping", "says"),
    [
        ({"corelation": "0.9"}, "classifier.corelation = '0.9': unknown threshold; there is correlation"),
        ({"zzz": 1}, "classifier.zzz"),
        ({"correlation": "1.5"}, "classifier.correlation = '1.5': must be a number > -1 and < 1"),
        ({"correlation": "high"}, "classifier.correlation = 'high'"),
        ({"slip": "nan"}, "classifier.slip = 'nan'"),
        ({"corner": True}, "classifier.corner = True"),
        ({"corner": None}, "classifier.corner = None"),
        ({"silence": -0.1}, "classifier.silence = -0.1"),
        ({"lag_first": 1.2}, "classifier.lag_first = 1.2"),
        ({"preset": "best"}, "classifier.preset = 'best': must be one of trial"),
    ],
)
def test_wrong_thresholds_are_refused_by_name_and_value(mapping, says):
    with pytest.raises(ParameterError, match=re.escape(says)):
        Thresholds.from_mapping(mapping)


@pytest.mark.parametrize("period", [8, 20, 139, 4096])
def test_the_nominal_period_always_lies_within_the_lags(period):
    first, last = Thresholds(lag_first=0.9999, lag_last=1.0001).lags(period)
    assert first < period < last


def verdict(correlation=0.99, slips=5, clusters=None, corners=5, loudness=0.3, period=139.0, sure=1.0):
    one = decide(
        np.array([correlation], np.float32),
        np.array([period], np.float32),
        np.array([slips], np.uint16),
        np.array([slips if clusters is None else clusters], np.uint16),
        np.array([corners], np.uint16),
        np.array([loudness]),
        np.array([sure]),
        695,
        Thresholds(),
    )
    return REGIMES[one.regime[0]], float(one.confidence[0])


@pytest.mark.parametrize(
    ("name", "seen"),
    [
        ("helmholtz", {}),
        ("aperiodic", {"correlation": 0.94}),
        ("aperiodic", {"correlation": np.nan, "period": np.nan}),
        ("multiple_slip", {"slips": 10, "corners": 10}),
        ("multiple_slip", {"slips": 10, "corners": 5}),
        ("multiple_flyback", {"corners": 15}),
        ("multiple_flyback", {"corners": 25}),
        ("multiple_flyback", {"slips": 15, "clusters": 5, "corners": 15}),
        ("multiple_slip", {"slips": 15, "clusters": 15, "corners": 15}),
        ("multiple_slip", {"slips": 10, "clusters": 5, "corners": 10}),
        ("multiple_flyback", {"slips": 4, "corners": 14, "period": 144.0}),
        ("multiple_flyback", {"slips": 5, "clusters": 0, "corners": 35}),
        ("multiple_slip", {"slips": 25, "clusters": 0, "corners": 25}),
        ("other_periodic", {"corners": 7}),
        ("other_periodic", {"corners": 10}),
        ("other_periodic", {"slips": 4, "corners": 4, "period": 144.0}),
        ("other_periodic", {"slips": 0, "corners": 0}),
        ("other_periodic", {"corners": 6}),
        ("no_oscillation", {"loudness": 0.001, "slips": 0, "corners": 0}),
        ("no_oscillation", {"loudness": 0.0, "correlation": np.nan, "slips": 0, "corners": 0}),
        ("aperiodic", {"loudness": np.nan, "correlation": np.nan}),
    ],
)
def test_what_the_three_tests_together_are_called(name, seen):
    assert verdict(**seen)[0] == name


def test_a_verdict_at_the_threshold_does_not_pass():
    at = np.float32(0.95)
    assert verdict(correlation=at)[0] == ("helmholtz" if float(at) > 0.95 else "aperiodic")
    assert verdict(correlation=np.nextafter(at, np.float32(0)))[0] == "aperiodic"


def test_confidence_grows_with_the_distance_from_every_threshold():
    for above in (verdict(correlation=c)[1] for c in (0.95, 0.8, 0.0, np.nan)):
        assert 0 <= above <= 1
    rising = [verdict(correlation=c)[1] for c in (0.951, 0.96, 0.98, 0.999, 1.0)]
    falling = [verdict(correlation=c)[1] for c in (0.949, 0.94, 0.92, 0.9)]
    unsure = [verdict(sure=s)[1] for s in (0.0, 0.25, 0.5, 1.0)]
    silent = [verdict(loudness=x, corners=0)[1] for x in (0.0199, 0.01, 0.001, 0.0)]
    for values in (rising, falling, unsure, silent):
        assert values == sorted(values)
        assert values[0] < values[-1] <= 1
    assert verdict(correlation=np.nan)[1] <= 0.5
    assert verdict(loudness=np.nan)[1] == 0


def test_history_gives_the_first_pass_and_counts_later_failures():
    passed = np.array([[0, 0, 0, 0, 0], [0, 0, 1, 1, 1], [0, 1, 0, 1, 1], [0, 1, 1, 1, 0], [0, 1, 0, 1, 0]], bool)
    transient, regressions = history(passed)
    assert transient.tolist() == [0, 15, 10, 10, 10]
    assert regressions.tolist() == [0, 0, 2, 0, 1]


def test_history_keeps_the_shape_of_the_map_and_knows_no_test_at_all():
    transient, regressions = history(np.zeros((3, 4, 6), bool))
    assert transient.shape == regressions.shape == (4, 6)
    transient, regressions = history(np.zeros((0, 7), bool))
    assert transient.tolist() == regressions.tolist() == [0] * 7
