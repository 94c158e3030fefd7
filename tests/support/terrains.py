"""Synthetic maps of known terrain: regions with curved borders, each with a texture that section IV.B describes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from bow_sweep.maps.terrain import BLACK, SAFE_SPECKLE, SMOOTH, SPECKLE, STREAKY

INTERVAL = 5
"""Periods between two tests; lengths are multiples of it."""

KINDS = (BLACK, SMOOTH, SAFE_SPECKLE, SPECKLE, STREAKY)


@dataclass(frozen=True)
class Look:
    """Ranges from which the textures of a map are drawn; held-out maps can differ from those for tuning."""

    specks_in_black: tuple[float, float] = (0.0, 0.02)
    black_in_safe: tuple[float, float] = (0.0, 0.08)
    black_in_speckle: tuple[float, float] = (0.3, 0.7)
    period: tuple[float, float] = (6.0, 11.0)  # cells from streak to streak, across them
    duty: tuple[float, float] = (0.4, 0.6)  # share of a period that is coloured
    torn: tuple[float, float] = (0.0, 0.06)  # share of cells flipped in streaks
    spread: tuple[float, float] = (12.0, 22.0)  # periods, standard deviation of uneven lengths
    bend: tuple[float, float] = (0.0, 0.6)  # how much streaks curve


def smooth_field(rng: np.random.Generator, shape: tuple[int, int], scale: float) -> np.ndarray:
    """Return a smooth random field, (ny, nx), mean 0 and standard deviation 1."""
    pad = int(3 * scale)
    field = gaussian_filter(rng.normal(size=(shape[0] + 2 * pad, shape[1] + 2 * pad)), scale)
    field = field[pad:-pad, pad:-pad]
    return (field - field.mean()) / (field.std() + 1e-12)


def quantised(lengths: np.ndarray) -> np.ndarray:
    """Return lengths rounded up to tests: multiples of the interval, 5 ... 100."""
    return np.clip(INTERVAL * np.ceil(lengths / INTERVAL), INTERVAL, 100)


def texture(kind: int, rng: np.random.Generator, shape: tuple[int, int], look: Look) -> np.ndarray:
    """Return transient lengths, (ny, nx) periods, of one kind of terrain; 0 = never."""
    ny, nx = shape
    drift = rng.uniform(35, 60) + 15 * smooth_field(rng, shape, 0.2 * nx)
    even = quantised(drift)
    uneven = quantised(drift + rng.uniform(*look.spread) * rng.normal(size=shape))
    chance = rng.random(shape)
    if kind == BLACK:
        return np.where(chance < rng.uniform(*look.specks_in_black), uneven, 0)
    if kind == SMOOTH:
        return even
    if kind == SAFE_SPECKLE:
        return np.where(chance < rng.uniform(*look.black_in_safe), 0, uneven)
    if kind == SPECKLE:
        return np.where(chance < rng.uniform(*look.black_in_speckle), 0, uneven)
    y, x = np.mgrid[:ny, :nx]
    angle, bend = rng.uniform(0, np.pi), rng.uniform(*look.bend)
    along, across = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
    phase = (across + bend * 0.01 * (along - along.mean()) ** 2) / rng.uniform(*look.period)
    inside = (phase + 0.25 * smooth_field(rng, shape, 0.15 * nx)) % 1 < rng.uniform(*look.duty)
    inside ^= chance < rng.uniform(*look.torn)
    return np.where(inside, even if rng.random() < 0.5 else uneven, 0)


def regions(rng: np.random.Generator, shape: tuple[int, int], kinds: np.ndarray) -> np.ndarray:
    """Return the kind of every cell, (ny, nx) uint8: regions around separate points, with curved borders."""
    ny, nx = shape
    y, x = np.mgrid[:ny, :nx].astype(float)
    x, y = (axis + 0.03 * nx * smooth_field(rng, shape, 0.06 * nx) for axis in (x, y))
    places = (np.arange(len(kinds)) + rng.uniform(0.3, 0.7, len(kinds))) / len(kinds) * nx
    heights = rng.uniform(0, ny, len(kinds))
    distance = [(x - px) ** 2 + (y - py) ** 2 for px, py in zip(places, heights, strict=True)]
    return kinds[np.argmin(distance, axis=0)].astype(np.uint8)


def example(seed: int, shape: tuple[int, int] = (64, 128), look: Look | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return a map with all kinds of terrain, and the true kind of each cell.

    Returns
    -------
    transient_periods
        (ny, nx) float32, multiples of five periods; 0 = never.
    truth
        (ny, nx) uint8, codes of `bow_sweep.maps.terrain`.
    """
    rng, look = np.random.default_rng(seed), look or Look()
    truth = regions(rng, shape, rng.permutation(KINDS))
    lengths = np.zeros(shape)
    for kind in KINDS:
        part = texture(kind, rng, shape, look)
        lengths[truth == kind] = part[truth == kind]
    return lengths.astype(np.float32), truth
