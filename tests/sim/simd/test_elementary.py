"""Elementary functions in compiled code: near the true value, and equal to plain arithmetic in Python, bit for bit."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bow_sim.simd import elementary


@given(st.floats(-690, 690))
def test_exp(x: float) -> None:
    assert elementary.exp(x) == pytest.approx(math.exp(x), rel=4e-15)
    assert elementary.exp(x) == elementary.exp.py_func(x)


@given(st.floats(1e-300, 1e300))
def test_log(x: float) -> None:
    assert elementary.log(x) == pytest.approx(math.log(x), rel=4e-15, abs=4e-16)
    assert elementary.log(x) == elementary.log.py_func(x)


@given(st.floats(-2 * math.pi, 2 * math.pi))
def test_turn(x: float) -> None:
    assert elementary.turn(x) == pytest.approx((math.cos(x), math.sin(x)), abs=1e-14)
    assert elementary.turn(x) == elementary.turn.py_func(x)


def test_beyond_its_range_exp_stays_finite() -> None:
    assert elementary.exp(1e6) == elementary.exp(700.0) < math.inf
    assert elementary.exp(-math.inf) == elementary.exp(-700.0) > 0
