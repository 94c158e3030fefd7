"""Pictures of terrain: maps with their terrain beside them, and measures of playability with their errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from bow_sim.figures.page import BLUE, MUTED, check_path, save, style
from bow_sweep.figures.colours import BLACK, GREY, TERRAIN_COLOURS, transient_colours
from bow_sweep.figures.layout import Layout, cell_pixels, percent
from bow_sweep.figures.panel import label, paint
from bow_sweep.maps.compare import Compared
from bow_sweep.maps.plane import Plane, terrain_label
from bow_sweep.maps.playability import MEASURES, Measure
from bow_sweep.maps.terrain import TERRAINS, UNKNOWN

PANEL_PIXELS = (640, 320)
DPI = 200
PITCH = 46
"""Pixels from one run to the next in a panel of measures."""

NUMBERS = tuple(measure for measure in MEASURES if measure.name not in TERRAINS)

Panel = tuple[str, Plane, np.ndarray]
"""A title, a map and its terrain, (ny, nx) uint8."""


def terrain_colours(codes: np.ndarray) -> np.ndarray:
    """Return the colour of the terrain of each cell, (ny, nx, 3) uint8; grey where it is unknown."""
    lookup = np.full((UNKNOWN + 1, 3), GREY, np.uint8)
    lookup[: len(TERRAIN_COLOURS)] = TERRAIN_COLOURS
    return lookup[codes]


def draw_comparison(runs: Sequence[Compared], path: Path) -> None:
    """Draw maps, terrain and playability of several runs into a file.

    Raises
    ------
    FigureError
        For another suffix than .png, .svg and .pdf.
    OSError
        Where the file cannot be written.
    """
    check_path(path)
    panels = [(f"{each.name}   {each.title}", each.plane, each.codes) for each in runs]
    save(comparison(panels, [each.name for each in runs], [each.numbers for each in runs]), path)


def comparison(panels: Sequence[Panel], names: Sequence[str], numbers: Sequence[Mapping[str, Any]]) -> Figure:
    """Return maps one below the other, the terrain of each beside it, and measures of playability below.

    Parameters
    ----------
    panels
        One for each run.
    names
        Short names of the runs.
    numbers
        Results of :func:`bow_sweep.maps.playability.playability` for each.
    """
    longest = max((plane for _, plane, _ in panels), key=lambda plane: plane.periods)
    sizes = [cell_pixels(plane, PANEL_PIXELS, DPI) for _, plane, _ in panels]
    width, height = (max(size[side] for size in sizes) for side in (0, 1))
    left, top, across, down = 135.0, 105.0, width + 40, height + 75
    below = top + len(panels) * down + 135
    tall = PITCH * (len(panels) + 0.6)
    with style():
        layout = Layout(left + 2 * across + 190, below + 2 * tall + 215, DPI)
        layout.text(left, 38, "Transient length", fontsize=11, fontweight="bold")
        layout.text(left + across, 38, "Terrain", fontsize=11, fontweight="bold")
        for number, (title, plane, codes) in enumerate(panels):
            for column, colours in enumerate(
                (transient_colours(plane.transient_periods, longest.periods), terrain_colours(codes))
            ):
                ax = layout.axes(left + column * across, top + number * down, *sizes[number])
                paint(ax, plane, colours)
                label(ax, plane, "symbol" if number + 1 == len(panels) else "", "" if column else "symbol")
                if column:
                    ax.set_yticklabels([])
            layout.text(left, top + number * down - 12, title, fontsize=7.5, color=MUTED)
        _legends(layout, longest, left + 2 * across - 5, top, height)
        pitch = (2 * across - 40 + 30) / len(NUMBERS)
        for number, measure in enumerate(NUMBERS):
            _dots(layout, measure, numbers, names if not number else [], left + number * pitch, below, pitch - 30, tall)
        _areas(layout, names, numbers, left, below + tall + 125, 2 * across - 40, tall)
    return layout.figure


def _legends(layout: Layout, plane: Plane, left: float, top: float, height: float) -> None:
    """Draw the colour bar of transient length, and black below it."""
    layout.length_bar(plane, left, top, 36, height - 62).set_ylabel("periods")
    layout.swatch(BLACK, left, top + height - 34, 36, 30)
    layout.text(left + 48, top + height - 18, "never", va="center")


def _dots(
    layout: Layout,
    measure: Measure,
    numbers: Sequence[Mapping[str, Any]],
    names: Sequence[str],
    left: float,
    top: float,
    width: float,
    height: float,
) -> None:
    """Draw a measure of all runs with error bars; the first run is at the top."""
    ax = layout.axes(left, top, width, height)
    scale = 100 if measure.unit == "%" else 1
    end = 0.0
    for row, run in enumerate(numbers):
        value, error = run[measure.name]["value"], run[measure.name]["error"] or 0.0
        if value is not None:
            ax.errorbar(scale * value, row, xerr=scale * error, fmt="o", ms=4, lw=1.2, capsize=2.5, color=BLUE)
            end = max(end, scale * (value + error))
    ax.set_ylim(len(numbers) - 0.4, -0.6)
    ax.set_yticks(range(len(names)), names, fontsize=7)
    ax.set_xlim(0, 1.15 * end or 1.0)
    ax.xaxis.set_major_locator(MaxNLocator(3))
    ax.grid(axis="x", lw=0.4, color="0.85")
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
    words = measure.title.replace(", ", ",\n") if "," in measure.title else measure.title.replace(" area", "\narea")
    ax.set_title(words, fontsize=8, loc="left")
    ax.set_xlabel(measure.unit.replace("%", "% of the plane"), fontsize=7.5)
    ax.tick_params(labelsize=7)


def _areas(
    layout: Layout,
    names: Sequence[str],
    numbers: Sequence[Mapping[str, Any]],
    left: float,
    top: float,
    width: float,
    height: float,
) -> None:
    """Draw the areas of terrain as stacked bars with their shares, and a legend below."""
    ax = layout.axes(left, top, width, height)
    for row, run in enumerate(numbers):
        start = 0.0
        for kind, colour in zip(TERRAINS, TERRAIN_COLOURS, strict=True):
            share = run[kind]["value"] or 0.0
            ax.barh(row, share, 0.72, left=start, color=np.array(colour) / 255, edgecolor="white", linewidth=0.5)
            if share >= 0.06:
                ink = "white" if sum(colour) < 300 else "black"
                ax.text(start + share / 2, row, percent(share), ha="center", va="center", fontsize=6.5, color=ink)
            start += share
    ax.set(xlim=(0, 1), ylim=(len(numbers) - 0.4, -0.6), xticks=[])
    ax.set_yticks(range(len(names)), names, fontsize=7)
    ax.set_title("areas by terrain, shares of the plane", fontsize=8, loc="left")
    ax.spines[:].set_visible(False)
    _kinds(layout, left, top + height + 30, 7.5)


def terrain_figure(panels: Sequence[Panel]) -> Figure:
    """Return maps in two columns with the terrain of each to its right: the paper's Fig 11 and its terrain."""
    longest = max((plane for _, plane, _ in panels), key=lambda plane: plane.periods)
    width, height = cell_pixels(longest, (512, 256), DPI)
    left, top, across, down = 110.0, 60.0, width + 44, height + 80
    rows = -(-len(panels) // 2)
    with style():
        layout = Layout(left + 4 * across + 110, top + rows * down + 130, DPI)
        for number, (title, plane, codes) in enumerate(panels):
            row, column = divmod(number, 2)
            for side, colours in enumerate(
                (transient_colours(plane.transient_periods, longest.periods), terrain_colours(codes))
            ):
                at = left + (2 * column + side) * across + 40 * column
                ax = layout.axes(at, top + row * down, width, height)
                paint(ax, plane, colours)
                ax.tick_params(labelsize=7)
                if column or side:
                    ax.set_yticklabels([])
                label(ax, plane, "symbol" if row + 1 == rows else "", "" if column or side else "symbol")
                if not side:
                    ax.set_title(title, loc="left", fontsize=8.5)
        _kinds(layout, left, layout.height - 60, 8.5)
    return layout.figure


def _kinds(layout: Layout, left: float, top: float, size: float) -> None:
    """Draw a legend of the kinds of terrain in one row; `size` is that of the letters, points."""
    for kind, colour in zip(TERRAINS, TERRAIN_COLOURS, strict=True):
        layout.swatch(colour, left, top, 4 * size, 3.4 * size)
        layout.text(left + 5.5 * size, top + 1.7 * size, terrain_label(kind), va="center", fontsize=size)
        left += (11 + 1.75 * len(terrain_label(kind))) * size
