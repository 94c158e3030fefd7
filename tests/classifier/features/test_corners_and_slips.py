from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kinematics import HEIGHT
from reference import corners as slow_corners
from reference import slips as slow_slips
from window import measure

from bow_classifier.block_classifier import BlockClassifier, Geometry
from bow_classifier.features.slips import Intervals, SlipState, discontinuity, first_discontinuity
from bow_classifier.verdict.thresholds import Thresholds

DELAY, START, GAP = 15, 41, 20.0
SHORT = {"period": 8, "near": (8, 9)}
"""Windows here may be shorter than a period of the string; the first test plays no part."""
patient = settings(deadline=None)  # the first call may compile, and the machine may be busy


def count(x, begin, end, level, delay=DELAY):
    past = np.concatenate([np.zeros(START), x])
    return int(measure(past[None, begin : end + START], START, delay=delay, corner=level, **SHORT).corners[0])


@pytest.mark.parametrize("border", [0, 30, 100, 101, 107, 115, 116, 130])
def test_a_corner_is_counted_once_wherever_the_border_falls(border):
    x = np.zeros(200)
    x[100:] = -1.0
    first, second = count(x, 0, border, 0.4) if border else 0, count(x, border, 200, 0.4)
    assert (first, second) == ((0, 1) if border <= 100 else (1, 0))


def test_a_corner_of_either_sign_counts_and_one_below_the_threshold_does_not():
    x = np.zeros(400)
    x[50:] += 1.0
    x[150:] -= 1.0
    x[250:] += 0.39
    assert count(x, 0, 400, 0.4) == 2


def test_a_change_of_sign_is_a_new_corner_and_a_plateau_is_not():
    x = np.zeros(300)
    x[100:108] += 1.0  # up for 8 samples, back, seen again 15 samples later with the other sign
    y = np.diff(np.sign(x - np.concatenate([np.zeros(15), x[:-15]])))
    assert np.count_nonzero(y) == 4
    assert count(x, 0, 300, 0.4) == 2
    x[108:115] = -1.0
    assert count(x, 0, 300, 0.4) == slow_corners(x, 0, 300, DELAY, 0.4) == 3  # up, down twice as long, up


def test_what_is_above_threshold_at_the_border_is_no_new_corner_before_it_has_fallen():
    x = np.zeros(300)
    x[95:] = 1.0
    assert count(x, 100, 300, 0.4) == 0
    x[102] = 0.0  # y falls here and rises; 15 samples later it shows again
    assert count(x, 100, 300, 0.4) == slow_corners(x, 100, 300, DELAY, 0.4) == 2


@patient
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 3), st.integers(8, 292), st.integers(1, START - 1))
def test_corners_agree_with_a_walk_from_the_start(seed, level, border, delay):
    x = np.random.default_rng(seed).normal(size=300).cumsum().astype(np.float32).astype(float)
    assert count(x, 0, border, level, delay) == slow_corners(x, 0, border, delay, level)
    assert count(x, border, 300, level, delay) == slow_corners(x, border, 300, delay, level)


def test_a_count_is_sure_if_the_neighbouring_thresholds_give_the_same():
    x = np.zeros((3, START + 200), np.float32)
    x[0, 116:] = 1.0
    x[1, 116:] = 0.42  # passes at 0.8, 0.9 and 1 times the threshold of 0.4
    x[2, 116:] = 0.39
    found = measure(x, START, delay=DELAY, corner=0.4, **SHORT)
    assert found.corners.tolist() == [1, 1, 0]
    assert found.sure_corners.tolist() == [1.0, 0.5, 0.5]


@pytest.mark.parametrize("delay", [0, -1, 139])
def test_a_ripple_period_that_is_none_is_refused(delay):
    with pytest.raises(ValueError, match=f"bow_bridge {delay}.0: should be a whole number of samples above 0"):
        BlockClassifier(Geometry(139, 15, 695), Thresholds(), 2, bow_bridge=[3, delay])


@pytest.mark.parametrize("period", [8, 139, 1000])
@pytest.mark.parametrize("lag_long", [1.2, 3.13, 4.9])
def test_what_precedes_a_window_reaches_farther_back_than_any_ripple_period_and_any_lag(period, lag_long):
    block = BlockClassifier(Geometry(period, 1, 5 * period), Thresholds(lag_long=lag_long), 1, bow_bridge=period - 1)
    lags = block._setup.lags
    assert 0 < lags.first < period < lags.last < lags.shortest < lags.longest
    assert block._setup.start > max(lags.longest + 1, period - 1)


def cut(slipping, speed, borders):
    """Return the chunks of one cell's stick/slip record between successive borders."""
    result = []
    for begin, end in itertools.pairwise(borders):
        part = np.concatenate([[False], slipping[begin:end], [False]])
        edges = np.flatnonzero(np.diff(part))
        onset, stop = edges[::2], edges[1::2]
        result.append(
            Intervals(
                np.array([begin > 0 and slipping[begin - 1]], np.uint8),
                np.array([0, len(onset)], np.uint32),
                onset.astype(np.uint32),
                (stop - onset).astype(np.uint32),
                np.array([speed[begin + a : begin + b].sum() for a, b in zip(onset, stop, strict=True)], float),
            )
        )
    return result


def second_test(chunk, samples, level, state, gap=GAP):
    """Return the features of cells whose bridge force does not move; `state` becomes that at the end of the chunk."""
    still = np.zeros((len(chunk.slipping), START + samples), np.float32)
    return measure(still, START, slip=level, gap=gap, intervals=chunk, state=state, **SHORT)


@patient
@given(
    st.lists(st.tuples(st.integers(1, 30), st.integers(1, 30)), min_size=1, max_size=20),
    st.lists(st.integers(1, 599), max_size=12, unique=True),
    st.integers(0, 2**32 - 1),
)
def test_slips_count_where_they_end_however_the_record_is_cut(runs, inner, seed):
    slipping = np.concatenate([np.repeat([False, True], run) for run in runs] + [np.zeros(600, bool)])[:600]
    speed = np.random.default_rng(seed).integers(0, 4, 600).astype(float)  # whole numbers: sums are exact
    borders = [0, *sorted(inner), 600]
    state, found = SlipState.at_rest(1), []
    for chunk, (begin, end) in zip(cut(slipping, speed, borders), itertools.pairwise(borders), strict=True):
        found.append(int(second_test(chunk, end - begin, 17.5, state).slips[0]))
    pairs = itertools.pairwise(borders)
    assert found == [slow_slips(slipping, speed, begin, end, 17.5) for begin, end in pairs]


def test_a_slip_that_reaches_the_border_counts_in_the_chunk_after_it():
    speed, slipping = np.ones(200), np.zeros(200, bool)
    slipping[90:100] = True
    first, second = cut(slipping, speed, [0, 100, 200])
    state = SlipState.at_rest(1)
    one = second_test(first, 100, 5.0, state)
    assert state.slipping[0]
    two = second_test(second, 100, 5.0, state)
    assert (one.slips[0], two.slips[0]) == (0, 1)
    assert not state.slipping[0]


def test_a_slip_at_the_threshold_does_not_count_and_its_neighbourhood_makes_it_unsure():
    speed, slipping = np.ones(100), np.zeros(100, bool)
    slipping[10:20] = True
    (chunk,) = cut(slipping, speed, [0, 100])
    found = [second_test(chunk, 100, level, SlipState.at_rest(1)) for level in (10.0, 9.999, 5.0)]
    assert [int(result.slips[0]) for result in found] == [0, 1, 1]
    assert [float(result.sure_slips[0]) for result in found] == [0.5, 0.5, 1.0]


def test_a_chunk_that_does_not_continue_the_one_before_is_refused():
    speed, slipping = np.ones(200), np.zeros(200, bool)
    slipping[90:110] = True
    _, second = cut(slipping, speed, [0, 100, 200])
    assert first_discontinuity(second.slipping, SlipState.at_rest(1)) == 0
    assert str(discontinuity(0, False)).startswith("row 0: the string sticks at the end of the chunk before")
    with pytest.raises(AssertionError, match="the slips of cell 0 do not continue"):
        second_test(second, 100, 5.0, SlipState.at_rest(1))


def test_the_thresholds_are_each_cells_own():
    x = np.zeros((2, 216), np.float32)
    x[:, 116:] = HEIGHT
    assert measure(x, START, delay=DELAY, corner=np.array([0.5, 2.0]) * HEIGHT, **SHORT).corners.tolist() == [1, 0]


def test_the_ripple_period_is_each_cells_own():
    x = np.random.default_rng(3).normal(size=300).cumsum().astype(np.float32)
    record = np.tile(np.concatenate([np.zeros(START, np.float32), x]), (3, 1))
    found = measure(record, START, delay=[2, 12, 40], corner=2.0, **SHORT).corners.tolist()
    assert found == [slow_corners(x, 0, 300, delay, 2.0) for delay in (2, 12, 40)]
    assert len(set(found)) == 3


def test_the_stick_within_a_cluster_is_each_cells_own():
    speed, slipping = np.ones(100), np.zeros(100, bool)
    slipping[20:30] = slipping[40:50] = True
    (chunk,) = cut(slipping, speed, [0, 100])
    twice = Intervals(
        np.zeros(2, np.uint8), np.array([0, 2, 4], np.uint32), *(np.tile(column, 2) for column in chunk[2:])
    )
    found = second_test(twice, 100, 4.0, SlipState.at_rest(2), gap=[10.0, 9.0])
    assert found.slip_clusters.tolist() == [1, 2]


def test_slips_with_a_short_stick_between_them_are_one_cluster_across_borders():
    speed, slipping = np.ones(600), np.zeros(600, bool)
    for begin, end in ((50, 60), (75, 80), (95, 105), (130, 140), (160, 190), (205, 206), (225, 240), (390, 410)):
        slipping[begin:end] = True  # (205, 206) is insignificant: the stick around it is 35 long
    state, found = SlipState.at_rest(1), []
    for chunk in cut(slipping, speed, [0, 100, 200, 400, 600]):
        result = second_test(chunk, 200 if len(found) > 1 else 100, 4.0, state)
        found.append((int(result.slips[0]), int(result.slip_clusters[0])))
    assert found == [(2, 1), (3, 1), (1, 1), (1, 1)]
