"""The verdicts against truth that nobody asked the classifier for: generated records, and cells labelled by eye."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from generator import DRAW, SAMPLES, Wear, mixture, render
from generator import helmholtz as helmholtz_cycles
from generator import multiple_flyback as flyback_cycles
from generator import multiple_slip as slip_cycles
from generator import subharmonic as subharmonic_cycles
from hypothesis import given, settings
from hypothesis import strategies as st
from kinematics import GEOMETRY, HEIGHT, N, Record, chunks
from reference import periodicity as slow_periodicity

from bow_classifier.block_classifier import BlockJudge, Geometry
from bow_classifier.features.long_periods import long_periods, reach
from bow_classifier.features.ripples import ripple
from bow_classifier.features.slips import Intervals
from bow_classifier.verdict.regimes import REGIMES, count
from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.kernel.block import Block
from bow_sweep.plan.sweep import Sweep

LABELS = Path(__file__).resolve().parents[2] / "data" / "labels.csv"
patient = settings(deadline=None, max_examples=25)  # the first call may compile, and the machine may be busy
seeds = st.integers(0, 10_000)


def judge(records):
    """Return the judge of a block after its last chunk, and the last judgement."""
    judge = BlockJudge(GEOMETRY, Thresholds(), len(records))
    for chunk in chunks(records):
        last = judge.judge(*chunk)
    return judge, last


def name(record):
    return REGIMES[judge([record])[1].regime[0]]


@pytest.fixture(scope="module")
def drawn():
    records = list(mixture(450, seed=7))
    return records, judge([one.record for one in records])[1]


@pytest.mark.parametrize("regime", DRAW)
def test_a_record_drawn_as_a_regime_is_called_by_its_name(drawn, regime):
    records, last = drawn
    mine = [i for i, one in enumerate(records) if one.regime == regime]
    right = [i for i in mine if REGIMES[last.regime[i]] == regime]
    assert len(mine) == 50
    assert len(right) >= (
        33 if regime in ("raman_higher", "multiple_slip") else 42
    )  # some are drawn beyond recognition
    found = count(last.regime, last.period, last.slips, last.corners, N, GEOMETRY.bow_bridge / N)
    asked = [i for i in right if records[i].count]
    assert sum(found[i] == records[i].count for i in asked) >= 0.9 * len(asked)


def test_confidence_tells_which_names_to_trust(drawn):
    records, last = drawn
    right = np.array([one.regime for one in records]) == np.array([REGIMES[code] for code in last.regime])
    sure = last.confidence > 0.9
    assert sure.mean() > 0.6
    assert right[sure].mean() > 0.95
    assert right[~sure].mean() < 0.85
    assert abs(last.confidence.mean() - right.mean()) < 0.04


MILD = Wear(jitter=0.3, ripple=0.15, rounding=1.5, noise=0.004, uneven=0.005)


def cycles_of(make, wanted):
    """The first cycles drawn whose number is the wanted one."""
    drawn = (make(np.random.default_rng(seed)) for seed in range(100))
    return next(cycles for cycles, number in drawn if number == wanted)


PERIODIC = {
    "helmholtz": cycles_of(helmholtz_cycles, 1),
    "multiple_slip": cycles_of(slip_cycles, 2),
    "multiple_flyback": cycles_of(flyback_cycles, 3),
    "subharmonic": cycles_of(subharmonic_cycles, 2),
}


@pytest.mark.parametrize("regime", PERIODIC)
def test_where_the_window_begins_changes_no_name(regime):
    """But where jitter moves a slip, or a corner lies, across the window's edge: 1 of 200 Helmholtz motions."""
    records = [render(PERIODIC[regime], MILD, np.random.default_rng(phase)) for phase in range(1000)]
    names = [REGIMES[code] for code in judge(records)[1].regime]
    assert names.count(regime) >= 990
    assert set(names) <= {regime, "other_periodic"}


@pytest.mark.parametrize("regime", ["multiple_slip", "multiple_flyback", "subharmonic"])
@patient
@given(st.floats(-0.02, 0.03))
def test_a_longer_or_shorter_period_changes_no_name(regime, flattening):
    rng = np.random.default_rng(4)
    assert name(render(PERIODIC[regime], replace(MILD, jitter=0.0, flattening=flattening), rng)) == regime


@pytest.mark.parametrize("regime", PERIODIC)
@patient
@given(seeds, st.floats(0, 0.015))
def test_added_noise_changes_no_name(regime, seed, share):
    rng = np.random.default_rng(4)
    record = render(PERIODIC[regime], MILD, rng)
    noise = np.random.default_rng(seed).normal(size=SAMPLES) * share * HEIGHT
    assert name(Record(record.bridge_force + noise, record.slips)) == name(record) == regime


@patient
@given(seeds, st.floats(0.02, 50))
def test_the_force_has_no_unit_but_the_bow_speeds(seed, speed):
    one = DRAW[list(DRAW)[seed % len(DRAW)]](np.random.default_rng(seed)).record
    other = Record(one.bridge_force * speed, [(onset, long, slip * speed) for onset, long, slip in one.slips])
    both = BlockJudge(GEOMETRY, Thresholds(), 2, np.array([1.0, speed]))
    for chunk in chunks([one, other]):
        last = both.judge(*chunk)
    assert last.regime[0] == last.regime[1]
    assert last.confidence[0] == pytest.approx(last.confidence[1], abs=1e-3)


def test_every_verdict_is_the_cells_own_bit_for_bit():
    records = [one.record for one in mixture(36, seed=3)]
    order = np.random.default_rng(1).permutation(36)
    together, shuffled = judge(records)[1], judge([records[i] for i in order])[1]
    alone = judge([records[5]])[1]
    for field in together._fields:
        assert getattr(together, field)[order].tobytes() == getattr(shuffled, field).tobytes()
        assert getattr(together, field)[5:6].tobytes() == getattr(alone, field).tobytes()


@patient
@given(seeds, st.sampled_from(["subharmonic", "anomalous_low_frequency"]))
def test_a_long_period_and_its_correlation_are_those_of_the_definition(seed, regime):
    x = DRAW[regime](np.random.default_rng(seed)).record.bridge_force
    lags = Thresholds().long_lags(N)
    start = reach(lags[1])
    record = x[None, -(start + GEOMETRY.samples) :].astype(np.float32)
    correlation, place = np.full(1, np.nan, np.float32), np.full(1, np.nan, np.float32)
    long_periods(record, start, N, lags, 0.9, np.ones(1, bool), correlation, place)
    best, _ = slow_periodicity(x, SAMPLES, N, range(*lags))
    if np.isnan(place[0]):
        assert not best > 0.97  # averages of eight samples may miss what barely repeats
    else:
        near = round(float(place[0]))
        height, at = slow_periodicity(x, SAMPLES, N, range(near - 8, near + 9))
        assert correlation[0] == pytest.approx(height, abs=1e-5)
        assert place[0] == pytest.approx(at, abs=1e-2)
        assert correlation[0] > best - 0.02 - 1e-6


def test_the_shortest_of_equal_lags_counts():
    t = np.arange(SAMPLES)
    for period in (163, 217):
        x = np.floor(t / period) - t / period
        record = x[None].astype(np.float32)
        correlation, place = np.full(1, np.nan, np.float32), np.full(1, np.nan, np.float32)
        long_periods(record, SAMPLES - 695, N, (146, 435), 0.95, np.ones(1, bool), correlation, place)
        assert place[0] == pytest.approx(period, abs=0.1)


def test_cells_that_are_not_asked_about_stay_as_they_were():
    record = np.random.default_rng(1).normal(size=(2, SAMPLES)).astype(np.float32)
    correlation, place = np.full(2, 0.3, np.float32), np.full(2, 140, np.float32)
    long_periods(record, SAMPLES - 695, N, (146, 435), -1.0, np.array([False, True]), correlation, place)
    assert (correlation[0], place[0]) == (np.float32(0.3), 140)
    assert place[1] >= 146


@pytest.mark.parametrize(("start", "lags"), [(100, (146, 435)), (600, (139, 435)), (600, (300, 200))])
def test_long_lags_beyond_the_record_or_within_the_period_are_refused(start, lags):
    with pytest.raises(ValueError, match="should lie beyond the period"):
        long_periods(np.zeros((0, start + 695), np.float32), start, N, lags, 0.9, *np.zeros((3, 0)))


@pytest.mark.parametrize("delay", [5, 15, 40])
def test_the_ripples_line_is_that_of_the_spectrum(delay):
    rng = np.random.default_rng(2)
    x = np.tile(rng.normal(size=142), 5).astype(np.float32)
    power = np.abs(np.fft.rfft(x[-142:].astype(float)))
    band = [k for k in range(3, 72) if abs(k * delay / 142 - 1) <= 0.25]
    share = ripple(np.array([x, x]), np.array([142, 142.3], np.float32), np.full(2, delay), np.array([True, True]))
    np.testing.assert_allclose(share, power[band].max() / power[1:3].max(), rtol=1e-9)
    assert ripple(x[None], np.array([np.nan], np.float32), np.array([delay]), np.array([False]))[0] == 0


def test_small_slips_and_clusters_of_corners_are_counted_apart():
    cycles, corners = flyback_cycles(np.random.default_rng(4))
    cycles[0].slips = [(6.0, 60, 1.0), (90.0, 3, 0.02), (100.0, 3, 0.03)]
    found = judge([render(cycles, Wear(rounding=1.0), np.random.default_rng(1))])[0].evidence
    assert (found.slips[0], found.small_slips[0]) == (5, 10)
    assert found.corners[0] == 5 * corners
    assert abs(int(found.corner_clusters[0]) - 5) <= 1  # one may lie across the border


def rows(half):
    with open(LABELS, newline="") as file:
        every = list(csv.DictReader(line for line in file if line[0] != "#"))
    return [row for row in every if row["half"] == half] if half else every


def test_labels_are_of_all_maps_and_halved():
    every = rows("")
    assert len(every) >= 150
    assert {row["map"] for row in every} == {f"fig11{letter}" for letter in "abcdef"}
    assert {row["label"] for row in every} <= set(REGIMES)
    assert abs(len(rows("tune")) - len(rows("held_out"))) < 0.15 * len(every)


def test_cells_of_the_tuning_half_are_called_what_the_eye_calls_them():
    right, helmholtz, number = 0, 0, 0
    for preset in sorted({row["map"] for row in rows("tune")}):
        mine = [row for row in rows("tune") if row["map"] == preset]
        sweep = Sweep.from_spec(preset)
        cells = np.array([int(row["cell"]) for row in mine], np.uint32)
        block = Block(sweep.parameters, sweep.lanes(cells))
        judge = BlockJudge(Geometry.of(sweep.parameters), Thresholds(), len(cells))
        for _ in range(sweep.chunks):
            chunk = block.advance()
            last = judge.judge(chunk.bridge_force, Intervals(*(getattr(chunk, field) for field in Intervals._fields)))
        for row, code in zip(mine, last.regime, strict=True):
            right += REGIMES[code] == row["label"]
            helmholtz += REGIMES[code].startswith("helmholtz") == row["label"].startswith("helmholtz")
        number += len(mine)
    assert right >= 0.9 * number
    assert helmholtz >= 0.95 * number
