"""The edges of a map: pairs of neighbouring cells of different outcome."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics.parameters import TYPES
from bow_sim.protocol.verdict_fields import PENDING
from bow_sweep.edges.motions import OUTCOMES
from bow_sweep.maps.axes import PlotAxis
from bow_sweep.maps.map_file import MapFile

ALONG = ("x", "y")


class EdgesError(ValueError):
    """Edges cannot be had as asked; the message says what, where, and what would be right."""


class NoEdges(EdgesError):
    """There is no edge where edges were asked for."""


@dataclass(frozen=True, eq=False)
class Boundary:
    """Edges of a map; arrays of shape (edges,).

    Attributes
    ----------
    along
        0 where the two cells are neighbours along x, 1 along y.
    ix, iy
        Place of the cell with the lower number.
    """

    along: NDArray[np.int64]
    ix: NDArray[np.int64]
    iy: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.along)

    def only(self, chosen: NDArray[np.int64]) -> Boundary:
        """Return some of the edges."""
        return Boundary(self.along[chosen], self.ix[chosen], self.iy[chosen])

    def ends(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """Return x of both cells and y of both cells: (low x, high x, low y, high y), (edges,) each."""
        across = self.along == 0
        return x[self.ix], x[self.ix + across], y[self.iy], y[self.iy + ~across]


def edges_of(found: MapFile, outcome: str, along: str = "both") -> Boundary:
    """Return the edges of a map.

    Parameters
    ----------
    found
        The map.
    outcome
        One of :data:`bow_sweep.edges.motions.OUTCOMES`.
    along
        "x", "y" or "both": where the neighbours of a cell are.

    Raises
    ------
    EdgesError
        Where no axis that was asked for can be bisected.
    NoEdges
        Where no two neighbours differ.
    """
    ways = [way for way in ALONG if along in (way, "both")]
    whole = {way: name for way in ways if TYPES.get(name := getattr(found, f"{way}_name")) is int}
    ways = [way for way in ways if way not in whole]
    if not ways:
        names = " and ".join(f"{way} ({name})" for way, name in whole.items())
        raise EdgesError(f"along {names}: has whole numbers only, between which nothing can be bisected")
    if outcome != "helmholtz" and found.regimes is None:
        raise EdgesError(f"outcome {outcome}: this map is of an older version and has no regimes; take helmholtz")
    regimes = found.regimes if found.regimes is not None else found.helmholtz.astype(np.uint8)
    value = OUTCOMES[outcome](regimes)
    known = found.regime != PENDING
    if found.simulated is not None:
        known &= found.simulated
    parts = []
    for number, way in enumerate(ALONG):
        axis = 1 - number
        if way in ways and value.shape[axis] > 1:
            differs = np.diff(value, axis=axis) != 0
            size = differs.shape[axis]
            both = np.take(known, range(size), axis) & np.take(known, range(1, size + 1), axis)
            iy, ix = np.nonzero(differs & both)
            parts.append((np.full(len(ix), number), ix, iy))
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)] if parts else [np.zeros(0, int)] * 3
    if not len(columns[0]):
        where = f"along {ways[0]}" if len(ways) == 1 else "along x or y"
        raise NoEdges(f"no two neighbouring cells {where} differ in outcome ({outcome}): there is no edge")
    return Boundary(*columns)


def nearest(edges: Boundary, axes: tuple[PlotAxis, PlotAxis], place: dict[str, float], count: int) -> NDArray[np.int64]:
    """Return the numbers of the edges whose middle is nearest to a place on the map, in cells; nearest first.

    Parameters
    ----------
    place
        Name of each axis of the map -> value.
    count
        How many, at most.

    Raises
    ------
    EdgesError
        For a name that is no axis of the map, or a value beyond it.
    """
    at = _positions(axes, place)
    middle = (edges.ix + 0.5 + 0.5 * (edges.along == 0), edges.iy + 0.5 + 0.5 * (edges.along == 1))
    squares = sum((m - at[axis.name]) ** 2 for m, axis in zip(middle, axes, strict=True))
    return np.argsort(squares, kind="stable")[:count]


def in_row(edges: Boundary, axes: tuple[PlotAxis, PlotAxis], place: dict[str, float]) -> NDArray[np.int64]:
    """Return the numbers of the edges in the row or column of cells that is nearest to a value of one axis.

    These are the edges between cells of that row.

    Raises
    ------
    EdgesError
        For a name that is no axis of the map, or a value beyond it.
    NoEdges
        Where the row has none.
    """
    ((name, position),) = _positions(axes, place).items()
    number = [axis.name for axis in axes].index(name)
    row = int(np.clip(np.floor(position), 0, axes[number].count - 1))
    found = np.flatnonzero(((edges.ix, edges.iy)[number] == row) & (edges.along == 1 - number))
    if not len(found):
        raise NoEdges(f"no two neighbouring cells with {name} = {axes[number].values[row]:g} differ in outcome")
    return found


def _positions(axes: tuple[PlotAxis, PlotAxis], place: dict[str, float]) -> dict[str, float]:
    """Return positions of values on their axes, in cells."""
    by_name = {axis.name: axis for axis in axes}
    positions = {}
    for name, value in place.items():
        if name not in by_name:
            raise EdgesError(f"{name} = {value:g}: is no axis of this map; it has {' and '.join(by_name)}")
        axis = by_name[name]
        low, high = sorted((float(axis.values[0]), float(axis.values[-1])))
        position = axis.position(value) if axis.scale != "log" or value > 0 else -1.0
        if axis.count == 1 and not math.isclose(value, low, rel_tol=1e-3):
            raise EdgesError(f"{name} = {value:g}: the map has {low:g} only")
        if not 0 <= position <= axis.count:
            raise EdgesError(f"{name} = {value:g}: the map reaches from {low:g} to {high:g}")
        positions[name] = position
    return positions


def spread(count: int, limit: int) -> NDArray[np.int64]:
    """Return `limit` of `count` numbers, evenly spread."""
    if limit >= count:
        return np.arange(count)
    return np.unique(np.linspace(0, count - 1, limit).round().astype(np.int64))
