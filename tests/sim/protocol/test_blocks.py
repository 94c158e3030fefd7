"""Blocks: every planned cell is in one, in the order of the rounds; the announced rounds give the same blocks."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bow_sim.physics.errors import ParameterError
from bow_sim.protocol.blocks import Blocks


def grow(cells: int, block_cells: int, rounds: list[list[int]]) -> Blocks:
    return Blocks(cells, block_cells, [np.array(part) for part in rounds])


@given(st.integers(1, 60), st.integers(1, 20))
def test_an_exhaustive_sweep_has_every_cell_once_in_order(cells: int, block_cells: int) -> None:
    blocks = Blocks(cells, block_cells)
    parts = [blocks.block(n) for n in range(blocks.count)]
    assert np.array_equal(np.concatenate(parts), np.arange(cells))
    assert {len(part) for part in parts[:-1]} <= {block_cells}
    assert blocks.count == -(-cells // block_cells)
    assert blocks.planned_cells == cells
    assert blocks.announce().size == 0


def test_each_round_has_its_own_blocks_numbered_through_all_rounds() -> None:
    blocks = grow(20, 3, [[0, 4, 8, 12, 16], [5, 6], [1, 2, 3, 9]])
    cut = [blocks.block(n).tolist() for n in range(blocks.count)]
    assert cut == [[0, 4, 8], [12, 16], [5, 6], [1, 2, 3], [9]]
    assert [blocks.size(n) for n in range(5)] == [3, 2, 2, 3, 1]
    assert blocks.planned_cells == blocks.planned.sum() == 11
    assert np.flatnonzero(blocks.cells_of([1, 4])).tolist() == [9, 12, 16]


@given(st.data())
def test_what_is_announced_gives_the_same_blocks(data: st.DataObject) -> None:
    cells, block_cells = data.draw(st.integers(1, 40)), data.draw(st.integers(1, 9))
    order = data.draw(st.permutations(range(cells)))
    blocks = Blocks(cells, block_cells, [np.sort(order[:1])])
    at = 1
    while at < cells and data.draw(st.booleans()):
        size = data.draw(st.integers(1, cells - at))
        blocks, at = blocks.grown(np.sort(order[at : at + size])), at + size
    again = Blocks.announced(cells, block_cells, blocks.announce())
    assert again.count == blocks.count
    assert all(np.array_equal(again.block(n), blocks.block(n)) for n in range(blocks.count))
    assert again.extends(blocks) and blocks.extends(again)


def test_a_grown_plan_extends_the_one_before_and_not_the_other_way_round() -> None:
    small = grow(20, 3, [[0, 4, 8]])
    large = small.grown(np.array([1, 2]))
    assert large.extends(small)
    assert not small.extends(large)
    assert not grow(20, 3, [[0, 4, 9], [1, 2]]).extends(small)
    assert not grow(20, 4, [[0, 4, 8]]).extends(small)
    assert not Blocks(20, 3).extends(small)


@pytest.mark.parametrize("cells", [[], [4], [3, 2], [5, 5], [20], [-1, 3]])
def test_a_round_of_cells_that_are_planned_not_there_or_out_of_order_is_refused(cells: list[int]) -> None:
    with pytest.raises(ValueError, match="cell"):
        grow(20, 3, [[0, 4, 8]]).grown(np.array(cells, np.int64))


def test_an_exhaustive_plan_does_not_grow() -> None:
    with pytest.raises(ValueError, match="planned already"):
        Blocks(20, 3).grown(np.array([3]))


@pytest.mark.parametrize("round_of", [[1, 1], [0, 0, 0], [1, 3, 3], [2, 2, 0]])
def test_an_announcement_with_a_gap_or_of_another_size_is_refused(round_of: list[int]) -> None:
    with pytest.raises(ParameterError, match=r"Plan\.rounds"):
        Blocks.announced(3, 2, np.array(round_of, np.uint8))


def test_there_is_no_block_after_the_last() -> None:
    with pytest.raises(IndexError, match=r"blocks 0 \.\.\. 1"):
        grow(9, 2, [[1, 2, 3]]).block(2)
