"""Lanes that are steps are shifted and summed up as numbers are, and signs are taken over, bit for bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba import njit

from bow_sim.simd.lanes import LANES, load, read, store, write
from bow_sim.simd.signs import with_sign
from bow_sim.simd.steps import highest, lowest, recursion, rotated


@njit
def steps(pole: Any, z: Any, x: Any, out: Any) -> Any:
    lanes = load(x, 0)
    store(out, 0, rotated(lanes))
    store(out, LANES, recursion(pole, z, lanes))
    return lowest(lanes), highest(lanes)


def test_eight_steps_are_those_of_a_loop() -> None:
    rng = np.random.default_rng(3)
    out = np.zeros(2 * LANES)
    for _ in range(20):
        x, (pole, z) = rng.normal(size=LANES), rng.normal(size=2)
        assert steps(pole, z, x, out) == (x[0], x[-1])
        assert out[:LANES].tolist() == np.roll(x, -1).tolist()
        for u in range(LANES):
            z = pole * z + x[u]
            assert out[LANES + u] == z


@njit
def signed(s: Any, d: Any, out: Any) -> None:
    store(out, 0, with_sign(load(s, 0), load(d, 0)))


@njit
def signed_one(s: Any, d: Any, out: Any) -> None:
    for i in range(len(s)):
        write(out, i, with_sign(read(s, i, 0.0), read(d, i, 0.0)))


S = np.array([1.5, -1.5, 0.0, -0.0, np.inf, 1e-310, -2.0, 7.0])
D = np.array([-1.0, -2.0, -3.0, 4.0, -np.inf, -1e-310, -0.0, 0.0])


@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_the_sign_bit_decides(kind: Any) -> None:
    s, d, out = S.astype(kind), D.astype(kind), np.zeros(LANES, kind)
    want = np.where(np.signbit(d), -s, s)
    signed(s, d, out)
    assert out.tobytes() == want.tobytes()
    if kind is np.float64:
        signed_one(s, d, out)
        assert out.tobytes() == want.tobytes()


def test_numbers_and_arrays_have_signs_too() -> None:
    assert (with_sign(2.0, -1.0), with_sign(-2.0, -1.0), with_sign(2.0, 1.0)) == (-2.0, 2.0, 2.0)
    assert with_sign(np.array([1.0, 2.0]), np.array([-3.0, 3.0])).tolist() == [-1.0, 2.0]
