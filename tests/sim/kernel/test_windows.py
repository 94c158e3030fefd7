"""Cells with like lags come into one group, and its window has each lane's taps at its own lags."""

from __future__ import annotations

import numpy as np
import pytest

from bow_sim.kernel.order import order_of
from bow_sim.kernel.windows import windows
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection import ends
from bow_sim.simd.lanes import LANES


@pytest.mark.parametrize("even", [False, True])
def test_each_lane_has_its_taps_at_its_lags_and_a_group_as_many_as_it_needs(even: bool) -> None:
    near = [(3, (0.5,))] * LANES
    spread = [(10 + lane, tuple(range(1, 2 + lane))) for lane in range(LANES)]  # lags 10 ... 24
    taps, count, last = windows(near + spread, np.float32, even)
    assert (taps.dtype, taps.shape) == (np.float32, (2, 16 if even else 15, LANES))
    assert count.tolist() == ([2, 16] if even else [1, 15])
    assert last.tolist() == [3, 24]
    for group, functions in enumerate((near, spread)):
        for lane, (lag, values) in enumerate(functions):
            want = np.zeros(taps.shape[1])
            want[[last[group] - (lag + k) for k in range(len(values))]] = values
            assert taps[group, :, lane].tolist() == want.tolist()
        assert not taps[group, count[group] :].any()


def test_a_greatest_lag_is_made_odd_and_has_a_tap_for_each_lag_below_it() -> None:
    functions = [(1, (0.5,))] * LANES + [(2, (1.0, 2.0, 3.0))] * LANES + [(4, (1.0, 2.0, 3.0, 4.0, 5.0))] * LANES
    taps, count, last = windows(functions, np.float64, even=True, least=3)
    assert (last.tolist(), count.tolist(), taps.shape[1]) == ([3, 5, 9], [4, 4, 6], 9)
    for group, size in enumerate(last):
        by_lag = {size - k: taps[group, k, 0] for k in range(size)}
        lag, values = functions[group * LANES]
        assert by_lag == {n: dict(enumerate(values, lag)).get(n, 0.0) for n in range(1, size + 1)}


def test_cells_with_like_lags_are_neighbours_in_an_order_that_keeps_what_is_alike() -> None:
    near, far = (ends(Parameters(bow_bridge=n)) for n in (9, 30))
    order = order_of([far, near, far, near])
    assert order is not None and order.tolist() == [1, 3, 0, 2]
    assert order_of([near, near, far]) is None
    assert order_of([near]) is None
