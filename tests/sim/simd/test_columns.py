from __future__ import annotations

import numpy as np
import pytest

from bow_sim.simd.bits import BYTES, MANY, find_onsets, nonzero
from bow_sim.simd.columns import columns, four_twice, summed_columns, sums_of_eight, transposed_halves
from bow_sim.simd.jit import njit
from bow_sim.simd.lanes import LANES, load, store


@njit(nogil=True)
def transposed(x, i, width, rows, level, out, at):
    columns(x, i, width, rows, load(level, 0), out, at)


@njit(nogil=True)
def transposed_and_summed(x, i, width, rows, n, level, out, at, sums):
    found = summed_columns(x, i, width, rows, n, load(level, 0), out, at)
    for k in range(4):
        store(sums, LANES * k, found[k])


@njit(nogil=True)
def eights(x, i, level, out):
    store(out, 0, sums_of_eight(x, i, load(level, 0)))


@njit(nogil=True)
def quarters(x, out):
    a, b, c, d = transposed_halves(load(x, 0), load(x, LANES), load(x, 2 * LANES), load(x, 3 * LANES))
    for k, lanes in enumerate((a, b, c, d)):
        store(out, LANES * k, lanes)


@njit(nogil=True)
def twice(x, i, out):
    store(out, 0, four_twice(x, i))


@njit(nogil=True)
def onsets(x, start, count, delay, low, high, found):
    find_onsets(x, start, count, delay, low, high, found)


@njit(nogil=True)
def some(found, i):
    return nonzero(found, i)


@pytest.mark.parametrize("rows", [1, 5, LANES])
def test_eight_rows_are_transposed_less_their_levels(rows):
    rng = np.random.default_rng(1)
    x, level = rng.normal(size=(rows, 21)).astype(np.float32), rng.normal(size=LANES)
    out = np.full((LANES + 2, LANES), 7.0)
    transposed(x, 5, x.shape[1], rows, level, out.reshape(-1), LANES)
    present = x[np.minimum(np.arange(LANES), rows - 1), 5 : 5 + LANES]  # the last row stands for those that are missing
    assert out[1:-1].tobytes() == (present.T.astype(float) - level).tobytes()
    assert (out[[0, -1]] == 7.0).all()  # nothing else is written


@pytest.mark.parametrize("n", [0, LANES, 3 * LANES])
@pytest.mark.parametrize("rows", [3, LANES])
def test_what_is_transposed_is_summed_in_its_order(rows, n):
    rng = np.random.default_rng(n)
    x, level = rng.normal(size=(rows, 29)).astype(np.float32), rng.normal(size=LANES)
    out, found = np.full((n + 2, LANES), 7.0), np.empty((4, LANES))
    transposed_and_summed(x, 4, x.shape[1], rows, n, level, out.reshape(-1), LANES, found.reshape(-1))
    taken = x[np.minimum(np.arange(LANES), rows - 1), 4 : 4 + n].T.astype(float) - level
    assert out[1:-1].tobytes() == taken.tobytes()
    assert (out[[0, -1]] == 7.0).all()
    expected = np.zeros((4, LANES))
    for t, column in enumerate(taken):
        expected[t % 2 * 2] += column
        expected[t % 2 * 2 + 1] += column * column
    assert found.tobytes() == expected.tobytes()


def test_eight_times_eight_successive_samples_are_summed_in_pairs_less_their_levels():
    rng = np.random.default_rng(3)
    x, level, found = rng.normal(size=80).astype(np.float32), rng.normal(size=LANES), np.empty(LANES)
    eights(x, 5, level, found)
    y = x[5 : 5 + LANES * LANES].reshape(LANES, LANES).astype(float) - level[:, None]
    pairs = y[:, ::2] + y[:, 1::2]
    assert found.tobytes() == ((pairs[:, 0] + pairs[:, 1]) + (pairs[:, 2] + pairs[:, 3])).tobytes()


@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_lower_and_upper_lanes_of_four_values_are_transposed_by_themselves(kind):
    x = np.arange(4 * LANES, dtype=kind)
    found = np.empty_like(x)
    quarters(x, found)
    assert np.array_equal(found.reshape(4, 2, 4), x.reshape(4, 2, 4).transpose(2, 1, 0))


def test_four_elements_are_read_into_both_halves_of_the_lanes():
    found = np.empty(LANES)
    twice(np.arange(9.0), 3, found)
    assert found.tolist() == [3, 4, 5, 6, 3, 4, 5, 6]


@pytest.mark.parametrize("delay", [1, 7, 40])
@pytest.mark.parametrize("count", [0, MANY, 5 * MANY])
def test_onsets_are_where_a_level_between_the_two_may_be_passed_upwards_or_downwards(delay, count):
    x, start = np.random.default_rng(delay).normal(size=200).astype(np.float32), 41
    x[60:63] = np.nan, 0.0, -0.0
    low, high = np.float32(0.5), np.float32(1.25)
    found = np.full(count // LANES + 1, 255, np.uint8)
    onsets(x, start, count, delay, low, high, found)
    now, before = (x[begin : begin + count] - x[begin - delay : begin - delay + count] for begin in (start, start - 1))
    expected = (np.abs(now) > low) & (np.where(np.signbit(now), -before, before) <= high)
    assert np.unpackbits(found[:-1], bitorder="little").tolist() == expected.astype(int).tolist()
    assert count == 0 or 0 < expected.sum() < count
    assert found[-1] == 255  # nothing else is written


def test_bytes_that_are_not_zero_are_the_bits_of_a_word():
    found = np.random.default_rng(2).integers(0, 2, 2 * BYTES, np.uint8) * np.uint8(17)
    for i in (0, 3, BYTES):
        assert int(some(found, i)) == sum(1 << k for k in range(BYTES) if found[i + k])
