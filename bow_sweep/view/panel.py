"""A diagram of two quantities for a viewer whose 2D views have no axes: frame, ticks and labels as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

WIDTH, HEIGHT = 160.0, 84.0
"""Size of the frame, units of the 2D view, which has the same scale in both directions."""

TICK = 1.6
LABEL_RISE = 2.6
"""Length of a tick, and distance from the middle of a label up to its upper edge, units."""

TICKS = 6
"""About how many labelled ticks an axis has."""


@dataclass(frozen=True)
class Panel:
    """A frame with axes. In the view x points right and y down; in the diagram y points up.

    Attributes
    ----------
    x, y
        (low, high) of the axes.
    x_title, y_title
        Quantity and unit.
    """

    x: tuple[float, float]
    y: tuple[float, float]
    x_title: str
    y_title: str

    def place(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the points of values in the view, (n, 2) float32; values outside are moved to the frame."""
        columns = []
        for values, (low, high), size in ((x, self.x, WIDTH), (y, self.y, HEIGHT)):
            columns.append(np.clip((np.asarray(values, float) - low) / (high - low), 0, 1) * size)
        return np.column_stack([columns[0], HEIGHT - columns[1]]).astype(np.float32)

    @property
    def bounds(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """((left, right), (top, bottom)) of all of it."""
        return (-22.0, WIDTH + 8.0), (-16.0, HEIGHT + 26.0)

    def lines(self) -> list[np.ndarray]:
        """Return frame and ticks, each (points, 2)."""
        frame = np.array([(0, 0), (WIDTH, 0), (WIDTH, HEIGHT), (0, HEIGHT), (0, 0)], np.float32)
        out = [frame]
        for value in ticks(self.x):
            ((at, _),) = self.place(np.array([value]), np.array([self.y[0]])).tolist()
            out.append(np.array([(at, HEIGHT), (at, HEIGHT + TICK)], np.float32))
        for value in ticks(self.y):
            ((_, at),) = self.place(np.array([self.x[0]]), np.array([value])).tolist()
            out.append(np.array([(-TICK, at), (0, at)], np.float32))
        return out

    def labels(self) -> list[tuple[float, float, str]]:
        """Return (x, y, text) of each label: the middle of its upper edge, as rerun places labels."""
        out = []
        for value in ticks(self.x):
            ((at, _),) = self.place(np.array([value]), np.array([self.y[0]])).tolist()
            out.append((at, HEIGHT + TICK, f"{value:g}"))
        for value in ticks(self.y):
            ((_, at),) = self.place(np.array([self.x[0]]), np.array([value])).tolist()
            out.append((-8.5, at - LABEL_RISE, f"{value:g}"))
        out.append((WIDTH / 2, HEIGHT + 12.5, self.x_title))
        out.append((WIDTH / 2, -14.0, self.y_title))
        return out


def ticks(limits: tuple[float, float]) -> list[float]:
    """Return round values within an axis."""
    from matplotlib.ticker import MaxNLocator

    low, high = limits
    slack = 1e-9 * (high - low)
    values = MaxNLocator(TICKS, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high)
    return [float(value) + 0.0 for value in values if low - slack <= value <= high + slack]


def limits_of(*values: np.ndarray, margin: float = 0.06) -> tuple[float, float]:
    """Return an axis that holds all values, with a margin on both sides."""
    joined = np.concatenate([np.ravel(np.asarray(some, float)) for some in values])
    low, high = float(joined.min()), float(joined.max())
    wide = (high - low) or max(abs(high), 1.0)
    return low - margin * wide, high + margin * wide
