"""A map in a panel of a figure: its cells, ticks, titles of the axes and limits of theory. All pictures have it.

Positions are in cells: cell i is from i to i + 1. Where the values of an axis are uneven (``x.values=``), cells reach
to the midpoints between their values, and positions are those of `Along`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.image import PcolorImage
from matplotlib.lines import Line2D
from matplotlib.path import Path
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FixedFormatter, FixedLocator

from bow_sim.physics.kinds import MODEL, model_name
from bow_sweep.figures.symbols import DASHED, limit_symbol, symbol_of
from bow_sweep.figures.symbols import label as axis_label
from bow_sweep.maps.axes import PlotAxis, Tick
from bow_sweep.maps.held_fixed import moving
from bow_sweep.maps.limit_lines import drawn
from bow_sweep.maps.plane import MODEL_NAMES, Plane

MOST_AREAS = 30_000
"""Largest number of rectangles in a vector file; a map with more is an image in it."""


UNDER = 0.12
"""By how much of the next cell an area in a vector file reaches under it, unless it is told otherwise."""


class Along:
    """Positions of the cells of an axis in a picture.

    Attributes
    ----------
    edges
        (cells + 1,) from 0 to the number of cells: whole numbers for even axes, linear or logarithmic; else the
        midpoints between values, on the scale on which they are more even.
    """

    def __init__(self, axis: PlotAxis) -> None:
        self.axis = axis
        count = axis.count
        self.edges = np.arange(count + 1.0)
        self.uneven = axis.scale != "log" and axis.name != MODEL and not _is_even(axis.values)
        if self.uneven:
            self.log, scaled = _evener(axis.values)
            middle = (scaled[1:] + scaled[:-1]) / 2
            edges = np.concatenate([[2 * scaled[0] - middle[0]], middle, [2 * scaled[-1] - middle[-1]]])
            self._scaled = (scaled - edges[0]) / (edges[-1] - edges[0]) * count
            self._ends = edges[[0, -1]]
            self.edges = (edges - edges[0]) / (edges[-1] - edges[0]) * count

    def at(self, cells: np.ndarray) -> np.ndarray:
        """Return the places of positions that are given in cells."""
        if not self.uneven:
            return np.asarray(cells, float)
        count = self.axis.count
        known = np.concatenate([[0.0], np.arange(count) + 0.5, [count]])
        return np.interp(cells, known, np.concatenate([[0.0], self._scaled, [count]]))

    def ticks(self) -> list[Tick]:
        """Return the ticks, with and without labels."""
        if self.axis.name == MODEL:
            names = [model_name(value) for value in self.axis.values]
            return [Tick(i + 0.5, MODEL_NAMES.get(name, name)) for i, name in enumerate(names)]
        if not self.uneven:
            return self.axis.ticks()
        first, last = self._ends
        steps = np.linspace(first, last, 257)
        even = PlotAxis(self.axis.name, 10**steps if self.log else steps, "log" if self.log else "linear")
        places = [(tick.position - 0.5) / 256 * self.axis.count for tick in even.ticks()]
        made = [Tick(place, tick.text) for place, tick in zip(places, even.ticks(), strict=True)]
        return [tick for tick in made if -1e-9 <= tick.position <= self.axis.count + 1e-9]


def _is_even(values: np.ndarray) -> bool:
    steps = np.diff(np.asarray(values, float))
    return len(steps) < 2 or bool(np.ptp(steps) <= 1e-6 * abs(steps).max())


def _evener(values: np.ndarray) -> tuple[bool, np.ndarray]:
    """Return whether values are more even on a logarithmic scale, and the values on the scale on which they are."""
    values = np.asarray(values, float)
    if values.min() > 0:
        steps, ratios = np.abs(np.diff(values)), np.abs(np.diff(np.log10(values)))
        if ratios.std() / ratios.mean() < steps.std() / steps.mean():
            return True, np.log10(values)
    return False, values


def places(plane: Plane) -> tuple[Along, Along]:
    """Return the positions of a map's cells along x and y."""
    x, y = plane.axes
    return Along(x), Along(y)


class Cells(PcolorImage):
    """The cells of a map: an image in a .png, whose dots have the exact colours, and areas in .pdf and .svg."""

    def __init__(self, ax: Axes, x: np.ndarray, y: np.ndarray, colours: np.ndarray, under: float = UNDER) -> None:
        super().__init__(ax, x, y, colours)
        self.under = under
        self.cells = colours, np.asarray(x, float), np.asarray(y, float)

    def draw(self, renderer: Any) -> None:
        """Draw the cells."""
        if renderer.option_scale_image():  # a renderer of lines and areas
            areas = areas_of(*self.cells, self.under)
            if len(areas) <= MOST_AREAS:
                self._draw_areas(renderer, areas)
                return
        super().draw(renderer)

    def _draw_areas(self, renderer: Any, areas: Sequence[tuple[Any, np.ndarray]]) -> None:
        renderer.open_group("cells")
        graphics = renderer.new_gc()
        graphics.set_clip_rectangle(self.axes.bbox)
        graphics.set_linewidth(0.0)
        transform = self.axes.transData
        for colour, corners in areas:
            renderer.draw_path(graphics, Path(corners, _CODES), transform, colour)
        graphics.restore()
        renderer.close_group("cells")
        self.stale = False


_CODES = np.array([Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY], Path.code_type)


def areas_of(
    colours: np.ndarray, x: np.ndarray, y: np.ndarray, under: float = UNDER
) -> list[tuple[tuple[float, float, float], np.ndarray]]:
    """Return a map as rectangles: colour in shares of 1, and corners, (5, 2). Neighbours in a row are one rectangle.

    They are to be drawn in this order, as each reaches under those to its right and above it: viewers leave light lines
    between areas that only touch.

    Parameters
    ----------
    colours
        (ny, nx, 3) uint8.
    x, y
        (nx + 1,) and (ny + 1,) edges of the cells.
    under
        By how much of the next cell an area reaches under it.
    """
    codes = colours.astype(np.int64) @ np.array([65536, 256, 1])
    differ = codes[:, 1:] != codes[:, :-1]
    beside = np.ones((len(codes), 1), bool)
    iy, first = np.nonzero(np.hstack([beside, differ]))
    last = np.nonzero(np.hstack([differ, beside]))[1] + 1
    wider, higher = (np.append(edges[:-1] + under * np.diff(edges), edges[-1]) for edges in (x, y))
    left, right, low, high = x[first], wider[last], y[iy], higher[iy + 1]
    corners = np.stack([left, low, right, low, right, high, left, high, left, low], axis=1).reshape(-1, 5, 2)
    shares = (colours[iy, first] / 255).tolist()
    return [(tuple(share), each) for share, each in zip(shares, corners, strict=True)]


def paint(ax: Axes, plane: Plane, colours: np.ndarray, along: tuple[Along, Along] | None = None) -> None:
    """Draw a map, a colour for each cell, (ny, nx, 3) uint8, and the ticks of its axes.

    Parameters
    ----------
    along
        Positions of the cells; None: all of one size.
    """
    ny, nx = plane.shape
    x, y = (along[0].edges, along[1].edges) if along else (np.arange(nx + 1), np.arange(ny + 1))
    # The dots are those of imshow(), but it would resample them in floating point.
    ax.add_image(Cells(ax, x, y, colours))
    ax.set(xlim=(0, nx), ylim=(0, ny))
    for number, direction in enumerate((ax.xaxis, ax.yaxis)):
        set_ticks(direction, along[number].ticks() if along else plane.axes[number].ticks())
    ax.tick_params(which="both", direction="out")


def set_ticks(direction: Any, ticks: Sequence[Tick]) -> None:
    """Set the ticks of a Matplotlib axis; those without text are minor."""
    labelled = [tick for tick in ticks if tick.text]
    direction.set_major_locator(FixedLocator([tick.position for tick in labelled]))
    direction.set_major_formatter(FixedFormatter([number(tick.text) for tick in labelled]))
    direction.set_minor_locator(FixedLocator([tick.position for tick in ticks if not tick.text]))


def draw_borders(ax: Axes, inside: np.ndarray, width: float, along: tuple[Along, Along]) -> None:
    """Draw black lines between cells that are `inside`, (ny, nx) bool, and others; `width` in points."""
    x, y = along[0].edges, along[1].edges
    beside, above = np.argwhere(inside[:, 1:] != inside[:, :-1]), np.argwhere(inside[1:] != inside[:-1])
    lines = [((x[ix + 1], y[iy]), (x[ix + 1], y[iy + 1])) for iy, ix in beside.tolist()]
    lines += [((x[ix], y[iy + 1]), (x[ix + 1], y[iy + 1])) for iy, ix in above.tolist()]
    ax.add_collection(LineCollection(lines, colors="black", linewidths=width))


def number(text: str) -> str:
    """Return a number as Matplotlib should write it: with a minus sign, and powers of ten as such."""
    found = re.fullmatch(r"(-?)([0-9.]+)e([+-][0-9]+)", text)
    if not found:
        return re.sub(r"^-(?=[0-9.])", "\N{MINUS SIGN}", text)
    head = "" if found[2] == "1" else rf"{found[2]}\times"
    return rf"${found[1]}{head}10^{{{int(found[3])}}}$"


def axis_titles(plane: Plane, words: bool) -> tuple[str, str]:
    """Return the titles of the axes of a map: symbol and unit, and before them what it is if `words`."""
    moved = moving(plane)
    x, y = (axis_label(symbol_of(name, plane.values, moved), words) for name in (plane.x_name, plane.y_name))
    return x, y


def label(ax: Axes, plane: Plane, x: str = "", y: str = "") -> None:
    """Write the titles of the axes: "full" with words, symbol and unit, "symbol" without words, or "" for none."""
    titles = {"full": axis_titles(plane, True), "symbol": axis_titles(plane, False)}
    if x:
        ax.set_xlabel(titles[x][0])
    if y:
        ax.set_ylabel(titles[y][1])


def draw_limits(
    ax: Axes,
    plane: Plane,
    labels: bool = True,
    width: float = 1.6,
    size: float = 10,
    along: tuple[Along, Along] | None = None,
) -> None:
    """Draw the limits of theory over a map as lines, white within black so that they are seen on every colour.

    Parameters
    ----------
    labels
        Whether to write their symbols beside them.
    width, size
        Of the white lines and of the labels, points.
    """
    x, y = along or (Along(plane.axes[0]), Along(plane.axes[1]))
    outline = [withStroke(linewidth=width + 1.3 * min(1.4, width), foreground="black")]
    around = [withStroke(linewidth=0.22 * size, foreground="black")]
    for each in drawn(plane):
        dashes: Literal["-", "--"] = "--" if each.limit.name in DASHED else "-"
        for run in each.runs:
            points = (x.at(run[:, 0]), y.at(run[:, 1])) if along else run.T
            ax.add_line(Line2D(*points, color="white", linewidth=width, linestyle=dashes, path_effects=outline))
        if labels:
            left, low = each.label
            if along:
                left, low = float(x.at(np.array(left))), float(y.at(np.array(low)))
            words = limit_symbol(each.limit.name)
            ax.text(
                left, low, f"${words}$", color="white", fontsize=size, ha="center", va="center", path_effects=around
            )
