"""What is near a cell is what SciPy says, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from bow_sweep.maps.windows import gaussian_sums, largest_area, within

SHAPES = ((1, 1), (1, 9), (40, 3), (17, 30), (64, 128))


def masks(shape: tuple[int, int]) -> list[np.ndarray]:
    """Return masks of speckle, of large areas, of everything and of nothing."""
    random = np.random.default_rng(sum(shape))
    waves = ndimage.gaussian_filter(random.normal(size=shape), 2) > 0
    return [random.random(shape) < 0.6, waves, np.ones(shape, bool), np.zeros(shape, bool)]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("sigma", [0.8, 1.0, 1.6, 3.0])
def test_sums_in_a_gaussian_window_have_the_bits_of_scipy(shape: tuple[int, int], sigma: float) -> None:
    numbers = np.random.default_rng(1).normal(size=shape)
    for values in (numbers, *masks(shape)):
        there = ndimage.gaussian_filter(np.asarray(values, float), sigma, mode="constant", truncate=3.0)
        assert gaussian_sums(values, sigma, 3.0).tobytes() == there.tobytes()


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("radius", [0.5, 1.0, 2.5, 5.0])
def test_a_disc_has_the_cells_whose_distance_is_no_larger_than_its_radius(
    shape: tuple[int, int], radius: float
) -> None:
    for mask in masks(shape)[:3]:
        assert np.array_equal(within(mask, radius), ndimage.distance_transform_edt(~mask) <= radius)
    assert not within(np.zeros(shape, bool), radius).any()


@pytest.mark.parametrize("shape", SHAPES)
def test_the_largest_area_has_as_many_cells_as_the_largest_label(shape: tuple[int, int]) -> None:
    for mask in masks(shape):
        areas, _ = ndimage.label(mask)
        assert largest_area(mask) == np.bincount(areas.ravel())[1:].max(initial=0)


def test_an_area_may_wind_through_the_whole_map() -> None:
    path = np.zeros((40, 50), bool)
    path[::2] = True
    path[1::4, -1] = path[3::4, 0] = True
    assert largest_area(path) == path.sum()
