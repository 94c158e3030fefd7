"""Measures of what the paper describes in a map: stripes, specks, streaks, limits of force (section IV)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sweep.maps import playability
from bow_sweep.maps.map_file import MapFile


def coloured(plane: MapFile) -> np.ndarray:
    """Return where Helmholtz motion came, (ny, nx) bool: the cells that are not black in Fig 11."""
    return np.asarray(np.nan_to_num(plane.transient_periods) > 0)


def explained(mask: np.ndarray, axis: str) -> float:
    """Return the share of the variance of a mask, (ny, nx), that its x alone, or its y alone, explains, 0 ... 1.

    A vertical stripe with sharp edges has 1 for x. A mask without variance has 0.
    """
    means = mask.mean(axis=0 if axis == "x" else 1)
    variance = mask.var()
    return float(means.var() / variance) if variance else 0.0


def largest_area(mask: np.ndarray) -> float:
    """Return the largest contiguous area of a mask as a share of the plane; neighbours share an edge."""
    return playability.largest_area(mask) / mask.size


def columns(mask: np.ndarray, share: float) -> slice:
    """Return the columns from the first to the last in which at least a share of the cells is coloured."""
    found = np.flatnonzero(mask.mean(axis=0) >= share)
    return slice(int(found[0]), int(found[-1]) + 1) if len(found) else slice(0, 0)


def black_share(mask: np.ndarray, share: float = 0.5) -> float:
    """Return the share of black in the coloured region: from the first to the last column that is half coloured."""
    core = mask[:, columns(mask, share)]
    return float(1 - core.mean()) if core.size else 1.0


def force_limit(plane: MapFile, share: float = 0.5) -> float:
    """Return the greatest x at which a share of the gestures succeed, as mean over three columns; NaN = nowhere."""
    filled = np.convolve(coloured(plane).mean(axis=0), np.ones(3) / 3, "same")
    found = np.flatnonzero(filled >= share)
    return float(plane.x[found[-1]]) if len(found) else float("nan")


def unevenness(lengths: np.ndarray) -> float:
    """Return the share of neighbouring coloured cells whose transients differ by more than one test interval.

    Parameters
    ----------
    lengths
        (ny, nx) periods; 0 or NaN for none.
    """
    lengths = np.nan_to_num(np.asarray(lengths, float))
    steps = []
    for one, other in ((lengths[:, 1:], lengths[:, :-1]), (lengths[1:], lengths[:-1])):
        steps.append(np.abs(one - other)[(one > 0) & (other > 0)])
    joined = np.concatenate(steps)
    return float(np.mean(joined > CHUNK_PERIODS)) if joined.size else 0.0


def flyback(plane: MapFile) -> np.ndarray:
    """Return where the last test found multiple flyback, (ny, nx) bool."""
    return np.asarray(plane.regime == plane.regime_names.index("multiple_flyback"))


def curvature(plane: MapFile, mask: np.ndarray, forces: tuple[float, float], exponents: Sequence[float]) -> list[float]:
    """Return the share of the variance of a mask that lines ``f_asym (f_init/f_asym)**p = const`` explain, for each p.

    p = 0 are vertical lines, p = 1 the contours of initial force in Fig 12. Streaks that bend like the contours but are
    steeper, because the force changes to f_asym later, are between.

    Parameters
    ----------
    forces
        Least and greatest f_asym. The lowest tenth of f_init/f_asym is left out: the lines are very close there.
    """
    x, y = np.meshgrid(plane.x, plane.y)
    inside = (x >= forces[0]) & (x <= forces[1]) & (y > 0.1 * plane.y.max())
    values = mask[inside].astype(float)
    if not values.size or not values.var():
        return [0.0 for _ in exponents]
    shares = []
    for p in exponents:
        line = np.log(x[inside]) + p * np.log(y[inside])
        order = np.argsort(line, kind="stable")
        bins = np.array_split(values[order], 60)  # of equal size, so that all exponents have equal chances
        shares.append(sum(len(b) * (b.mean() - values.mean()) ** 2 for b in bins) / len(values) / values.var())
    return [float(share) for share in shares]
