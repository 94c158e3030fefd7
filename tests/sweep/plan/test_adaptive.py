"""Adaptive sweeps: a coarse grid first, then boundaries and rough terrain; black and smooth terrain gets no more."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bow_sweep.plan import adaptive
from bow_sweep.plan.adaptive import fill, first_round, next_round, uncertainty, within_budget


def play(terrain: np.ndarray, fraction: float) -> tuple[list[np.ndarray], np.ndarray]:
    """Run an adaptive sweep over a known map; return its rounds and the map with what was simulated."""
    tried, seen = np.zeros(terrain.shape, bool), np.full(terrain.shape, np.nan, np.float32)
    rounds: list[np.ndarray] = []
    while len(cells := next_round(tried, seen, within_budget(fraction, terrain.size))):
        rounds.append(cells)
        tried.ravel()[cells], seen.ravel()[cells] = True, terrain.ravel()[cells]
    return rounds, seen


def agreement(terrain: np.ndarray, filled: np.ndarray) -> float:
    return float(np.mean((filled > 0) == (terrain > 0)))


def coast(ny: int = 48, nx: int = 64) -> np.ndarray:
    """Black left of a wavy boundary, smooth right of it, and a speckled stripe in the middle."""
    y, x = np.mgrid[:ny, :nx]
    shore = nx / 3 + 6 * np.sin(y / 7)
    terrain = np.where(x > shore, 20 + 5 * np.rint((x - shore) / 12), 0).astype(np.float32)
    speckle = np.random.default_rng(0).random((ny, nx)) < 0.5
    terrain[(x > shore) & (x < shore + 6) & speckle] = 0
    return terrain


def test_the_first_round_is_a_coarse_grid_with_both_borders() -> None:
    rows, columns = np.divmod(first_round((64, 128), 4096), 128)
    assert {*rows.tolist()} == {*range(0, 64, 4), 63}
    assert {*columns.tolist()} == {*range(0, 128, 4), 127}
    assert len(rows) == 17 * 33


@given(ny=st.integers(1, 40), nx=st.integers(1, 40), budget=st.integers(1, 1600))
def test_the_first_round_keeps_within_the_budget_and_the_plane(ny: int, nx: int, budget: int) -> None:
    cells = first_round((ny, nx), budget)
    assert 1 <= len(cells) <= budget
    assert np.array_equal(cells, np.unique(cells))
    assert cells[-1] < ny * nx


@given(seed=st.integers(0, 2**32 - 1), fraction=st.floats(0.02, 0.9))
def test_rounds_repeat_no_cell_and_end_within_the_budget(seed: int, fraction: float) -> None:
    random = np.random.default_rng(seed)
    terrain = (5 * random.integers(0, 4, (random.integers(1, 20), random.integers(1, 20)))).astype(np.float32)
    rounds, _ = play(terrain, fraction)
    cells = np.concatenate(rounds)
    assert len(np.unique(cells)) == len(cells) <= max(1, fraction * terrain.size)


def test_a_boundary_is_found_with_a_third_of_the_cells_and_better_than_by_chance() -> None:
    terrain = coast()
    rounds, seen = play(terrain, 0.33)
    assert agreement(terrain, fill(seen)) > 0.99
    number = sum(len(cells) for cells in rounds)
    chance = np.random.default_rng(1).permutation(terrain.size)[:number]
    seen = np.full(terrain.shape, np.nan, np.float32)
    seen.ravel()[chance] = terrain.ravel()[chance]
    assert agreement(terrain, fill(seen)) < 0.98


def test_simulations_go_to_the_speckle_and_not_to_the_black() -> None:
    terrain = coast()
    _, seen = play(terrain, 0.33)
    x = np.arange(terrain.shape[1])
    known = ~np.isnan(seen)
    assert known[:, x < 8].mean() < 0.15  # black all around: the first grid and no more
    shore = 64 / 3 + 6 * np.sin(np.arange(48) / 7)[:, None]
    assert known[(x > shore) & (x < shore + 6)].mean() > 0.9


def test_where_all_is_black_the_first_round_is_enough() -> None:
    rounds, seen = play(np.zeros((64, 128), np.float32), 0.5)
    assert len(rounds) == 1
    assert not fill(seen).any()


def test_where_all_is_noise_the_budget_is_used_up() -> None:
    random = np.random.default_rng(3)
    rounds, _ = play((random.random((32, 64)) < 0.5).astype(np.float32) * 30, 0.5)
    assert sum(map(len, rounds)) > 0.49 * 32 * 64


def test_rough_coloured_terrain_is_less_sure_than_smooth_and_more_than_a_boundary() -> None:
    y, x = np.mgrid[:24, :24]
    grid = (y % 2 == 0) & (x % 2 == 0)
    random = np.random.default_rng(4)

    def doubt(terrain: np.ndarray) -> float:
        return float(uncertainty(np.where(grid, terrain, np.nan))[13, 13])

    smooth, rough = doubt(np.full((24, 24), 30.0)), doubt(5.0 * random.integers(1, 20, (24, 24)))
    tie = doubt(np.where(x < 13, 30.0, 0.0))
    assert smooth < adaptive.SURE < smooth + 0.8 * adaptive.ROUGHNESS < rough < tie


def test_what_is_known_stays_and_what_is_not_is_predicted_from_near_by() -> None:
    known = np.full((5, 7), np.nan, np.float32)
    known[2, [0, 2, 4, 6]] = 40, 50, 0, 0
    filled = fill(known)
    assert np.array_equal(filled[2, [0, 2, 4, 6]], [40, 50, 0, 0])
    assert filled[2, 1] == 45
    assert filled[2, 5] == 0
    assert filled.dtype == np.float32
    assert not (filled % 5).any()


def test_nothing_is_made_up_where_nothing_is_known_near_by() -> None:
    known = np.full((3, 40), np.nan, np.float32)
    known[1, 0] = 25
    filled = fill(known)
    assert (filled[:, : adaptive.RADIUS + 1] == 25).all()
    assert np.isnan(filled[:, adaptive.RADIUS + 1 :]).all()


def test_a_cell_given_up_is_not_tried_again_and_counts_as_not_known() -> None:
    tried, seen = np.zeros((16, 16), bool), np.full((16, 16), np.nan, np.float32)
    first = next_round(tried, seen, 128)
    tried.ravel()[first] = True
    seen.ravel()[first] = 0
    seen[4:9, 4:9] = np.nan  # a block was quarantined
    second = next_round(tried, seen, 128)
    assert not np.isin(second, first).any()
    assert np.isin(second, [16 * y + x for y in range(2, 11) for x in range(2, 11)]).mean() > 0.6


def test_a_round_depends_only_on_what_is_known() -> None:
    terrain = coast()
    rounds, _ = play(terrain, 0.4)
    again, _ = play(terrain.astype(np.float64), 0.4)
    assert all(np.array_equal(a, b) for a, b in zip(rounds, again, strict=True))
    tried, seen = np.zeros(terrain.shape, bool), np.full(terrain.shape, np.nan)
    for cells in rounds[:2]:
        for cell in cells[::-1]:  # in another order
            tried.ravel()[cell], seen.ravel()[cell] = True, terrain.ravel()[cell]
    assert np.array_equal(next_round(tried, seen, within_budget(0.4, terrain.size)), rounds[2])


@pytest.mark.parametrize(("fraction", "cells", "right"), [(0.5, 8192, 4096), (0.001, 100, 1), (0.999, 10, 9)])
def test_the_budget_is_a_share_of_the_cells(fraction: float, cells: int, right: int) -> None:
    assert within_budget(fraction, cells) == right
