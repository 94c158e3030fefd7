"""Terrain: which of the paper's five kinds surrounds each cell of a map (section IV.B).

Section IV.B distinguishes five kinds of terrain by eye: uniform black, smooth, two kinds of speckle, streaky. Here they
are distinguished by four features of the map of transient lengths, derived from the paper's descriptions:

=============  ==================================================================================
specks         how many cells near by differ from most of their neighbours
narrow         whether a disc of radius `Texture.solid` fits into the coloured, or black, area here
coherence      whether the borders between colour and black near by have one direction
unevenness     how often the lengths of three coloured cells in a row are not on a line
=============  ==================================================================================

A cell with many specks near by, or in a narrow area, is *streaky* where the borders have one direction, else *speckle*
(with black). Of the other cells, black ones are *black*, and coloured ones are *smooth* or, where their lengths are
uneven, *safe speckle*.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sweep.maps.windows import Floats, Mask, gaussian_sums, within

TERRAINS = ("black", "smooth", "safe_speckle", "speckle", "streaky")
"""Names of the codes. *safe_speckle* has few black cells and uneven lengths; in *speckle* coloured and black cells are
interleaved at random, in *streaky* they form streaks."""

BLACK, SMOOTH, SAFE_SPECKLE, SPECKLE, STREAKY = range(len(TERRAINS))

UNKNOWN = 255
"""Code of a cell that is not computed."""

REACH = 3.0
"""A Gaussian window ends at this many standard deviations."""


@dataclass(frozen=True)
class Texture:
    """Scales and limits of the features, tuned on synthetic maps of known terrain (tests/support/terrains.py).

    Scales are in cells, because specks are single cells on any grid; they are standard deviations of Gaussian windows
    unless stated otherwise. Limits are shares, 0 ... 1.
    """

    majority: float = 1.0
    """Window in which the majority decides whether the surroundings are coloured or black: about nine cells, enough to
    ignore a speck, and few enough to see a streak that is two cells wide."""

    window: float = 1.8
    """Window in which specks are counted: about twenty cells, the fewest that distinguish one black cell in five from
    one in ten."""

    solid: float = 5.0
    """Radius of the disc that does not fit into a narrow area. The streaks of Fig 11(c) are up to ten cells apart."""

    slope: float = 0.8
    """Window of the derivatives that find borders: less than the narrowest streak, two cells."""

    tensor: float = 3.0
    """Window in which the directions of borders are compared: a streak and its two neighbours."""

    lengths: float = 2.5
    """Window in which unevenness is counted; wider than `window`, because smooth terrain should be smooth over some
    distance."""

    few_black: float = 0.18
    """Largest share of specks in safe or smooth terrain, "a low density of black spots"."""

    few_colour: float = 0.12
    """Largest share of specks in black; less than in colour, because one success in nine is not uniform black."""

    narrow: float = 0.4
    """Least share of narrow cells, in the window `majority`, in a narrow area."""

    coherence: float = 0.48
    """Least coherence of streaks. Independent cells have 0.19 +- 0.10 in the window `tensor`, straight lines 1."""

    uneven: float = 0.4
    """Least unevenness of speckle. Independent lengths, 12 to 22 periods apart, have 0.67 to 0.82, smooth ones 0."""

    jump: float = 2.0
    """A length is uneven where twice its distance from the line through its neighbours is more than this, in test
    intervals. Rounding to test intervals alone gives up to 2."""

    vote: float = 1.6
    """Window in which the most frequent kind is taken at the end: terrain is a property of an area, not of a cell."""


class Features(NamedTuple):
    """The features of a map, each (ny, nx).

    Attributes
    ----------
    known
        Whether the cell is computed.
    coloured
        Whether Helmholtz motion came.
    mostly
        Whether most cells near by are coloured.
    specks
        Share of cells near by that differ from most of their neighbours, 0 ... 1.
    narrow
        Share of cells near by in narrow areas, 0 ... 1.
    coherence
        Of the directions of the borders near by, 0 ... 1; 1 = one direction.
    direction
        Of the borders near by, radians from the x axis, counter-clockwise, 0 ... pi; cells are square.
    unevenness
        Share of three coloured cells in a row whose lengths are not on a line, 0 ... 1.
    """

    known: Mask
    coloured: Mask
    mostly: Mask
    specks: Floats
    narrow: Floats
    coherence: Floats
    direction: Floats
    unevenness: Floats


def terrain(transient_periods: ArrayLike, texture: Texture | None = None) -> NDArray[np.uint8]:
    """Return the terrain of every cell of a map.

    Parameters
    ----------
    transient_periods
        (ny, nx) periods until Helmholtz motion; 0 = never, NaN = not computed.
    texture
        Scales and limits; None: the default ones.

    Returns
    -------
    ndarray
        (ny, nx) uint8, indices into `TERRAINS`, or `UNKNOWN`.

    Raises
    ------
    ValueError
        Where the map has not two dimensions, or no cells.
    """
    texture = texture or Texture()
    return decide(features(transient_periods, texture), texture)


def decide(found: Features, texture: Texture) -> NDArray[np.uint8]:
    """Return the terrain that follows from features, (ny, nx) uint8."""
    if not found.known.any():
        return np.full(found.known.shape, UNKNOWN, np.uint8)
    specked = found.specks > np.where(found.mostly, texture.few_black, texture.few_colour)
    mixed = np.where(found.coherence > texture.coherence, STREAKY, SPECKLE)
    coloured = np.where(found.unevenness > texture.uneven, SAFE_SPECKLE, SMOOTH)
    solid = np.where(found.mostly, coloured, BLACK)
    first = np.where(specked | (found.narrow > texture.narrow), mixed, solid)
    near = _Near(found.known)
    votes = [near(first == kind, texture.vote) for kind in range(len(TERRAINS))]
    return np.where(found.known, np.argmax(votes, axis=0), UNKNOWN).astype(np.uint8)


def features(transient_periods: ArrayLike, texture: Texture | None = None) -> Features:
    """Return the features of a map; arguments as for :func:`terrain`.

    Raises
    ------
    ValueError
        Where the map has not two dimensions, or no cells.
    """
    texture = texture or Texture()
    lengths = np.asarray(transient_periods, float)
    if lengths.ndim != 2 or not lengths.size:
        raise ValueError(f"transient_periods: shape {lengths.shape}; should be (ny, nx), neither of them 0")
    known = ~np.isnan(lengths)
    coloured = known & (np.nan_to_num(lengths) > 0)
    near = _Near(known)
    mostly = near(coloured, texture.majority) > 0.5
    thin = np.where(mostly, ~_opened(mostly, texture.solid), ~_opened(~mostly, texture.solid))
    coherence, direction = _borders(coloured, near, texture)
    return Features(
        known,
        coloured,
        mostly,
        near(coloured != mostly, texture.window),
        near(thin, texture.majority),
        coherence,
        direction,
        _unevenness(np.where(coloured, lengths, 0.0), texture),
    )


def _sums(values: ArrayLike, sigma: float) -> Floats:
    return gaussian_sums(values, sigma, REACH)


class _Near:
    """Returns means over the known cells in a Gaussian window; 0 where there are none."""

    def __init__(self, known: Mask) -> None:
        self._known = known
        self._counts: dict[float, Floats] = {}

    def __call__(self, values: ArrayLike, sigma: float) -> Floats:
        if sigma not in self._counts:
            self._counts[sigma] = np.maximum(_sums(self._known, sigma), 1e-12)
        return _sums(np.where(self._known, values, 0.0), sigma) / self._counts[sigma]


def _opened(mask: Mask, radius: float) -> Mask:
    """Return the morphological opening of a mask with a disc: the cells that a disc inside the mask can cover.

    The mask is continued beyond the map with the values at the border, so that the border of the map is not a border of
    the mask. `radius` is in cells.
    """
    beyond = int(np.ceil(2 * radius))
    wide = np.pad(mask, beyond, mode="edge")
    covered = within(~within(~wide, radius), radius)
    ny, nx = mask.shape
    return np.asarray(mask & covered[beyond : beyond + ny, beyond : beyond + nx])


def _borders(coloured: Mask, near: _Near, texture: Texture) -> tuple[Floats, Floats]:
    """Return coherence and direction of the borders between colour and black, each (ny, nx).

    They come from the structure tensor, the mean product of the derivatives, minus the product of the mean derivatives.
    At the edge of a region all derivatives have one sign and cancel out; on the two sides of a streak they have
    opposite signs and remain. So a blurred edge is not a streak.
    """
    height = near(coloured, texture.slope)
    down, across = (
        np.gradient(height, axis=axis) if height.shape[axis] > 1 else np.zeros_like(height) for axis in (0, 1)
    )
    mean_x, mean_y = (near(slope, texture.tensor) for slope in (across, down))
    xx = near(across * across, texture.tensor) - mean_x * mean_x
    yy = near(down * down, texture.tensor) - mean_y * mean_y
    xy = near(across * down, texture.tensor) - mean_x * mean_y
    total = xx + yy
    coherence = np.where(total > 1e-9, np.hypot(xx - yy, 2 * xy) / np.maximum(total, 1e-9), 0.0)
    steepest = 0.5 * np.arctan2(2 * xy, xx - yy)
    return coherence, np.mod(steepest + np.pi / 2, np.pi)


def _unevenness(lengths: Floats, texture: Texture) -> Floats:
    """Return the share of three coloured cells in a row near by whose lengths are not on a line, (ny, nx)."""
    threes, uneven = np.zeros((2, *lengths.shape))
    for axis in (0, 1):
        row, counted, jumped = (np.moveaxis(array, axis, 0) for array in (lengths, threes, uneven))
        before, middle, after = row[:-2], row[1:-1], row[2:]
        whole = (before > 0) & (middle > 0) & (after > 0)
        counted[1:-1] += whole
        jumped[1:-1] += whole & (np.abs(before - 2 * middle + after) > texture.jump * CHUNK_PERIODS)
    return _sums(uneven, texture.lengths) / np.maximum(_sums(threes, texture.lengths), 1e-12)
