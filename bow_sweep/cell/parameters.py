"""The parameters of the cells of a sweep."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from bow_sim.physics.parameters import Parameters
from bow_sim.protocol.sweep_spec import Axis


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


def lanes(plane: Plane, cells: np.ndarray) -> dict[str, np.ndarray]:
    """Return the values of the two parameters of the axes at some cells, as the coordinator sends them."""
    iy, ix = np.divmod(np.asarray(cells, np.int64), plane.x.count)
    return {plane.x.name: plane.x.values()[ix], plane.y.name: plane.y.values()[iy]}


def parameters_of(plane: Plane, cell: int) -> Parameters:
    """Return everything that decides the waveform of a cell."""
    own = lanes(plane, np.array([cell]))
    return plane.parameters.replace(**{name: float(values[0]) for name, values in own.items()})
