"""Slips that the borders of chunks cut, joined."""

from __future__ import annotations

import numpy as np

from bow_sweep.maps.slips import Pieces, join


def chunk(*cells: tuple[bool, list[tuple[int, int, float]]]) -> Pieces:
    """Return a chunk of 100 samples: of each cell the state before it, and its slips as (onset, duration, slip)."""
    rows = [slip for _, slips in cells for slip in slips]
    offsets = np.append(0, np.cumsum([len(slips) for _, slips in cells]))
    columns = [np.array(column) for column in zip(*rows, strict=True)] or [np.zeros(0)] * 3
    return Pieces(np.array([before for before, _ in cells]), offsets, *columns)


def test_a_slip_that_lasts_over_several_chunks_is_one() -> None:
    found = join(
        [
            chunk((False, [(10, 5, 1.0)]), (False, [(90, 10, 0.1)])),
            chunk((False, [(0, 7, 2.0)]), (True, [(0, 100, 0.2)])),
            chunk((False, []), (True, [(0, 3, 0.3), (50, 2, 4.0)])),
        ],
        100,
    )
    assert found.cell.tolist() == [0, 0, 1, 1]
    assert found.start.tolist() == [10, 100, 90, 250]
    assert found.end.tolist() == [15, 107, 203, 252]
    assert found.slip.tolist() == [1.0, 2.0, 0.1 + 0.2 + 0.3, 4.0]
    assert found.of(1).start.tolist() == [90, 250]


def test_a_slip_at_the_end_of_one_cell_does_not_go_on_in_the_next() -> None:
    found = join([chunk((True, [(0, 100, 1.0)]), (True, [(0, 4, 2.0)]))], 100)
    assert found.end.tolist() == [100, 4]


def test_cells_that_never_slip_have_no_slips() -> None:
    found = join([chunk((False, []), (False, []))], 100)
    assert [len(column) for column in found] == [0, 0, 0, 0]
    assert found.start.dtype == np.int64
