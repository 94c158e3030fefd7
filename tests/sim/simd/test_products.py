from __future__ import annotations

import numpy as np
import pytest

from bow_sim.simd.jit import njit
from bow_sim.simd.lanes import LANES
from bow_sim.simd.products import lagged_products

LAGS, BEFORE = 3, 4
_sums = lagged_products(LAGS)


@njit(nogil=True)
def compiled(x, now, past, n, out, at):
    _sums(x, now, past, n, out, at)


@pytest.mark.parametrize("n", [0, 1, 2, 7])
def test_each_sum_is_that_of_the_definition_in_the_order_of_the_samples_bit_for_bit(n):
    x = np.random.default_rng(n).normal(size=(BEFORE + n + LAGS, LANES)) * 10.0 ** np.arange(LANES)
    out = np.full((LAGS + 2, LANES), 7.0)
    compiled(x.ravel(), BEFORE * LANES, LANES, n, out.reshape(-1), LANES)
    expected = np.zeros((LAGS, LANES))
    for i in range(LAGS):
        for t in range(n):
            expected[i] = expected[i] + x[BEFORE + t] * x[1 + t + i]
    assert out[1:-1].tobytes() == expected.tobytes()
    assert (out[[0, -1]] == 7.0).all()  # nothing else is written
