"""Taps of cells that differ are laid out so that a group's window has each lane's at its own lags."""

from __future__ import annotations

import numpy as np
import pytest

from bow_sim.kernel.windows import windows
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
