"""The cells under inspection: which they are, and their latest five periods as on an oscilloscope. Plain arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bow_sweep.maps.plane import Plane
from bow_sweep.view.decorations import unit_of

MOST = 6
"""Cells shown; further ones are left out, there is no room to read them."""

COLOURS = (
    (255, 105, 85),
    (255, 255, 255),
    (255, 150, 220),
    (255, 190, 60),
    (150, 200, 255),
    (200, 255, 130),
)
"""One for each cell, apart from viridis and from each other."""

WIDTH, ROW, SWING, MARGIN = 128.0, 22.0, 9.0, 80.0
"""A chunk is WIDTH units wide; rows are ROW apart, and a curve swings by SWING to either side of its middle. Captions
stand in a margin on the right."""


@dataclass(frozen=True, eq=False)
class Trace:
    """One chunk of one cell, ready to draw.

    Attributes
    ----------
    name
        Part of an entity path.
    label, caption
        The cell for people, with its parameters; and the same for beside the curve.
    curve
        (samples, 2) points, rows downwards.
    corner
        Where the caption goes: the middle of its upper edge.
    frame, place
        A frame around the cell on the map's image, (5, 2), and where its number goes.
    """

    number: int
    name: str
    label: str
    caption: str
    colour: tuple[int, int, int]
    curve: np.ndarray
    corner: tuple[float, float]
    frame: np.ndarray
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
        self._ends: set[tuple[int, int]] = set()

    def admit(self, cell: int) -> bool:
        """Return whether a cell has a row, giving it one if there is one left."""
        if cell in self.cells:
            return True
        if len(self.cells) == MOST:
            self.left_out.add(cell)
            return False
        self.cells.append(cell)
        return True

    def recall(self, name: str, end: int) -> None:
        """Give a row to a cell that an earlier incarnation showed up to a sample, by the name of its trace."""
        number = name.removeprefix("cell_")
        if number.isdecimal() and self.admit(int(number)):
            self._ends.add((int(number), end))

    def is_new(self, cell: int, first_sample: int) -> bool:
        """Return whether this chunk comes for the first time; another attempt at a block brings the same bytes."""
        key = (cell, first_sample)
        new = key not in self._seen
        self._seen.add(key)
        return new

    def continues(self, cell: int, first_sample: int, samples: int) -> bool:
        """Return whether the chunk before this one is there too: inspection is best effort, chunks can be lost."""
        self._ends.add((cell, first_sample + samples))
        return first_sample == 0 or (cell, first_sample) in self._ends

    def trace(self, plane: Plane, cell: int, force: np.ndarray) -> Trace:
        """Return a chunk of an admitted cell as a curve.

        Parameters
        ----------
        plane
            The map that the cell is on.
        force
            (samples,) bridge force.
        """
        row = self.cells.index(cell)
        low, high = float(np.min(force)), float(np.max(force))
        middle = row * ROW + ROW / 2
        swing = (force - (low + high) / 2) / max(high - low, 1e-9) * 2 * SWING
        curve = np.column_stack([np.linspace(0, WIDTH, len(force)), middle - swing]).astype(np.float32)
        label = name_of(plane, cell)
        iy, ix = divmod(cell, plane.shape[1])
        x, y, half = ix + 0.5, plane.shape[0] - iy - 0.5, 0.5 + unit_of(plane)
        corners = [(x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half)]
        return Trace(
            number=row + 1,
            name=trace_name(cell),
            label=label,
            caption=f"{row + 1}   {label.partition(': ')[2] or label}",
            colour=COLOURS[row],
            curve=curve,
            corner=(WIDTH + MARGIN / 2, middle - SWING / 2),
            frame=np.array([*corners, corners[0]], np.float32),
            place=(x, y + half),
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
