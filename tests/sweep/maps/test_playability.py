"""Playability: measures of maps that are simple enough to count by hand."""

from __future__ import annotations

import json

import numpy as np
import pytest
from skimage.measure import label
from terrains import example

from bow_classifier.verdict.regimes import REGIMES
from bow_sweep.maps.playability import MEASURES, SMALLEST, boundary, largest_area, measure, playability, quartiles
from bow_sweep.maps.terrain import TERRAINS, terrain

NAMES = [entry.name for entry in MEASURES]


def half(shape: tuple[int, int] = (32, 64)) -> np.ndarray:
    """Black on the left, 40 periods on the right."""
    lengths = np.zeros(shape)
    lengths[:, shape[1] // 2 :] = 40.0
    return lengths


def value(lengths: np.ndarray, name: str) -> float:
    return playability(lengths)[name]["value"]


def test_a_map_of_two_halves_has_the_numbers_one_can_count():
    lengths = half()
    assert value(lengths, "helmholtz") == 0.5
    assert value(lengths, "largest_area") == 0.5
    assert value(lengths, "boundary") == 32 / (32 * 64)
    assert value(lengths, "median_transient") == pytest.approx(37.5, abs=0.05)  # it came between 35 and 40
    assert value(lengths, "black") == pytest.approx(0.5, abs=0.02)
    assert value(lengths, "smooth") == pytest.approx(0.5, abs=0.02)


def test_a_speck_adds_four_edges_and_makes_the_area_smaller():
    lengths = np.full((32, 64), 40.0)
    lengths[10, 20] = 0
    assert value(lengths, "boundary") == 4 / 2048
    assert value(lengths, "largest_area") == 2047 / 2048


def test_areas_that_touch_at_a_corner_are_two():
    came = np.zeros((4, 4), bool)
    came[:2, :2] = came[2:, 2:] = True
    assert largest_area(came) == 4
    came[2, 1] = True
    assert largest_area(came) == 9
    assert largest_area(np.zeros((4, 4), bool)) == 0


def test_the_largest_area_is_the_one_that_a_plain_flood_fill_finds():
    rng = np.random.default_rng(2)
    for share in (0.3, 0.55, 0.8):
        came = rng.random((20, 30)) < share
        seen, best = np.zeros_like(came), 0
        for start in map(tuple, np.argwhere(came)):
            reached, size = [start], 0
            while reached:
                i, j = reached.pop()
                if not (0 <= i < 20 and 0 <= j < 30) or seen[i, j] or not came[i, j]:
                    continue
                seen[i, j], size = True, size + 1
                reached += [(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)]
            best = max(best, size)
        assert largest_area(came) == best
        assert label(came, connectivity=1).max() >= 1


def test_lengths_are_spread_over_the_interval_in_which_motion_came():
    assert quartiles(np.full(1000, 40.0)) == pytest.approx([36.25, 37.5, 38.75], abs=0.01)
    exact = np.random.default_rng(3).uniform(10, 90, 20000)
    rounded = 5 * np.ceil(exact / 5)
    assert quartiles(rounded) == pytest.approx(np.percentile(exact, (25, 50, 75)), abs=0.3)


def test_areas_of_terrain_add_up():
    for seed in (0, 1):
        numbers = playability(example(seed)[0])
        assert sum(numbers[name]["value"] for name in TERRAINS) == pytest.approx(1)


@pytest.mark.parametrize("name", NAMES)
def test_uncertainty_is_that_of_the_four_interleaved_grids(name):
    lengths, _ = example(11)
    parts = [lengths[i::2, j::2] for i in (0, 1) for j in (0, 1)]
    each = [measure(part, terrain(part))[name] for part in parts]
    entry = playability(lengths)[name]
    assert entry["error"] == pytest.approx(np.std(each, ddof=1) / 2)
    assert entry["half_grid"] == pytest.approx(np.mean(each))


def test_uncertainty_of_a_share_of_independent_cells_is_the_binomial_one():
    rng = np.random.default_rng(4)
    errors = [playability(40.0 * (rng.random((64, 128)) < 0.3))["helmholtz"]["error"] for _ in range(12)]
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(np.sqrt(0.3 * 0.7 / 8192), rel=0.4)


def test_cells_that_are_not_computed_are_left_out():
    lengths = half()
    lengths[:16] = np.nan
    numbers = playability(lengths)
    assert numbers["cells"] == 1024
    assert numbers["helmholtz"]["value"] == 0.5
    assert numbers["boundary"]["value"] == 16 / 1024
    assert boundary(np.ones((2, 2), bool), np.array([[True, False], [True, True]])) == 0


def test_a_measure_of_nothing_is_none():
    nothing = playability(np.full((32, 64), np.nan))
    assert nothing["cells"] == 0
    assert all(nothing[name]["value"] is None and nothing[name]["error"] is None for name in NAMES)
    black = playability(np.zeros((32, 64)))
    assert black["helmholtz"] == {"value": 0, "error": 0, "half_grid": 0}
    assert black["median_transient"] == {"value": None, "error": None, "half_grid": None}


def test_a_map_too_small_for_half_grids_has_no_uncertainty():
    small = playability(half((2 * SMALLEST - 2, 64)))
    assert small["helmholtz"]["value"] == 0.5
    assert all(small[name]["error"] is None for name in NAMES)


def test_black_is_named_by_the_regimes_in_it():
    lengths, regime = half(), np.full((32, 64), REGIMES.index("helmholtz"), np.uint8)
    regime[lengths == 0] = REGIMES.index("multiple_flyback")
    regime[:8][lengths[:8] == 0] = REGIMES.index("aperiodic")
    assert playability(lengths, regime)["black_is"]["black"] == pytest.approx(
        {"multiple_flyback": 0.75, "aperiodic": 0.25}, abs=0.01
    )
    assert "black_is" not in playability(lengths)


def test_the_result_can_be_written_as_json():
    lengths, _ = example(12)
    numbers = playability(lengths, np.zeros(lengths.shape, np.uint8))
    assert json.loads(json.dumps(numbers, allow_nan=False)) == numbers
