"""Elementary functions with the same bits on every machine: the true value, rounded once."""

from __future__ import annotations

import math
from decimal import Decimal, localcontext

import gmpy2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bow_sim.physics import exact


@given(st.floats(-744, 709))
def test_exp_is_the_nearest_number(x: float) -> None:
    with localcontext() as context:
        context.prec = 60
        assert exact.exp(x) == float(Decimal(x).exp())


@given(st.floats(0.01, 100), st.floats(-20, 20))
def test_power_is_the_nearest_number(base: float, exponent: float) -> None:
    with localcontext() as context:
        context.prec = 60
        assert exact.power(base, exponent) == float((Decimal(base).ln() * Decimal(exponent)).exp())


@given(st.floats(-10, 10))
def test_angles(x: float) -> None:
    assert exact.turn(x) == pytest.approx((math.cos(x), math.sin(x)), abs=1e-15)
    assert exact.tan(x) == pytest.approx(math.tan(x), rel=1e-14)


@given(st.floats(1e-6, 1e6), st.floats(1e-6, 1e6), st.integers(1, 40))
def test_geometric_is_that_of_numpy_with_exact_ends(first: float, last: float, count: int) -> None:
    found = exact.geometric(first, last, count)
    assert found == pytest.approx(np.geomspace(first, last, count), rel=1e-13)
    assert found[0] == first
    assert count == 1 or found[-1] == last


@pytest.mark.parametrize(
    ("first", "last", "count"), [(0.5, 20, 128), (20, 0.5, 65), (1e-280, 1e280, 999), (5e-324, 1, 9), (1, 1.7e308, 9)]
)
def test_geometric_is_rounded_once(first: float, last: float, count: int) -> None:
    with localcontext() as context:
        context.prec = 60
        start, end = Decimal(first).ln(), Decimal(last).ln()
        inner = [float((start + (end - start) * k / (count - 1)).exp()) for k in range(1, count - 1)]
    assert exact.geometric(first, last, count).tolist() == [first, *inner, last]


def test_an_axis_of_millions_takes_no_time() -> None:
    found = exact.geometric(0.5, 20, 1 << 22)
    assert (np.diff(found) > 0).all()


@pytest.mark.parametrize("size", [2, 4, 8, 4096])
def test_the_inverse_transform_is_that_of_numpy(size: int) -> None:
    spectrum = np.fft.rfft(np.random.default_rng(size).standard_normal(size))
    found = exact.inverse_real_fft(spectrum.real, spectrum.imag)
    assert found == pytest.approx(np.fft.irfft(spectrum, size), abs=1e-14)


def test_the_precision_that_a_program_sets_for_its_thread_changes_nothing() -> None:
    def found() -> list[object]:
        x = 0.3
        functions = exact.exp(x), exact.power(x, 1.7), exact.tan(x), exact.turn(x)
        return [*functions, exact.geometric(0.5, 20, 8).tolist(), exact.geometric(1e-300, 1, 9).tolist()]

    usual = found()
    with gmpy2.context(precision=24):
        assert found() == usual
