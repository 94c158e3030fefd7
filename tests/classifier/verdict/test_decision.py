from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from bow_classifier.verdict import regimes, thresholds
from bow_classifier.verdict.confidence import COEFFICIENTS, MARGINS, confidence_workspace
from bow_classifier.verdict.decision import Decision, Features, Limits, decide_eight, history
from bow_classifier.verdict.regimes import DEFINITIONS, REGIMES, count, is_helmholtz
from bow_classifier.verdict.thresholds import THRESHOLD_PRESETS, Thresholds
from bow_sim.physics.errors import ParameterError


def test_codes_of_regimes_are_in_bags_and_never_change():
    codes = (
        "no_oscillation", "helmholtz", "multiple_slip", "multiple_flyback", "other_periodic", "aperiodic",
        "helmholtz_extra_slips", "raman_higher", "anomalous_low_frequency", "subharmonic",
        "wolf",
    )  # fmt: skip
    assert REGIMES[: len(codes)] == codes
    for name in REGIMES:
        assert REGIMES[getattr(regimes, name.upper())] == name


def test_every_regime_is_defined_once_and_its_source_is_given():
    assert tuple(definition.name for definition in DEFINITIONS) == REGIMES
    for definition in DEFINITIONS:
        assert len(definition.means) > 40
        assert definition.source or definition.name == "other_periodic"


def test_every_regime_has_a_confidence_of_its_own():
    assert COEFFICIENTS.shape == (len(REGIMES), len(MARGINS))
    assert (COEFFICIENTS[:, 1:] >= 0).all()


def test_insignificant_extra_slips_leave_helmholtz_motion_what_it_is():
    codes = np.arange(256)
    assert [REGIMES[code] for code in codes[is_helmholtz(codes)]] == ["helmholtz", "helmholtz_extra_slips"]
    assert is_helmholtz(np.zeros((2, 3), np.uint8)).shape == (2, 3)


def test_the_preset_trial_has_the_thresholds_of_the_trial_implementation():
    trial = THRESHOLD_PRESETS["trial"]
    assert (trial.correlation, trial.slip, trial.corner) == (0.95, 0.04, 0.40)
    assert trial.lags(139) == (135, 145)
    assert trial != Thresholds() == Thresholds.from_mapping({}) == Thresholds.from_mapping({"preset": "tuned"})


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
        ({"preset": "best"}, "classifier.preset = 'best': must be one of tuned, trial"),
    ],
)
def test_wrong_thresholds_are_refused_by_name_and_value(mapping, says):
    with pytest.raises(ParameterError, match=re.escape(says)):
        Thresholds.from_mapping(mapping)


@pytest.mark.parametrize("period", [8, 20, 139, 4096])
def test_the_nominal_period_always_lies_within_the_lags(period):
    first, last = Thresholds(lag_first=0.9999, lag_last=1.0001).lags(period)
    assert first < period < last


WHAT_IS_SEEN = {
    "correlation": (0.99, np.float32),
    "period": (139.0, np.float32),
    "slips": (5, np.uint16),
    "slip_clusters": (5, np.uint16),
    "small_slips": (0, np.uint16),
    "corners": (5, np.uint16),
    "corner_clusters": (5, np.uint16),
    "loudness": (0.3, float),
    "ripple": (0.33, float),
    "sure_slips": (1.0, float),
    "sure_corners": (1.0, float),
    "beat": (np.nan, np.float32),
    "transient": (np.nan, np.float32),
    "beta": (15 / 139, float),
}


def verdict(**seen):
    assert seen.keys() <= WHAT_IS_SEEN.keys()
    seen = {"slip_clusters": seen.get("slips", 5), "corner_clusters": seen.get("corners", 5), **seen}
    fields = {name: np.array([seen.get(name, usual)], kind) for name, (usual, kind) in WHAT_IS_SEEN.items()}
    decision = Decision.empty(1)
    decide_eight(0, 1, Features(**fields), Limits.of(139, Thresholds()), decision, confidence_workspace())
    return REGIMES[decision.regime[0]], float(decision.confidence[0])


FLYBACKS = {"corners": 15, "corner_clusters": 5}


@pytest.mark.parametrize(
    ("name", "seen"),
    [
        ("helmholtz", {}),
        ("helmholtz", {"small_slips": 2}),
        ("helmholtz_extra_slips", {"small_slips": 5}),
        ("aperiodic", {"correlation": 0.94}),
        ("aperiodic", {"correlation": np.nan, "period": np.nan}),
        ("multiple_slip", {"slips": 10, "corners": 10}),
        ("multiple_slip", {"slips": 10, "corners": 5}),
        ("multiple_slip", {"slips": 15, "corners": 15}),
        ("multiple_slip", {"slips": 10, "corners": 10, "period": 147.0}),
        ("multiple_slip", {"slips": 25, "slip_clusters": 0, "corners": 25}),
        ("multiple_slip", {"slips": 50, "slip_clusters": 5, "corners": 50, "corner_clusters": 5}),
        ("multiple_flyback", FLYBACKS),
        ("multiple_flyback", {"corners": 25, "corner_clusters": 5}),
        ("multiple_flyback", {"slips": 15, "slip_clusters": 5, **FLYBACKS}),
        ("multiple_flyback", {"slips": 10, "slip_clusters": 10, **FLYBACKS}),
        ("multiple_flyback", {"slips": 4, "corners": 14, "corner_clusters": 5, "period": 144.0}),
        ("multiple_flyback", {"slips": 5, "slip_clusters": 0, "corners": 35, "corner_clusters": 5}),
        ("raman_higher", {"ripple": 0.9, **FLYBACKS}),
        ("raman_higher", {"corners": 15}),
        ("raman_higher", {"corners": 10, "corner_clusters": 5}),
        ("raman_higher", {"slips": 10, "slip_clusters": 5, "corners": 10, "corner_clusters": 5}),
        ("raman_higher", {"corners": 6, "ripple": 0.7}),
        ("other_periodic", {"corners": 7}),
        ("other_periodic", {"slips": 4, "corners": 4, "period": 144.0}),
        ("other_periodic", {"corners": 6}),
        ("other_periodic", {"corners": 0}),
        ("other_periodic", {"period": 150.0}),
        ("anomalous_low_frequency", {"period": 263.0, "slips": 3, "corners": 3}),
        ("anomalous_low_frequency", {"period": 387.0, "slips": 2, "corners": 6}),
        ("anomalous_low_frequency", {"period": 263.0, "slips": 6, "slip_clusters": 3, "corners": 3}),
        ("other_periodic", {"period": 220.0, "slips": 3, "corners": 3}),
        ("subharmonic", {"period": 278.0}),
        ("subharmonic", {"period": 427.0, "corners": 9}),
        ("no_oscillation", {"loudness": 0.001, "slips": 0, "corners": 0}),
        ("no_oscillation", {"loudness": 0.3, "slips": 0, "corners": 0}),
        ("no_oscillation", {"loudness": 0.3, "slips": 0, "correlation": 0.1}),
        ("no_oscillation", {"loudness": 0.0, "correlation": np.nan, "slips": 0, "corners": 0}),
        ("aperiodic", {"loudness": np.nan, "correlation": np.nan}),
    ],
)
def test_what_the_tests_together_are_called(name, seen):
    assert verdict(**seen)[0] == name


def test_a_verdict_at_the_threshold_does_not_pass():
    at = np.float32(0.95)
    assert verdict(correlation=at)[0] == ("helmholtz" if float(at) > 0.95 else "aperiodic")
    assert verdict(correlation=np.nextafter(at, np.float32(0)))[0] == "aperiodic"


def test_confidence_never_falls_with_the_distance_from_a_threshold():
    rising = [verdict(correlation=c)[1] for c in (0.951, 0.96, 0.98, 0.999, 1.0)]
    falling = [verdict(correlation=c)[1] for c in (0.949, 0.94, 0.92, 0.9, 0.5, np.nan)]
    slips = [verdict(sure_slips=s)[1] for s in (0.0, 0.25, 0.5, 1.0)]
    corners = [verdict(sure_corners=s)[1] for s in (0.0, 0.25, 0.5, 1.0)]
    between = [verdict(slips=n, corners=10)[1] for n in (8, 9, 10)]
    silent = [verdict(loudness=x, corners=0)[1] for x in (0.0199, 0.01, 0.001, 0.0)]
    for values in (rising, falling, slips, corners, between, silent):
        assert values == sorted(values)
        assert 0 <= values[0] <= values[-1] <= 1
    assert rising[0] < rising[-1]
    assert verdict(loudness=np.nan)[1] == 0


def test_the_number_that_belongs_to_a_name_follows_from_what_is_published():
    cases = [
        ("no_oscillation", 0, 139.0, 0, 0),
        ("helmholtz", 1, 139.0, 5, 5),
        ("helmholtz_extra_slips", 1, 139.0, 5, 5),
        ("multiple_slip", 3, 139.0, 15, 10),
        ("multiple_slip", 2, 147.0, 9, 9),
        ("multiple_flyback", 5, 139.0, 5, 25),
        ("raman_higher", 2, 139.0, 5, 10),
        ("subharmonic", 2, 281.0, 5, 5),
        ("subharmonic", 3, 427.0, 5, 9),
        ("anomalous_low_frequency", 1, 268.0, 3, 3),
        ("anomalous_low_frequency", 2, 390.0, 2, 2),
        ("aperiodic", 0, np.nan, 7, 3),
        ("other_periodic", 0, 220.0, 5, 5),
    ]
    names, wanted, period, slips, corners = zip(*cases, strict=True)
    codes = np.array([REGIMES.index(name) for name in names], np.uint8)
    numbers = count(codes, period, slips, corners, 139, 15 / 139)
    assert numbers.tolist() == list(wanted)
    assert numbers.dtype == np.uint8
    assert count(np.full((2, 3), 255), np.full((2, 3), np.nan), 0, 0, 139, 0.1).tolist() == [[0] * 3] * 2


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
