"""Eight lanes compute as eight numbers do, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from bow_sim.simd.bits import count_of
from bow_sim.simd.lanes import (
    LANES,
    absolute,
    aligned,
    bits_of,
    choose,
    load,
    lowest_bit,
    mask_of,
    negative,
    root,
    spread,
    store,
)
from bow_sim.simd.rows import completed, fir_of, nothing_summed, push, transpose, transpose_to
from bow_sim.simd.signs import followed

KINDS = (np.float64, np.float32)


@njit
def arithmetic(a, b, bits, out):
    x, y = load(a, 0), load(b, 0)
    store(out, 0, x + y)
    store(out, 8, x - y)
    store(out, 16, x * y)
    store(out, 24, x / y)
    store(out, 32, -x)
    store(out, 40, absolute(x))
    store(out, 48, root(x))
    store(out, 56, choose(x > y, x, y))
    store(out, 64, choose((x < 0.25) & (y >= 0.5) | (x <= -1.0), x, 0.1))
    store(out, 72, choose(mask_of(bits), x * 0.1, spread(a[7])))
    return bits_of(x < y)


@pytest.mark.parametrize("kind", KINDS)
def test_lanes_compute_as_numpy_does(kind):
    rng = np.random.default_rng(5)
    out = np.zeros(80, kind)
    for _ in range(20):
        a, b = (rng.normal(size=8).astype(kind) for _ in range(2))
        bits = np.uint8(rng.integers(256))
        less = arithmetic(a, b, bits, out)
        chosen = np.unpackbits(np.array([bits]), bitorder="little").astype(bool)
        tenth = kind(0.1)
        with np.errstate(invalid="ignore"):
            want = [
                a + b,
                a - b,
                a * b,
                a / b,
                -a,
                np.abs(a),
                np.sqrt(a),
                np.where(a > b, a, b),
                np.where((a < 0.25) & (b >= 0.5) | (a <= -1.0), a, tenth),
                np.where(chosen, a * tenth, a[7]),
            ]
        assert np.array_equal(out, np.concatenate(want), equal_nan=True)
        assert less == np.packbits(a < b, bitorder="little")[0]


def test_the_python_twins_take_numbers_and_arrays():
    assert (absolute(-2.0), root(4.0), choose(True, 1.0, 2.0)) == (2.0, 2.0, 1.0)
    assert np.isnan(root(-1.0))
    assert choose(np.array([True, False]), np.ones(2), 0.0).tolist() == [1.0, 0.0]


@njit
def places(words, out):
    for i in range(len(words)):
        out[i] = lowest_bit(words[i])


def test_the_lowest_bit_of_a_word_is_found():
    words = np.array([1 << k for k in range(64)] + [(3 << k) % 2**64 for k in range(64)], np.uint64)
    out = np.zeros(len(words), np.int64)
    places(words, out)
    assert out.tolist() == 2 * list(range(64))


@njit
def counted(x):
    return count_of(load(x, 0))


@pytest.mark.parametrize("kind", KINDS)
def test_counts_in_lanes_are_added(kind):
    assert counted(np.array([3, 0, 1, 40, 7, 0, 0, 5000], kind)) == 5051


_fir4 = fir_of(4)


@njit
def convolve(taps, x, out):
    _fir4(taps, x, LANES, out, 0, LANES)


@pytest.mark.parametrize("kind", KINDS)
def test_several_steps_of_a_convolution_are_sums_from_left_to_right(kind):
    rng = np.random.default_rng(6)
    x, out = rng.normal(size=(12, LANES)).astype(kind), np.zeros((4, LANES), kind)
    taps = tuple(kind(t) for t in rng.normal(size=5))
    convolve(taps, x, out)
    for r in range(4):
        total = np.zeros(LANES, kind)
        for k, tap in enumerate(taps):
            total = total + tap * x[1 + r + k]
        assert out[r].tolist() == total.tolist()


@njit
def convolve_by_samples(taps, table, x, out):
    sums = nothing_summed(taps, load(x, 0))
    for t in range(x.shape[0]):
        sample = load(x, t * LANES)
        store(out, t * LANES, completed(table, sums, sample))
        sums = push(table, sums, sample)


@pytest.mark.parametrize("kind", KINDS)
def test_samples_added_one_by_one_give_the_sums_of_a_convolution_to_the_bit(kind):
    rng = np.random.default_rng(8)
    x, out = rng.normal(size=(8, LANES)).astype(kind), np.zeros((8, LANES), kind)
    table = rng.normal(size=5).astype(kind)
    four = np.zeros((4, LANES), kind)
    convolve_by_samples(tuple(table), table, x, out)
    convolve(tuple(table), np.concatenate([np.zeros((1, LANES), kind), x]), four)
    assert out[4:].tolist() == four.tolist()


@njit
def follow(x, out):
    past = spread(x[0]) - x[0]
    for t in range(len(x) // LANES):
        past = followed(past, negative(load(x, t * LANES)))
    store(out, 0, past)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("steps", [1, 31, 32, 64, 100])
def test_the_latest_states_of_a_lane_are_its_bits(kind, steps):
    x = np.random.default_rng(steps).normal(size=(steps, LANES)).astype(kind)
    out = np.zeros(LANES, kind)
    follow(x.ravel(), out)
    width = out.itemsize * 8
    bits = np.unpackbits(out.view(np.uint8).reshape(LANES, -1), axis=1, bitorder="little")
    states = np.concatenate([np.zeros((width, LANES)), x < 0])[-width:]
    assert bits.T.tolist() == states.tolist()


@njit
def turn(x, out):
    transpose(x, 2 * LANES, LANES, out, 3, out.shape[1])


@pytest.mark.parametrize("kind", KINDS)
def test_a_square_is_transposed_and_rounded_to_single_precision(kind):
    x = np.random.default_rng(7).normal(size=(11, LANES)).astype(kind)
    out = np.zeros((LANES, 20), np.float32)
    turn(x, out)
    assert np.array_equal(out[:, 3:11], x[2:10].T.astype(np.float32))
    assert not out[:, :3].any() and not out[:, 11:].any()


@njit
def turn_to(x, out, columns):
    transpose_to(x, 0, LANES, out, 3, out.shape[1], columns, 2)


@pytest.mark.parametrize("kind", KINDS)
def test_the_columns_of_a_square_may_be_written_in_any_order(kind):
    rng = np.random.default_rng(8)
    x, order = rng.normal(size=(LANES, LANES)).astype(kind), rng.permutation(LANES + 3)[:LANES]
    out = np.zeros((LANES + 3, 20), np.float32)
    turn_to(x, out, np.append([0, 0], order))
    assert np.array_equal(out[order, 3:11], x.T.astype(np.float32))
    assert np.count_nonzero(out) == LANES * LANES


def test_buffers_begin_at_cache_lines():
    for size in range(1, 40, 7):
        buffer = aligned((size, LANES), np.float64)
        assert buffer.ctypes.data % 64 == 0 and buffer.shape == (size, LANES) and not buffer.any()
