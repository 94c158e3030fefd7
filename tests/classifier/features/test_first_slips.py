"""Guettler's transient: from the first significant slip to the last row of regular ones."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kinematics import GEOMETRY, N, Record, chunks

from bow_classifier.block_classifier import BlockClassifier, Geometry
from bow_classifier.verdict.thresholds import Thresholds

PERIODS = 40
RISE = 0.2 / N
"""Bow speed a sample: 0.2 a period."""


def slips_at(onsets, sizes=None, duration=8):
    """Return a record with slips at some samples; their sums are as the bow's speed then asks for, times `sizes`."""
    sizes = [1.0] * len(onsets) if sizes is None else sizes
    slips = [(onset, duration, size * N * RISE * (onset + duration)) for onset, size in zip(onsets, sizes, strict=True)]
    return Record(np.random.default_rng(2).normal(size=PERIODS * N), slips)


def transients(records, rise=RISE, geometry=GEOMETRY):
    """Return the transient of each cell at each test, (tests, cells) periods."""
    classifier = BlockClassifier(geometry, Thresholds(), len(records), rise=rise)
    return np.array([classifier.classify(*chunk).transient for chunk in chunks(records)])


def test_it_is_the_time_from_the_first_slip_to_the_first_of_the_regular_row():
    irregular = [100, 150, 300, 500]
    regular = [600 + N * i for i in range(20)]
    found = transients([slips_at(irregular + regular)])[:, 0]
    assert found[-1] == pytest.approx(500 / N)
    assert found[0] == 0
    assert found[(600 + 5 * N) // (5 * N) - 1] == 0, "five intervals are not yet complete"


def test_a_row_that_begins_with_the_first_slip_is_a_transient_of_one_sample_as_0_is_never():
    never, at_once = slips_at([50, 400, 500]), slips_at([50 + N * i for i in range(10)])
    assert transients([never, at_once])[-1] == pytest.approx([0, 1 / N])


def test_the_last_row_counts_and_a_short_one_does_not():
    first = [60 + N * i for i in range(8)]
    second = [first[-1] + 2 * N + N * i for i in range(7)]
    short = [second[-1] + 2 * N + N * i for i in range(5)]
    found = transients([slips_at(first + second + short)])[:, 0]
    assert found[-1] == pytest.approx((second[0] - 60) / N)
    assert found[(first[-1] + 8) // (5 * N)] == pytest.approx(1 / N)


@pytest.mark.parametrize(("away", "regular"), [(6, True), (-6, True), (7, False), (-7, False)])
def test_intervals_may_differ_by_five_percent_of_the_nominal_period(away, regular):
    found = transients([slips_at([80 + (N + away) * i for i in range(12)])])[-1, 0]
    assert (found > 0) == regular


def test_a_slip_is_held_against_the_bow_speed_at_its_end():
    regular = [200 + N * i for i in range(30)]
    between = [onset + 60 for onset in regular]
    onsets = sorted(regular + between)
    sizes = [1.0 if onset in regular else 0.09 for onset in onsets]
    assert transients([slips_at(onsets, sizes)])[-1, 0] == pytest.approx(1 / N)
    sizes = [1.0 if onset in regular else 0.11 for onset in onsets]
    assert transients([slips_at(onsets, sizes)])[-1, 0] == 0


def test_each_cell_has_its_own_acceleration():
    record = slips_at([200 + N * i for i in range(30)], [0.2] * 30)
    found = transients([record, record], rise=[RISE, 3 * RISE])[-1]
    assert found == pytest.approx([1 / N, 0])


def test_a_regular_motion_that_grows_with_the_bow_keeps_its_counts():
    """Corners and loudness are held against the bow's mean speed in the window."""
    t = np.arange(PERIODS * N)
    saw = (0.5 - (t / N) % 1.0) * N / GEOMETRY.bow_bridge * RISE * t
    classifier = BlockClassifier(GEOMETRY, Thresholds(), 1, rise=RISE)
    for number, chunk in enumerate(chunks([Record(saw, slips_at([20 + N * i for i in range(PERIODS)]).slips)])):
        found = classifier.classify(*chunk)
        if number >= 2:
            assert (found.slips[0], found.corners[0]) == (5, 5)
            assert found.passed[0]


def test_other_gestures_have_none():
    classifier = BlockClassifier(GEOMETRY, Thresholds(), 1)
    for chunk in chunks([slips_at([50 + N * i for i in range(10)])]):
        assert np.isnan(classifier.classify(*chunk).transient).all()


def slow(onsets, period):
    """Return the transient in periods, by the definition."""
    begins = []
    row = [onsets[0]] if onsets else []
    for before, onset in itertools.pairwise(onsets):
        row = [*row, onset] if abs(onset - before - period) <= 0.05 * period else [onset]
        if len(row) == 6:
            begins.append(row[0])
    return max(begins[-1] - onsets[0], 1) / period if begins else 0.0


@settings(deadline=None, max_examples=40)
@given(st.lists(st.sampled_from([20, 21, 20, 19, 20, 35]), min_size=1, max_size=40), st.sampled_from([1, 3]))
def test_it_is_that_of_the_definition_however_the_record_is_cut(intervals, periods):
    period = 20
    onsets = (5 + np.cumsum(intervals)).tolist()
    length = -(-(onsets[-1] + 30) // (15 * period)) * 15 * period
    record = Record(np.random.default_rng(1).normal(size=length), [(onset, 4, 1e6) for onset in onsets])
    geometry = Geometry(period, 3, periods * period)
    classifier = BlockClassifier(geometry, Thresholds(), 1, rise=1e-3)
    for chunk in chunks([record], geometry.samples):
        found = classifier.classify(*chunk).transient[0]
    assert found == pytest.approx(slow(onsets, period))
