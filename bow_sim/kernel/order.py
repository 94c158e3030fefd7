"""Which cell is in which lane: cells with like reflection functions are put into one group of eight lanes.

The window of a group contains the lags of all its cells (:mod:`bow_sim.kernel.windows`), so it is short where these
are alike. A cell's results do not depend on its lane.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bow_sim.kernel.arguments import Intervals, Places
from bow_sim.physics.reflection import Ends


def order_of(ends: Sequence[Ends]) -> NDArray[np.int64] | None:
    """Return the cell of each lane, shape (cells,), so that like windows are neighbours; None if they already are.

    Parameters
    ----------
    ends : sequence of Ends
        Of each cell, or a single one that all cells share.
    """
    windows = {key: tuple((r.first, len(r.taps)) for r in e[:4]) for key, e in {id(e): e for e in ends}.items()}
    keys = [windows[id(e)] for e in ends]
    order = sorted(range(len(keys)), key=keys.__getitem__)
    return None if order == list(range(len(keys))) else np.array(order)


def places(order: NDArray[np.int64] | None, lanes: int, samples: int) -> Places:
    """Return where the lanes of an order are written, as `order_of` returns it; lanes beyond the cells stay."""
    rows = np.arange(lanes)
    if order is not None:
        rows[: len(order)] = order
    return Places(rows, room(lanes, samples))


def room(lanes: int, samples: int) -> Intervals:
    """Return room for the slip intervals of so many samples: every slip and every stick may be one sample long."""
    most = lanes * (samples // 2 + 1)
    return Intervals(
        np.zeros(lanes + 1, np.uint32), np.empty(most, np.uint32), np.empty(most, np.uint32), np.empty(most)
    )
