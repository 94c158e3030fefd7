"""A figure whose parts are placed in inches from its top left corner, and the scales and names below its panels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from bow_sweep.figures.layers import LETTERS, Colour, Shown
from bow_sweep.figures.panel import Cells

TITLE, LABEL, TICKS, SMALL = 8.0, 8.0, 7.0, 6.8
"""Sizes of letters, points: titles of panels and axes, ticks, scales and names."""

BAR = 0.09
"""Height of the bar of a scale."""

_Name = tuple[str, Colour, str]


class Sheet:
    """A figure that grows downwards.

    Parameters
    ----------
    width
        Of the figure.
    factor
        On all sizes of letters and lines.
    dpi
        Dots an inch of a .png.
    """

    def __init__(self, width: float, factor: float, dpi: float) -> None:
        self.width, self.height, self.factor = width, 1.0, factor
        self.figure = Figure(figsize=(width, 1.0), dpi=dpi, facecolor="white")
        self._canvas = FigureCanvasAgg(self.figure)

    def grow(self, height: float) -> None:
        """Set the height; parts are placed after it."""
        self.height = height
        self.figure.set_size_inches(self.width, height)

    def size(self, text: str, size: float) -> tuple[float, float]:
        """Return width and height of a text; `size` of its letters in points, before the factor."""
        made = self.figure.text(0, 0, text, fontsize=size * self.factor)
        box = made.get_window_extent(self._canvas.get_renderer())
        made.remove()
        return box.width / self.figure.dpi, box.height / self.figure.dpi

    def axes(self, left: float, top: float, width: float, height: float) -> Axes:
        """Return new axes in a rectangle."""
        box = (left / self.width, 1 - (top + height) / self.height, width / self.width, height / self.height)
        return self.figure.add_axes(box)

    def text(self, left: float, top: float, text: str, **style: Any) -> None:
        """Write a text."""
        self.figure.text(left / self.width, 1 - top / self.height, text, **style)

    @property
    def line(self) -> float:
        """Height of a line of names."""
        return 1.44 * SMALL * self.factor / 72

    def strip_height(self, members: Sequence[Shown], width: float) -> float:
        """Return the height of what explains the colours of some panels."""
        if members[0].ends is None:
            return self.line * len(self._flow(names_of(members), width))
        letters = self.size("0", SMALL)[1] + self.size("Ag", SMALL)[1]
        return max(BAR * self.factor + letters + 0.09 * self.factor, self.line * len(names_of(members)))

    def strip(self, members: Sequence[Shown], left: float, top: float, width: float) -> None:
        """Draw what explains the colours of some panels: a scale with names beside it, or names alone."""
        found, f = members[0], self.factor
        names = names_of(members)
        if found.ends is None or found.bar is None:
            for row, entries in enumerate(self._flow(names, width)):
                for place, i in entries:
                    self._name(names[i], left + place, top + self.line * row)
            return
        beside = max((self.size(name, SMALL)[0] for name, _, _ in names), default=0.0)
        long = width - (beside + 0.42 * f if names else 0.0)
        bar = self.axes(left, top, long, BAR * f)
        bar.add_image(Cells(bar, np.linspace(*found.ends, len(found.bar) + 1), np.arange(2), found.bar[None], 4.0))
        bar.set(xlim=found.ends, ylim=(0, 1), yticks=[])
        bar.xaxis.set_major_locator(MaxNLocator(5 if long > 1.2 * f else 3))
        bar.tick_params(labelsize=SMALL * f, length=2 * f, pad=1.5 * f, width=0.6 * f)
        bar.set_xlabel(found.words, fontsize=SMALL * f, labelpad=1.0 * f)
        for row, entry in enumerate(names):
            self._name(entry, left + long + 0.18 * f, top - 0.01 * f + self.line * row)

    def _flow(self, names: Sequence[_Name], width: float) -> list[list[tuple[float, int]]]:
        """Return lines of names, place from the left and index of the name, in columns of the same width."""
        f = self.factor
        widest = max((self.size(name, SMALL)[0] for name, _, _ in names), default=0.0) + 0.30 * f
        columns = max(1, min(len(names), int((width + 0.1 * f) / widest)))
        pitch = max(widest, min(width / columns, 1.3 * widest))
        lines = -(-len(names) // columns)
        return [[(pitch * (i // lines), i) for i in range(line, len(names), lines)] for line in range(lines)]

    def _name(self, entry: _Name, left: float, top: float) -> None:
        """Draw a rectangle with its letter, and the name to the right of it."""
        name, colour, letter = entry
        f = self.factor
        wide, tall = 0.16 * f, 0.71 * self.line
        patch = Rectangle((left / self.width, 1 - (top + tall) / self.height), wide / self.width, tall / self.height,
                          transform=self.figure.transFigure, facecolor=share_of(colour), edgecolor="0.3",
                          linewidth=0.4 * f)  # fmt: skip
        self.figure.add_artist(patch)
        at: Any = {"va": "center_baseline", "fontsize": SMALL * f}
        self.text(left + wide / 2, top + tall / 2, letter, color=ink_on(colour), ha="center", **at)
        self.text(left + wide + 0.05 * f, top + tall / 2, name, **at)


def names_of(members: Sequence[Shown]) -> list[_Name]:
    """Return the names of several panels, each once; regimes in the order of `LETTERS`, "not computed" last."""
    found = {name: (name, colour, letter) for each in members for name, colour, letter in each.names}
    order = {letter: place for place, letter in enumerate(LETTERS.values())}
    return sorted(found.values(), key=lambda each: (each[0] == "not computed", order.get(each[2], 0)))


def share_of(colour: Colour) -> tuple[float, float, float]:
    """Return a colour in shares of 1, as Matplotlib has it."""
    red, green, blue = (channel / 255 for channel in colour)
    return red, green, blue


def ink_on(colour: Colour) -> str:
    """Return "black" or "white", what can be read on a colour."""
    return "white" if np.dot(colour, (0.299, 0.587, 0.114)) < 120 else "black"
