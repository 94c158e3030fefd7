"""The cells under inspection: which they are, and their latest five periods as on an oscilloscope. Plain arrays."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from .layers import Plane

MOST = 4
"""Cells shown; further ones are left out, there is no room to read them."""

COLOURS = ((255, 105, 85), (255, 255, 255), (255, 150, 220), (255, 190, 60))
"""One for each cell, apart from viridis and from each other."""

WIDTH, ROW, SWING = 128.0, 24.0, 8.0
"""A chunk is WIDTH units wide; rows are ROW apart, and a curve swings by SWING to either side of its middle."""


@dataclass(frozen=True, eq=False)
class Trace:
    """One chunk of one cell, ready to draw.

    Attributes
    ----------
    name
        Part of an entity path.
    label, caption
        The cell for people, with its parameters; and what the curve shows of it.
    curve
        (samples, 2) points, rows downwards.
    corner
        Where the caption goes.
    place
        The middle of the cell on the map's image.
    """

    number: int
    name: str
    label: str
    caption: str
    colour: tuple[int, int, int]
    curve: np.ndarray
    corner: tuple[float, float]
    place: tuple[float, float]


class Scope:
    """Gives each inspected cell its row and colour, in order of appearance.

    Attributes
    ----------
    cells
        Those shown so far, by row.
    left_out
        Cells for which there was no row.
    """

    def __init__(self) -> None:
        self.cells: list[int] = []
        self.left_out: set[int] = set()
        self._seen: set[tuple[int, int]] = set()

    def admit(self, cell: int) -> bool:
        """Return whether a cell has a row, giving it one if there is one left."""
        if cell in self.cells:
            return True
        if len(self.cells) == MOST:
            self.left_out.add(cell)
            return False
        self.cells.append(cell)
        return True

    def recall(self, names: Iterable[str]) -> None:
        """Give rows to the cells that an earlier incarnation showed, by the names of their traces."""
        for name in names:
            number = name.removeprefix("cell_")
            if number.isdecimal():
                self.admit(int(number))

    def is_new(self, cell: int, first_sample: int) -> bool:
        """Return whether this chunk comes for the first time; another attempt at a block brings the same bytes."""
        key = (cell, first_sample)
        new = key not in self._seen
        self._seen.add(key)
        return new

    def trace(self, plane: Plane, cell: int, first_sample: int, force: np.ndarray) -> Trace:
        """Return a chunk of an admitted cell as a curve.

        Parameters
        ----------
        plane
            The map that the cell is on.
        first_sample
            Of the chunk, since the start of the gesture.
        force
            (samples,) bridge force.
        """
        row = self.cells.index(cell)
        low, high = float(np.min(force)), float(np.max(force))
        middle = row * ROW + ROW / 2
        swing = (force - (low + high) / 2) / max(high - low, 1e-9) * 2 * SWING
        curve = np.column_stack([np.linspace(0, WIDTH, len(force)), middle - swing]).astype(np.float32)
        label = name_of(plane, cell)
        last = first_sample + len(force)
        iy, ix = divmod(cell, plane.shape[1])
        return Trace(
            number=row + 1,
            name=trace_name(cell),
            label=label,
            caption=f"{row + 1}   {label}   samples {first_sample} to {last}   force {low:.2f} to {high:.2f}",
            colour=COLOURS[row],
            curve=curve,
            corner=(WIDTH / 2, row * ROW - 1.5),
            place=(ix + 0.5, plane.shape[0] - iy - 0.5),
        )


def trace_name(cell: int) -> str:
    """Return the name of a cell's trace."""
    return f"cell_{cell}"


def name_of(plane: Plane, cell: int) -> str:
    """Return a cell with the values of its two parameters."""
    iy, ix = divmod(cell, plane.shape[1])
    if iy >= plane.shape[0]:
        return f"cell {cell}"
    return f"cell {cell}: {plane.x_name} {plane.x[ix]:.3g}, {plane.y_name} {plane.y[iy]:.3g}"
