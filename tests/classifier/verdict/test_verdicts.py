"""The verdicts compared with known regimes: of generated records, and of cells labelled by eye."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from generator import DRAW, SAMPLES, Imperfections, mixture, render
from generator import helmholtz as helmholtz_cycles
from generator import multiple_flyback as flyback_cycles
from generator import multiple_slip as slip_cycles
from generator import subharmonic as subharmonic_cycles
from hypothesis import given, settings
from hypothesis import strategies as st
from kinematics import GEOMETRY, HEIGHT, N, Record, chunks
from reference import periodicity as slow_periodicity
from window import measure, one_slip

from bow_classifier.block_classifier import BlockClassifier, Geometry
from bow_classifier.features.long_periods import samples_before
from bow_classifier.features.slips import Intervals
from bow_classifier.verdict.regimes import REGIMES, count
from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.kernel.block import Block
from bow_sweep.plan.sweep import Sweep

LABELS = Path(__file__).resolve().parents[2] / "data" / "labels.csv"
patient = settings(deadline=None, max_examples=25)  # the first call may compile, and the machine may be busy
seeds = st.integers(0, 10_000)


def classify(records):
    """Return the classifier of a block after its last chunk, and its last verdicts."""
    classifier = BlockClassifier(GEOMETRY, Thresholds(), len(records))
    for chunk in chunks(records):
        last = classifier.classify(*chunk)
    return classifier, last


def name(record):
    return REGIMES[classify([record])[1].regime[0]]


@pytest.fixture(scope="module")
def drawn():
    records = list(mixture(450, seed=7))
    return records, classify([one.record for one in records])[1]


@pytest.mark.parametrize("regime", DRAW)
def test_a_record_drawn_as_a_regime_is_called_by_its_name(drawn, regime):
    records, last = drawn
    mine = [i for i, one in enumerate(records) if one.regime == regime]
    right = [i for i in mine if REGIMES[last.regime[i]] == regime]
    assert len(mine) == 50
    assert len(right) >= (
        33 if regime in ("raman_higher", "multiple_slip") else 42
    )  # some have too large imperfections
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


MILD = Imperfections(jitter=0.3, ripple=0.15, rounding=1.5, noise=0.004, uneven=0.005)


def cycles_of(make, wanted):
    """Return the first cycles drawn that have the wanted number."""
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
    """Except where jitter moves a slip or a corner across the border of the window: 1 of 200 Helmholtz motions."""
    records = [render(PERIODIC[regime], MILD, np.random.default_rng(phase)) for phase in range(1000)]
    names = [REGIMES[code] for code in classify(records)[1].regime]
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
    both = BlockClassifier(GEOMETRY, Thresholds(), 2, np.array([1.0, speed]))
    for chunk in chunks([one, other]):
        last = both.classify(*chunk)
    assert last.regime[0] == last.regime[1]
    assert last.confidence[0] == pytest.approx(last.confidence[1], abs=1e-3)


def test_every_verdict_is_the_cells_own_bit_for_bit():
    records = [one.record for one in mixture(36, seed=3)]
    order = np.random.default_rng(1).permutation(36)
    together, shuffled = classify(records)[1], classify([records[i] for i in order])[1]
    alone = classify([records[5]])[1]
    for field in together._fields:
        assert getattr(together, field)[order].tobytes() == getattr(shuffled, field).tobytes()
        assert getattr(together, field)[5:6].tobytes() == getattr(alone, field).tobytes()


def long_search(record, start, lags, least):
    """Return correlation and period of cells that move and have no period near the nominal one; NaN for none."""
    found = measure(
        record, start, long=lags, intervals=one_slip(len(record), range(len(record))), correlation=least, silence=0.0
    )
    return found.correlation, found.period


@patient
@given(seeds, st.sampled_from(["subharmonic", "anomalous_low_frequency"]))
def test_a_long_period_and_its_correlation_are_those_of_the_definition(seed, regime):
    x = DRAW[regime](np.random.default_rng(seed)).record.bridge_force
    lags = Thresholds().long_lags(N)
    start = samples_before(lags[1])
    correlation, place = long_search(x[None, -(start + GEOMETRY.samples) :], start, lags, 0.9)
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
        _, place = long_search(x[None], SAMPLES - 695, (146, 435), 0.95)
        assert place[0] == pytest.approx(period, abs=0.1)


def test_only_cells_that_move_and_have_no_period_near_the_nominal_one_are_searched_at_long_lags():
    noise = np.random.default_rng(1).normal(size=SAMPLES)
    record = np.array([noise, noise, noise * 1e-3, np.sin(2 * np.pi * np.arange(SAMPLES) / N)])
    found = measure(
        record, SAMPLES - 695, near=(135, 145), intervals=one_slip(4, [1, 2, 3]), correlation=0.5, silence=0.1
    )
    assert not (found.correlation[:3] > 0.5).any()
    assert found.correlation[0] == found.correlation[1]  # noise repeats nowhere: the first test's result is kept
    assert found.period[3] == pytest.approx(N, abs=0.01)
    any_lag = measure(
        record, SAMPLES - 695, near=(135, 145), intervals=one_slip(4, [1, 2, 3]), correlation=0.0, silence=0.1
    )
    unsearched = measure(record, SAMPLES - 695, near=(135, 145), correlation=0.0, silence=0.1)
    searched = any_lag.period != unsearched.period
    assert not searched[[0, 2, 3]].any()


def test_long_lags_lie_beyond_the_near_ones_and_within_the_history():
    for period in (8, 20, 139, 1000):
        for long in (1.101, 3.13, 4.99):
            thresholds = Thresholds(lag_long=long)
            block = BlockClassifier(Geometry(period, 1, 5 * period), thresholds, 1)
            lags = block._setup.lags
            assert period < lags.last < lags.shortest < lags.longest
            assert block._setup.start >= samples_before(lags.longest) > lags.longest


@pytest.mark.parametrize("delay", [5, 15, 40])
def test_the_ripples_line_is_that_of_the_spectrum(delay):
    x = np.tile(np.random.default_rng(2).normal(size=142), 10).astype(np.float32)
    power = np.abs(np.fft.rfft(x[-142:].astype(float)))
    band = [k for k in range(3, 72) if abs(k * delay / 142 - 1) <= 0.25]
    noise = np.random.default_rng(3).normal(size=x.size)
    found = measure(np.array([x, noise]), x.size - 695, near=(135, 145), delay=delay)
    assert found.period[0] == pytest.approx(142, abs=0.3)
    assert found.ripple[0] == pytest.approx(power[band].max() / power[1:3].max(), rel=1e-9)
    assert found.ripple[1] == 0  # without a period it is not computed


def test_small_slips_and_clusters_of_corners_are_counted_apart():
    cycles, corners = flyback_cycles(np.random.default_rng(4))
    cycles[0].slips = [(6.0, 60, 1.0), (90.0, 3, 0.02), (100.0, 3, 0.03)]
    found = classify([render(cycles, Imperfections(rounding=1.0), np.random.default_rng(1))])[0].features
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
        classifier = BlockClassifier(Geometry.of(sweep.parameters), Thresholds(), len(cells))
        for _ in range(sweep.chunks):
            chunk = block.advance()
            last = classifier.classify(
                chunk.bridge_force, Intervals(*(getattr(chunk, field) for field in Intervals._fields))
            )
        for row, code in zip(mine, last.regime, strict=True):
            right += REGIMES[code] == row["label"]
            helmholtz += REGIMES[code].startswith("helmholtz") == row["label"].startswith("helmholtz")
        number += len(mine)
    assert right >= 0.9 * number
    assert helmholtz >= 0.95 * number
