"""Playability: measures of how easy a string is to play (section IV.B).

The paper asks for measures "from the areas of the different types" of terrain, "a quick basis for comparison".
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bow_classifier.verdict.regimes import REGIMES
from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sweep.maps.terrain import TERRAINS, UNKNOWN, Texture, terrain
from bow_sweep.maps.windows import largest_area

SMALLEST = 8
"""Smallest side, in cells, of a grid that an uncertainty is computed from: narrower grids have no texture."""


class Measure(NamedTuple):
    """A measure of a map.

    Attributes
    ----------
    name
        Key in :func:`playability`.
    title
        For people.
    unit
        "" for a number, "%" for a share of the cells, "periods".
    """

    name: str
    title: str
    unit: str

    def text(self, value: float | None, error: float | None, signed: bool = False) -> str:
        """Return a value and its error in the unit of the measure, without the unit; "-" for None."""
        if value is None:
            return "-"
        scale, digits = (100, 1) if self.unit == "%" else (1, 3 if not self.unit else 1)
        shown = f"{value * scale:{'+' if signed else ''}.{digits}f}"
        return shown if error is None else f"{shown} ± {error * scale:.{digits}f}"


MEASURES = (
    Measure("helmholtz", "Helmholtz motion", "%"),
    Measure("largest_area", "largest contiguous area", "%"),
    Measure("median_transient", "transient, median", "periods"),
    Measure("spread_transient", "transient, spread", "periods"),
    Measure("boundary", "boundary, edges per cell", ""),
    Measure("black", "black", "%"),
    Measure("smooth", "smooth", "%"),
    Measure("safe_speckle", "speckle without black", "%"),
    Measure("speckle", "speckle with black", "%"),
    Measure("streaky", "streaky", "%"),
)
"""The measures in the order of tables; the last five are areas of terrain."""


def playability(
    transient_periods: ArrayLike,
    regime: ArrayLike | None = None,
    regime_names: Sequence[str] = REGIMES,
    texture: Texture | None = None,
) -> dict[str, Any]:
    """Return the playability of a map, in plain numbers for report.json.

    Cells that are not computed are left out of all measures.

    - *helmholtz*: share of cells in which Helmholtz motion came.
    - *largest_area*: the largest contiguous area of those, as a share of all cells; neighbours share an edge.
    - *median_transient*, *spread_transient*: median and interquartile range of their transient lengths, periods. A test
      finds motion that came at any time since the test before, so lengths are spread evenly over these five periods.
    - *boundary*: number of edges between a cell with and a cell without Helmholtz motion, per cell. A speck has four.
    - *black* ... *streaky*: shares of the kinds of terrain (:mod:`bow_sweep.maps.terrain`).

    Each measure is ``{"value": v, "error": e, "half_grid": h}``. The error is the uncertainty due to the position of
    the grid: the map is divided into four interleaved grids of every second cell along x and y, which are independent
    samples of the same plane. Each grid is measured, and the error is half the standard deviation of the four results.
    Their mean is *half_grid*. Its difference from *value* shows how much a measure depends on the density of the grid;
    boundary, area and terrain do. Both are None where a side of the four grids is below `SMALLEST` cells, and where a
    measure itself is None, such as the lengths of no transients.

    Parameters
    ----------
    transient_periods
        (ny, nx) periods; 0 = never, NaN = not computed.
    regime
        (ny, nx) codes at the last test. With it the result has *black_is*: for each kind of terrain the shares of the
        regimes among its black cells; shares below 1 % are left out.
    regime_names
        Names of the codes.
    texture
        Scales and limits of terrain; None: the default ones.

    Raises
    ------
    ValueError
        Where the map has not two dimensions, or no cells.
    """
    lengths = np.asarray(transient_periods, float)
    codes = terrain(lengths, texture)
    values = measure(lengths, codes)
    parts = [lengths[i::2, j::2] for i in (0, 1) for j in (0, 1)]
    errors: dict[str, float | None] = dict.fromkeys(values)
    means = errors.copy()
    if min(min(part.shape) for part in parts) >= SMALLEST:
        each = [measure(part, terrain(part, texture)) for part in parts]
        for name in errors:
            found = [part[name] for part in each if part[name] is not None]
            if len(found) == len(each):
                errors[name] = float(np.std(np.array(found, float), ddof=1) / 2)
                means[name] = float(np.mean(np.array(found, float)))
    result: dict[str, Any] = {"cells": int((codes != UNKNOWN).sum())}
    result |= {
        name: {"value": values[name], "error": errors[name], "half_grid": means[name]}
        for name in (m.name for m in MEASURES)
    }
    if regime is not None:
        result["black_is"] = black_is(lengths, codes, np.asarray(regime), regime_names)
    return result


def measure(transient_periods: ArrayLike, codes: NDArray[np.uint8]) -> dict[str, float | None]:
    """Return the values of the measures of a map; None where there is nothing to measure.

    Parameters
    ----------
    transient_periods, codes
        (ny, nx) each, as in :func:`playability` and from :func:`bow_sweep.maps.terrain.terrain`.
    """
    lengths = np.asarray(transient_periods, float)
    known = ~np.isnan(lengths)
    came = known & (np.nan_to_num(lengths) > 0)
    cells = int(known.sum())
    if not cells:
        return {entry.name: None for entry in MEASURES}
    low, median, high = quartiles(lengths[came]) if came.any() else (None, None, None)
    values: dict[str, float | None] = {
        "helmholtz": came.sum() / cells,
        "largest_area": largest_area(came) / cells,
        "median_transient": median,
        "spread_transient": None if high is None or low is None else high - low,
        "boundary": boundary(came, known) / cells,
        **{name: np.sum(codes == code) / cells for code, name in enumerate(TERRAINS)},
    }
    return {name: None if value is None else float(value) for name, value in values.items()}


def quartiles(lengths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the quartiles of transient lengths, (3,) periods; equal lengths are spread over the test interval before.

    Parameters
    ----------
    lengths
        (transients,) one or more; multiples of five periods, or Guettler's transients, which are taken as they are.
    """
    if np.any(lengths % CHUNK_PERIODS):
        return np.asarray(np.percentile(lengths, (25, 50, 75)))
    ordered = np.sort(lengths)
    _, first, counts = np.unique(ordered, return_index=True, return_counts=True)
    place = (np.arange(len(ordered)) - np.repeat(first, counts) + 0.5) / np.repeat(counts, counts)
    return np.asarray(np.percentile(ordered - CHUNK_PERIODS * (1 - place), (25, 50, 75)))


def boundary(came: NDArray[np.bool_], known: NDArray[np.bool_]) -> int:
    """Return the number of edges between a known cell with and a known neighbour without Helmholtz motion."""
    across = (came[:, 1:] != came[:, :-1]) & known[:, 1:] & known[:, :-1]
    along = (came[1:] != came[:-1]) & known[1:] & known[:-1]
    return int(across.sum() + along.sum())


def black_is(
    lengths: NDArray[np.float64], codes: NDArray[np.uint8], regime: NDArray[np.uint8], names: Sequence[str]
) -> dict[str, dict[str, float]]:
    """Return the regimes of the black cells of each kind of terrain: terrain -> regime -> share, the largest first."""
    result = {}
    for code, kind in enumerate(TERRAINS):
        inside = regime[(codes == code) & (lengths == 0)]
        if inside.size:
            counts = np.bincount(inside, minlength=len(names))[: len(names)] / inside.size
            shares = {name: round(float(share), 4) for name, share in zip(names, counts, strict=True) if share >= 0.01}
            result[kind] = dict(sorted(shares.items(), key=lambda item: -item[1]))
    return result
