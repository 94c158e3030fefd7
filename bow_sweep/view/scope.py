"""The inspected cells: which have a row, and their latest five periods as a curve. Plain arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bow_sim.physics.parameters import FIELDS
from bow_sweep.maps.held_fixed import cell_name
from bow_sweep.maps.plane import Plane
from bow_sweep.view.decorations import HEIGHT, LINE, cell_centres, cell_size

MOST, MOST_CHOSEN = 6, 12
"""Number of cells shown of those that simulators publish, more would be too small to read; of those that somebody has
chosen while the sweep runs."""

COLOURS = (
    (255, 105, 85),
    (255, 255, 255),
    (255, 150, 220),
    (255, 190, 60),
    (150, 200, 255),
    (200, 255, 130),
)
"""Colours of the cells, different from viridis and from each other."""

WIDTH, ROW, SWING, CAPTION = 240.0, 36.0, 9.0, 15.0
"""Width of a chunk, distance of two rows, amplitude of a curve, and height of the caption above it, in units of its
view; at the usual size of the view two pixels are one unit."""

LETTER, PADDING = 3.3, 8.0
"""Width of a letter of a caption, and of its two margins, units."""


@dataclass(frozen=True, eq=False)
class Trace:
    """The curve of one chunk of one cell.

    Attributes
    ----------
    name
        Last part of an entity path.
    label, caption
        The cell and its parameters as text, for a legend and above the curve.
    curve
        (samples, 2) points; y points down.
    corner
        Middle of the upper edge of the caption.
    frame, place
        A frame around the cell in the image of the map, (5, 2), and the place of its number.
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
    """Gives each inspected cell a row and a colour, in the order in which they come.

    Attributes
    ----------
    cells
        The shown cells, by row.
    left_out
        Cells without a row.
    """

    def __init__(self) -> None:
        self.cells: list[int] = []
        self._chosen: set[int] = set()
        self.left_out: set[int] = set()

    def admit(self, cell: int) -> bool:
        """Return whether a cell has a row; gives it one if there is a free one."""
        if cell in self.cells:
            return True
        if len(self.cells) - len(self._chosen) == MOST:
            self.left_out.add(cell)
            return False
        self.cells.append(cell)
        return True

    def choose(self, cell: int) -> None:
        """Give a row to a cell that somebody has chosen, even if the others have none left."""
        if cell not in self.cells and len(self._chosen) < MOST_CHOSEN:
            self.cells.append(cell)
            self._chosen.add(cell)
            self.left_out.discard(cell)

    def recall(self, name: str) -> int | None:
        """Give a row to a cell of an earlier recording; return the cell, or None where there is no row for it.

        Parameters
        ----------
        name
            Name of its trace.
        """
        number = name.removeprefix("cell_")
        return int(number) if number.isdecimal() and self.admit(int(number)) else None

    def trace(self, plane: Plane, cell: int, force: np.ndarray) -> Trace:
        """Return the curve of a chunk of a cell that has a row.

        Parameters
        ----------
        plane
            The map of the cell.
        force
            (samples,) bridge force.
        """
        row = self.cells.index(cell)
        low, high = float(np.min(force)), float(np.max(force))
        middle = row * ROW + (CAPTION + ROW) / 2
        swing = (force - (low + high) / 2) / max(high - low, 1e-9) * 2 * SWING
        curve = np.column_stack([np.linspace(0, WIDTH, len(force)), middle - swing]).astype(np.float32)
        label = name_of(plane, cell)
        caption = f"{row + 1}   {label.partition(': ')[2] or label}"
        x, y = cell_centres(plane)[cell].tolist()
        wide, high = (size / 2 + 1 for size in cell_size(plane))  # one unit around the cell
        corners = [(x - wide, y - high), (x + wide, y - high), (x + wide, y + high), (x - wide, y + high)]
        return Trace(
            number=row + 1,
            name=trace_name(cell),
            label=label,
            caption=caption,
            colour=COLOURS[row % len(COLOURS)],
            curve=curve,
            corner=((LETTER * len(caption) + PADDING) / 2, row * ROW),
            frame=np.array([*corners, corners[0]], np.float32),
            place=(x, y + high if y < HEIGHT / 2 else y - high - LINE),  # towards the middle of the map
        )


def force_range(plane: Plane) -> tuple[float, float] | None:
    """Return a range that the bridge force hardly leaves, or None where the bow speed has no end.

    The ramp of Helmholtz motion rises by ``v_b/beta``, from about half of it below 0, and ripples come on top.
    """
    given = plane.values
    if given.get("gesture") == "guettler":
        return None
    least = {axis.name: float(axis.values.min()) for axis in plane.axes}
    most = {axis.name: float(axis.values.max()) for axis in plane.axes}
    bridge, period, v_b = (
        float(given.get(name, FIELDS[name].default))  # type: ignore[arg-type]  # a number's text
        for name in ("bow_bridge", "period", "v_b")
    )
    beta = least.get("beta", least.get("bow_bridge", bridge) / period)
    speed = most.get("v_b", v_b)
    return -0.8 * speed / beta, speed / beta


def trace_name(cell: int) -> str:
    """Return the name of a cell's trace."""
    return f"cell_{cell}"


def name_of(plane: Plane, cell: int) -> str:
    """Return a cell and the values of its two parameters with their units, as text."""
    if cell >= plane.regime.size:
        return f"cell {cell}"
    return f"cell {cell}: {cell_name(plane, cell)}"
