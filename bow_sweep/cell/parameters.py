"""The parameters of the cells of a sweep."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from bow_sim.physics.kinds import with_values
from bow_sim.physics.parameters import Parameters
from bow_sim.protocol.sweep_spec import VALUES, Axis
from bow_sweep.cell.waveform import CellError

SLACK = 1e-6
"""Part of a cell by which a value may lie outside the plane."""


class Plane(Protocol):
    """What a sweep, or the outline of one, says of its cells."""

    @property
    def parameters(self) -> Parameters:
        """What all cells share."""

    @property
    def x(self) -> Axis:
        """The axis along x."""

    @property
    def y(self) -> Axis:
        """The axis along y."""

    def lanes(self, cells: np.ndarray) -> dict[str, np.ndarray]:
        """Return what differs between some cells, by name, (cells,) each."""


def lanes(plane: Plane, cells: np.ndarray) -> dict[str, np.ndarray]:
    """Return what differs between some cells, as simulators compute them: axes, and deviations of repeats."""
    return plane.lanes(np.asarray(cells, np.int64))


def parameters_of(plane: Plane, cell: int) -> Parameters:
    """Return everything that decides the waveform of a cell."""
    own = lanes(plane, np.array([cell]))
    return with_values(plane.parameters, {name: float(values[0]) for name, values in own.items()})


def place(name: str, value: float, values: np.ndarray, scale: str) -> int:
    """Return the index of the value of an axis that is nearest to one, in the scale of the axis.

    Raises
    ------
    CellError
        Where it lies more than half a step beyond the ends; of uneven values, half the step at that end.
    """
    grid = np.log(values) if scale == "log" else np.asarray(values, float)
    at = np.log(value) if scale == "log" and value > 0 else (value if scale != "log" else -np.inf)
    distance = np.abs(grid - at)
    index = int(np.argmin(distance)) if np.isfinite(at) else (0 if values[0] < values[-1] else len(values) - 1)
    step = abs(grid[-1] - grid[0]) / (len(grid) - 1) if len(grid) > 1 else 2e-3 * max(1.0, abs(grid[0]))
    if scale == VALUES and len(grid) > 1:
        between = min(grid[0], grid[-1]) <= at <= max(grid[0], grid[-1])
        step = np.inf if between else abs(grid[index] - grid[index + (1 if index == 0 else -1)])
    if not distance[index] <= (0.5 + SLACK) * step:
        low, high = sorted((float(values[0]), float(values[-1])))
        has = f"has {name} {low:g} only" if low == high else f"reaches from {low:g} to {high:g}"
        raise CellError(f"{name} = {value:g}: the map {has}; the nearest is {float(values[index]):g}")
    return index
