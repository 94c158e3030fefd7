"""Directions of the streaks of a map, compared with the contours of initial bow force (Fig 12, section IV.B)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bow_sweep.maps.terrain import STREAKY, Features, Texture, decide, features

Floats = NDArray[np.float64]

CLOSE = 15.0
"""A streak follows a contour where their directions differ by at most this angle, degrees."""

PATCH = 8
"""Side of a patch, cells. Directions of neighbours are not independent, so the null hypothesis turns whole patches."""

DRAWS = 999
"""Number of random maps for each null hypothesis."""


@dataclass(frozen=True)
class Alignment:
    """Directions of the streaks of a map compared with those of lines in its plane.

    Attributes
    ----------
    cells
        Number of streaky cells.
    mean
        Mean of direction of the streak minus direction of the line, degrees, -90 ... 90, counter-clockwise where cells
        are square. It is the mean of doubled angles, because 0 and 180 degrees are one direction.
    error
        Standard error of the mean, degrees, by the jackknife over patches of `PATCH` by `PATCH` cells.
    spread
        Circular standard deviation of the difference, degrees.
    close
        Share of cells within `CLOSE` degrees of the line.
    turned
        The same share where every patch is turned by a random angle, mean of `DRAWS` draws; `CLOSE`/90 is expected.
    turned_p
        Probability of a share as great as `close` with turned patches.
    shuffled
        The same share where the directions of the streaks are permuted among the cells: these streaks have the right
        mean direction but do not bend with the lines.
    shuffled_p
        Probability of a share as great as `close` with permuted directions.
    """

    cells: int
    mean: float
    error: float
    spread: float
    close: float
    turned: float
    turned_p: float
    shuffled: float
    shuffled_p: float


def contour_directions(f_asym: ArrayLike, f_init_ratio: ArrayLike, left: float = 1.0) -> Floats:
    """Return the directions of the contours of bow force at every cell, in cells of the map.

    Bow force at a time t is ``f_asym (1 + (f_init/f_asym - 1) exp(-t/tau_f))``. At t = 0 its contours are those of
    Fig 12, "at later times [...] these contours tend towards vertical lines" (section IV.B).

    Parameters
    ----------
    f_asym, f_init_ratio
        (nx,) and (ny,) values of the axes; the first positive, the second not negative; two each at least.
    left
        exp(-t/tau_f), the rest of the transient of force: 1 at the start, 0 at the end.

    Returns
    -------
    ndarray
        (ny, nx) radians from the x axis, counter-clockwise, 0 ... pi; cells are square.

    Raises
    ------
    ValueError
        For other axes.
    """
    x, y = np.asarray(f_asym, float), np.asarray(f_init_ratio, float)
    if min(len(x), len(y)) < 2 or x.min() <= 0 or y.min() < 0:
        raise ValueError("axes: should be f_asym > 0 and f_init/f_asym >= 0, two values each at least")
    along_x = np.broadcast_to(left * np.gradient(y)[:, None], (len(y), len(x)))
    along_y = -np.maximum(1 + (y - 1) * left, 1e-12)[:, None] * np.gradient(np.log(x))[None]
    return np.mod(np.arctan2(along_y, along_x), np.pi)


def alignment(
    transient_periods: ArrayLike, lines: ArrayLike, texture: Texture | None = None, seed: int = 1
) -> Alignment | None:
    """Compare the directions of the streaks of a map with those of lines; None where it has no streaks.

    Parameters
    ----------
    transient_periods
        (ny, nx) periods; 0 = never, NaN = not computed.
    lines
        (ny, nx) directions in radians, see :func:`contour_directions`.
    seed
        Of the random numbers.
    """
    texture = texture or Texture()
    found = features(transient_periods, texture)
    chosen = streaks(found, texture)
    if not chosen.any():
        return None
    streak, line = found.direction[chosen], np.asarray(lines, float)[chosen]
    row, column = np.nonzero(chosen)
    patch = np.unique(row // PATCH * found.known.shape[1] + column // PATCH, return_inverse=True)[1].ravel()
    rng = np.random.default_rng(seed)
    angles = rng.uniform(0, np.pi, (DRAWS, int(patch.max()) + 1))
    turned = np.array([_close(streak + draw[patch] - line) for draw in angles])
    shuffled = np.array([_close(rng.permutation(streak) - line) for _ in range(DRAWS)])
    close = _close(streak - line)
    doubled = np.exp(2j * (streak - line))
    sums = np.bincount(patch, doubled.real) + 1j * np.bincount(patch, doubled.imag)
    mean = np.angle(sums.sum()) / 2
    left_out = _axial(np.angle(sums.sum() - sums) / 2 - mean)
    error = np.sqrt((len(sums) - 1) * np.mean(left_out**2)) if len(sums) > 1 else np.nan
    strength = min(max(abs(doubled.mean()), 1e-12), 1.0)
    return Alignment(
        cells=int(chosen.sum()),
        mean=float(np.degrees(mean)),
        error=float(np.degrees(error)),
        spread=float(np.degrees(np.sqrt(-2 * np.log(strength)) / 2)),
        close=close,
        turned=float(turned.mean()),
        turned_p=_chance(turned, close),
        shuffled=float(shuffled.mean()),
        shuffled_p=_chance(shuffled, close),
    )


def streaks(found: Features, texture: Texture) -> NDArray[np.bool_]:
    """Return the streaky cells whose borders have a direction, (ny, nx) bool."""
    return np.asarray((decide(found, texture) == STREAKY) & (found.coherence > texture.coherence))


def _axial(angle: Floats) -> Floats:
    """Return differences of directions within -pi/2 ... pi/2."""
    return np.mod(angle + np.pi / 2, np.pi) - np.pi / 2


def _close(difference: Floats) -> float:
    return float(np.mean(np.abs(_axial(difference)) <= np.radians(CLOSE)))


def _chance(draws: Floats, value: float) -> float:
    """Return the share of draws that are as great as a value; the value itself counts as a draw."""
    return float((np.sum(draws >= value) + 1) / (len(draws) + 1))
