"""Terrain: which of the paper's five kinds lies around each cell of a map (section IV.B).

Section IV.B tells five kinds of terrain apart by eye: uniform black, smooth, two kinds of speckle, streaky. Here they
are told apart by four features of the picture of transient lengths, each a question that the paper's words ask:

=============  ==================================================================================
specks         how many cells near by are other than most of their neighbours
narrow         whether colour, or black, is too narrow here for a disc of radius `Texture.solid`
coherence      whether the borders between colour and black near by run in one direction
unevenness     how many coloured neighbours in a row have lengths that do not follow each other
=============  ==================================================================================

A cell with many specks or of a narrow part is *streaky* where borders run in one direction, and *speckle* (with black)
where they do not; among the others black is *black*, and colour is *smooth* or *safe speckle* by its unevenness.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bow_sim.physics.parameters import CHUNK_PERIODS

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

TERRAINS = ("black", "smooth", "safe_speckle", "speckle", "streaky")
"""Names of the codes. *safe_speckle* has few black cells and uneven lengths, *speckle* has coloured and black cells
interleaved without order, *streaky* with order."""

BLACK, SMOOTH, SAFE_SPECKLE, SPECKLE, STREAKY = range(len(TERRAINS))

UNKNOWN = 255
"""Terrain of a cell that is not computed."""

REACH = 3.0
"""A Gaussian window ends at this many standard deviations."""


@dataclass(frozen=True)
class Texture:
    """Scales and limits of the features; tuned on synthetic maps whose terrain is known (tests/classifier/terrains.py).

    Scales are in cells, since specks are single cells whatever the grid; they are standard deviations of Gaussian
    windows unless said. Limits are shares, 0 ... 1.
    """

    majority: float = 1.0
    """Window in which most cells decide what a cell's surroundings are: about nine cells, so that a speck is outvoted
    and a streak two cells wide is not."""

    window: float = 1.8
    """Window in which specks are counted: some twenty cells, as few as tell one black cell in five from one in ten."""

    solid: float = 5.0
    """Radius of the disc that fits into whatever is not narrow. The streaks of Fig 11(c) are up to ten cells apart."""

    slope: float = 0.8
    """Window of the derivatives that find borders: less than the narrowest streak, two cells."""

    tensor: float = 3.0
    """Window over which borders are compared in direction: a streak and both its neighbours."""

    lengths: float = 2.5
    """Window in which unevenness is counted; wider than `window`, as smooth terrain is to be smooth for a while."""

    few_black: float = 0.18
    """Most specks in safe or smooth terrain, "a low density of black spots"."""

    few_colour: float = 0.12
    """Most specks in black: fewer than in colour, as one success among eight failures is already no uniform black."""

    narrow: float = 0.4
    """Least share of narrow cells, in the window `majority`, that makes a place narrow."""

    coherence: float = 0.48
    """Least coherence of streaks. Independent cells give 0.19 +- 0.10 in the window `tensor`, straight lines 1."""

    uneven: float = 0.4
    """Least unevenness of speckle. Independent lengths, 12 to 22 periods apart, give 0.67 to 0.82, smooth ones 0."""

    jump: float = 2.0
    """Test intervals that a length must differ from the line through its neighbours, twice over, to count as uneven:
    rounding to intervals alone gives up to 2."""

    vote: float = 1.6
    """Window in which the kinds are voted on at the end: terrain is a property of a place, not of a cell."""


class Features(NamedTuple):
    """What the texture of a map is, each (ny, nx).

    Attributes
    ----------
    known
        Whether the cell is computed.
    coloured
        Whether Helmholtz motion came.
    mostly
        Whether most cells near by are coloured.
    specks
        Share of cells near by that are other than most of their neighbours, 0 ... 1.
    narrow
        Share of narrow cells near by, 0 ... 1.
    coherence
        Of the borders' directions near by, 0 ... 1.
    direction
        Along the borders near by, radians from the x axis, counter-clockwise in cells, 0 ... pi.
    unevenness
        Share of coloured neighbours in a row whose lengths do not follow each other, 0 ... 1.
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
    """Return the terrain around every cell of a map.

    Parameters
    ----------
    transient_periods
        (ny, nx) periods until Helmholtz motion; 0 = never, NaN = not computed.
    texture
        Scales and limits; the default ones unless given.

    Returns
    -------
    ndarray
        (ny, nx) uint8 codes of `TERRAINS`, or `UNKNOWN`.

    Raises
    ------
    ValueError
        Where the map is not a plane of cells.
    """
    texture = texture or Texture()
    return decide(features(transient_periods, texture), texture)


def decide(found: Features, texture: Texture) -> NDArray[np.uint8]:
    """Return the terrain that features amount to, (ny, nx) uint8."""
    if not found.known.any():
        return np.full(found.known.shape, UNKNOWN, np.uint8)
    specked = found.specks > np.where(found.mostly, texture.few_black, texture.few_colour)
    mixed = np.where(found.coherence > texture.coherence, STREAKY, SPECKLE)
    coloured = np.where(found.unevenness > texture.uneven, SAFE_SPECKLE, SMOOTH)
    solid = np.where(found.mostly, coloured, BLACK)
    first = np.where(specked | (found.narrow > texture.narrow), mixed, solid)
    votes = [_near(first == kind, found.known, texture.vote) for kind in range(len(TERRAINS))]
    return np.where(found.known, np.argmax(votes, axis=0), UNKNOWN).astype(np.uint8)


def features(transient_periods: ArrayLike, texture: Texture | None = None) -> Features:
    """Return the features of a map; arguments as for :func:`terrain`.

    Raises
    ------
    ValueError
        Where the map is not a plane of cells.
    """
    texture = texture or Texture()
    lengths = np.asarray(transient_periods, float)
    if lengths.ndim != 2 or not lengths.size:
        raise ValueError(f"transient_periods: shape {lengths.shape}; should be (ny, nx), neither of them 0")
    known = ~np.isnan(lengths)
    coloured = known & (np.nan_to_num(lengths) > 0)
    mostly = _near(coloured, known, texture.majority) > 0.5
    thin = np.where(mostly, ~_opened(mostly, texture.solid), ~_opened(~mostly, texture.solid))
    coherence, direction = _borders(coloured, known, texture)
    return Features(
        known,
        coloured,
        mostly,
        _near(coloured != mostly, known, texture.window),
        _near(thin, known, texture.majority),
        coherence,
        direction,
        _unevenness(np.where(coloured, lengths, 0.0), texture),
    )


def _blur(values: ArrayLike, sigma: float) -> Floats:
    """Return sums in a Gaussian window; there is nothing beyond the map."""
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(np.asarray(values, float), sigma, mode="constant", truncate=REACH))


def _near(values: ArrayLike, known: Mask, sigma: float) -> Floats:
    """Return means in a Gaussian window over the cells that are known; 0 where there is none."""
    return _blur(np.where(known, values, 0.0), sigma) / np.maximum(_blur(known, sigma), 1e-12)


def _opened(mask: Mask, radius: float) -> Mask:
    """Return the part of a mask that discs of a radius, in cells, cover without leaving it.

    The mask goes on beyond the map as it ends there, so that a border of the map is none of the mask.
    """
    from scipy.ndimage import distance_transform_edt

    beyond = int(np.ceil(2 * radius))
    wide = np.pad(mask, beyond, mode="edge")
    if wide.all():
        return mask
    inside = distance_transform_edt(wide) > radius
    if not inside.any():
        return np.zeros_like(mask)
    covered = distance_transform_edt(~inside) <= radius
    ny, nx = mask.shape
    return np.asarray(mask & covered[beyond : beyond + ny, beyond : beyond + nx])


def _borders(coloured: Mask, known: Mask, texture: Texture) -> tuple[Floats, Floats]:
    """Return coherence and direction of the borders between colour and black, each (ny, nx).

    From the structure tensor, the mean product of the derivatives, less the product of the mean derivatives: at the
    edge of a region all derivatives point the same way and cancel out, on the two sides of a streak they are opposite
    and stay. So a fuzzy edge is no streak.
    """
    height = _near(coloured, known, texture.slope)
    down, across = (
        np.gradient(height, axis=axis) if height.shape[axis] > 1 else np.zeros_like(height) for axis in (0, 1)
    )
    mean_x, mean_y = (_near(slope, known, texture.tensor) for slope in (across, down))
    xx = _near(across * across, known, texture.tensor) - mean_x * mean_x
    yy = _near(down * down, known, texture.tensor) - mean_y * mean_y
    xy = _near(across * down, known, texture.tensor) - mean_x * mean_y
    total = xx + yy
    coherence = np.where(total > 1e-9, np.hypot(xx - yy, 2 * xy) / np.maximum(total, 1e-9), 0.0)
    steepest = 0.5 * np.arctan2(2 * xy, xx - yy)
    return coherence, np.mod(steepest + np.pi / 2, np.pi)


def _unevenness(lengths: Floats, texture: Texture) -> Floats:
    """Return the share of coloured threes in a row near by whose middle is far from the line through its neighbours."""
    threes, uneven = np.zeros((2, *lengths.shape))
    for axis in (0, 1):
        row, counted, jumped = (np.moveaxis(array, axis, 0) for array in (lengths, threes, uneven))
        before, middle, after = row[:-2], row[1:-1], row[2:]
        whole = (before > 0) & (middle > 0) & (after > 0)
        counted[1:-1] += whole
        jumped[1:-1] += whole & (np.abs(before - 2 * middle + after) > texture.jump * CHUNK_PERIODS)
    return _blur(uneven, texture.lengths) / np.maximum(_blur(threes, texture.lengths), 1e-12)
