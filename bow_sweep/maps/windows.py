"""What is near a cell of a map: sums in Gaussian windows, discs, contiguous areas.

:mod:`scipy.ndimage` has all three, and gives the same to the last bit. But to import it takes 0.1 s, which every sweep
would wait for.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


def gaussian_sums(values: ArrayLike, sigma: float, reach: float) -> Floats:
    """Return sums in a Gaussian window whose weights have the sum 1; cells outside the map count 0.

    Parameters
    ----------
    values
        (ny, nx).
    sigma
        Standard deviation of the window, cells.
    reach
        The window ends at this many standard deviations.
    """
    half = int(reach * sigma + 0.5)
    weights = np.exp(-0.5 / (sigma * sigma) * np.arange(-half, half + 1) ** 2)
    weights /= weights.sum()
    sums = np.asarray(values, float)
    for axis in (0, 1):
        shape = list(sums.shape)
        shape[axis] += 2 * half
        wide = np.zeros(shape).swapaxes(axis, 0)
        wide[half : half + sums.shape[axis]] = sums.swapaxes(axis, 0)
        sums = sums * weights[half]
        total = sums.swapaxes(axis, 0)
        pair = np.empty_like(total)
        for far in range(half, 0, -1):  # in this order: others round otherwise
            np.add(wide[half - far :][: len(total)], wide[half + far :][: len(total)], out=pair)
            pair *= weights[half - far]
            total += pair
    return sums


def within(mask: Mask, radius: float) -> Mask:
    """Return which cells are no farther than `radius`, in cells, from a cell of a mask, (ny, nx) each."""
    half = int(radius)
    (ny, nx), wide = mask.shape, np.pad(mask, half)
    result = np.zeros_like(mask)
    for y in range(2 * half + 1):
        for x in range(2 * half + 1):
            if math.sqrt((y - half) ** 2 + (x - half) ** 2) <= radius:
                result |= wide[y : y + ny, x : x + nx]
    return result


def largest_area(mask: Mask) -> int:
    """Return the number of cells in the largest contiguous area of a mask, (ny, nx); neighbours share an edge."""
    cells = np.arange(mask.size).reshape(mask.shape)
    across, along = mask[:, 1:] & mask[:, :-1], mask[1:] & mask[:-1]
    one = np.concatenate([cells[:, :-1][across], cells[:-1][along]])
    other = np.concatenate([cells[:, 1:][across], cells[1:][along]])
    first = cells.ravel()  # of each cell: one of its area that comes before it, in the end the first
    while (apart := first[one] != first[other]).any():
        one, other = first[one[apart]], first[other[apart]]
        np.minimum.at(first, np.maximum(one, other), np.minimum(one, other))
        while (first != first[first]).any():
            first = first[first]
    return int(np.bincount(first[mask.ravel()], minlength=1).max())
