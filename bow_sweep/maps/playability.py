"""Playability: what a map says, in numbers, of how easy a string is to play (section IV.B).

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

SMALLEST = 8
"""Fewest cells a side of a grid that an uncertainty is taken from: narrower ones have no texture."""


class Measure(NamedTuple):
    """A measure of a map.

    Attributes
    ----------
    name
        Key in :func:`playability`.
    title
        In words.
    unit
        "" for a number, "%" for a share of the cells, "periods".
    more
        What more of it means: 1 easier to play, -1 harder, 0 neither by itself.
    """

    name: str
    title: str
    unit: str
    more: int

    def text(self, value: float | None, error: float | None, signed: bool = False) -> str:
        """Return a value and its error in the unit of the measure, without the unit; "-" for None."""
        if value is None:
            return "-"
        scale, digits = (100, 1) if self.unit == "%" else (1, 3 if not self.unit else 1)
        shown = f"{value * scale:{'+' if signed else ''}.{digits}f}"
        return shown if error is None else f"{shown} ± {error * scale:.{digits}f}"


MEASURES = (
    Measure("helmholtz", "Helmholtz motion", "%", 1),
    Measure("largest_area", "largest contiguous area", "%", 1),
    Measure("median_transient", "transient, median", "periods", -1),
    Measure("spread_transient", "transient, spread", "periods", -1),
    Measure("boundary", "boundary, edges per cell", "", -1),
    Measure("black", "black", "%", -1),
    Measure("smooth", "smooth", "%", 1),
    Measure("safe_speckle", "speckle without black", "%", 1),
    Measure("speckle", "speckle with black", "%", -1),
    Measure("streaky", "streaky", "%", -1),
)
"""The measures, in the order of tables; the last five are areas of terrain."""


def playability(
    transient_periods: ArrayLike,
    regime: ArrayLike | None = None,
    regime_names: Sequence[str] = REGIMES,
    texture: Texture | None = None,
) -> dict[str, Any]:
    """Return the playability of a map, in plain numbers for report.json.

    Cells that are not computed are left out of everything.

    - *helmholtz*: share of cells in which Helmholtz motion came.
    - *largest_area*: the largest contiguous area of those, as a share of all cells; neighbours share an edge.
    - *median_transient*, *spread_transient*: of their transient lengths, in periods; the spread is the distance from
      the lower to the upper quartile. Motion that is found by a test came at some time since the test before: lengths
      are taken as evenly spread over the five periods between.
    - *boundary*: edges between a cell with and a neighbour without Helmholtz motion, per cell. A speck has four.
    - *black* ... *streaky*: shares of the kinds of terrain (:mod:`bow_sweep.maps.terrain`).

    Each comes as ``{"value": v, "error": e, "half_grid": h}``. The error is the uncertainty due to where the grid's
    points happen to lie: the map is split into its four interleaved grids of every second cell along x and y, each is
    measured by itself, and half the standard deviation of the four is given, as the four are independent samples of the
    same plane. Their mean is *half_grid*: how it differs from *value* says how much a measure depends on the grid, as
    boundary, area and terrain do. Both are None where those grids are smaller than `SMALLEST` a side, and where a
    measure is None itself: lengths of no transients.

    Parameters
    ----------
    transient_periods
        (ny, nx) periods; 0 = never, NaN = not computed.
    regime
        (ny, nx) codes at the last test. Where given, *black_is* says which share of the black cells in each kind of
        terrain ended in each regime; regimes below 1 % are left out.
    regime_names
        What the codes mean.
    texture
        Scales and limits of terrain.

    Raises
    ------
    ValueError
        Where the map is not a plane of cells.
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
    """Return the measures of a map with its terrain, without uncertainties; None where there is nothing to measure.

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
    """Return the quartiles of transient lengths, (3,) periods, each length spread over the interval that it ends.

    Parameters
    ----------
    lengths
        (transients,) multiples of five periods; one at least.
    """
    ordered = np.sort(lengths)
    _, first, counts = np.unique(ordered, return_index=True, return_counts=True)
    place = (np.arange(len(ordered)) - np.repeat(first, counts) + 0.5) / np.repeat(counts, counts)
    return np.asarray(np.percentile(ordered - CHUNK_PERIODS * (1 - place), (25, 50, 75)))


def largest_area(came: NDArray[np.bool_]) -> int:
    """Return the number of cells in the largest contiguous area of a mask, (ny, nx); neighbours share an edge."""
    from scipy.ndimage import label

    areas, _ = label(came)
    return int(np.bincount(areas.ravel())[1:].max(initial=0))


def boundary(came: NDArray[np.bool_], known: NDArray[np.bool_]) -> int:
    """Return the number of edges between a known cell with and a known neighbour without Helmholtz motion."""
    across = (came[:, 1:] != came[:, :-1]) & known[:, 1:] & known[:, :-1]
    along = (came[1:] != came[:-1]) & known[1:] & known[:-1]
    return int(across.sum() + along.sum())


def black_is(
    lengths: NDArray[np.float64], codes: NDArray[np.uint8], regime: NDArray[np.uint8], names: Sequence[str]
) -> dict[str, dict[str, float]]:
    """Return what the black cells of each kind of terrain are: terrain -> regime -> share; see :func:`playability`."""
    result = {}
    for code, kind in enumerate(TERRAINS):
        inside = regime[(codes == code) & (lengths == 0)]
        if inside.size:
            counts = np.bincount(inside, minlength=len(names))[: len(names)] / inside.size
            shares = {name: round(float(share), 4) for name, share in zip(names, counts, strict=True) if share >= 0.01}
            result[kind] = dict(sorted(shares.items(), key=lambda item: -item[1]))
    return result
