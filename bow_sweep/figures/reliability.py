"""A map of how sure a map is: which share of the repeats of each cell ends as the cell itself (PHYSICS.md 15)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from bow_sim.figures.page import MUTED, check_path, save, style
from bow_sweep.figures.colours import BLACK, GREY, transient_colours, viridis
from bow_sweep.figures.layout import Layout, cell_pixels, percent, titles
from bow_sweep.figures.panel import draw_borders, label, paint, places
from bow_sweep.maps.map_file import MapFile
from bow_sweep.maps.plane import Plane
from bow_sweep.maps.reliability import RELIABLE, Reliability

PANEL_PIXELS = (896, 448)
"""Size of each map in the picture of the repeats."""

OUTLINE = "black"
"""Colour of the lines around reliable cells."""


def reliability_colours(shares: np.ndarray) -> np.ndarray:
    """Return the colours of shares 0 ... 1, (..., 3) uint8: the brighter, the surer; grey where not known."""
    colours = viridis(np.nan_to_num(shares))
    colours[np.isnan(shares)] = GREY
    return colours


def draw_reliability(layout: Layout, plane: Plane, found: Reliability, left: float, top: float, *size: float) -> None:
    """Draw the map of shares, with lines around the reliable cells, its scale, and what it says in numbers."""
    ax = layout.axes(left, top, *size)
    along = places(plane)
    paint(ax, plane, reliability_colours(found.reliability), along)
    draw_borders(ax, found.reliable, min(0.8, size[0] / found.reliable.shape[1] / 16), along)
    repeats, jitter = plane.values.get("repeats", "?"), float(plane.values.get("jitter", "nan"))
    ax.set_title(f"Reliability: {repeats} repeats of each cell, forces up to {100 * jitter:.4g} % off", loc="left")
    label(ax, plane, "symbol", "symbol")
    width, height = size
    steps = np.linspace(0, 1, 256)
    bar = layout.bar(reliability_colours(steps), (0, 1), left + width + 36, top, 30, height)
    bar.axhline(RELIABLE, color=OUTLINE, linewidth=1.2)
    bar.set_yticks([0, 0.25, 0.5, 0.75, RELIABLE, 1])
    bar.set_ylabel("share of repeats that end alike", fontsize=8)
    known, helmholtz = found.known, np.nan_to_num(plane.transient_periods) > 0
    rows = [("reliable (line): at least 90 %", found.reliable, known)]
    rows += [("of the cells with Helmholtz motion", found.reliable, known & helmholtz)]
    rows += [("all repeats alike", np.nan_to_num(found.reliability) == 1, known)]
    rows += [("not known", ~known, np.ones_like(known))] if not known.all() else []
    for row, (words, which, of) in enumerate(rows):
        at = top + 30 + 46 * row
        layout.text(left + width + 215, at, words, va="center")
        share = percent(float(which[of].mean())) if of.any() else "\u2013"
        layout.text(left + width + 730, at, share, va="center", ha="right")
    lengths = "cells with Helmholtz motion, 10th to 90th percentile of the transient:"
    layout.text(left + width + 215, top + 30 + 46 * len(rows) + 30, lengths, va="center", color=MUTED, fontsize=7.5)
    layout.text(left + width + 215, top + 30 + 46 * len(rows) + 68, _spread(found, known & helmholtz), va="center")


def _spread(found: Reliability, where: np.ndarray) -> str:
    """Return the median spread of transient lengths in some cells as text."""
    low, high = found.transient_low[where], found.transient_high[where]
    always = (low > 0) & (high > 0)
    if not always.any():
        return "\u2013"
    words = f"median {np.median((high - low)[always]):.3g} periods wide"
    never = percent(float(1 - always.mean()))
    return words if always.all() else f"{words}; in {never} some repeats never have it"


def repeats_figure(plane: MapFile, parting: np.ndarray | None, dpi: float) -> Figure:
    """Return maps of reliability, of the spread of transient lengths, and of the partings.

    Parameters
    ----------
    plane
        A map with repeats.
    parting
        (ny, nx) median over the repeats, periods, infinity = never; None: not known.
    """
    found = plane.reliability
    assert found is not None
    with style():
        size = cell_pixels(plane, PANEL_PIXELS, dpi)
        title, made = titles(plane)
        left, top, down = 155.0, 151.0 + 34 * len(made), size[1] + 165
        panels = 2 if parting is None else 3
        layout = Layout(left + size[0] + 1010, top + panels * down - 20, dpi)
        layout.text(left, 62, f"{title}: repeats", fontsize=13, fontweight="bold")
        for number, line in enumerate(made):
            layout.text(left, 112 + 34 * number, line, color=MUTED)
        draw_reliability(layout, plane, found, left, top, *size)
        low, high = found.transient_low, found.transient_high
        width = np.where((low > 0) & (high > 0), high - low, np.where(np.isnan(low), np.nan, np.inf))
        spread = "Spread of the transient, 10th to 90th percentile"
        _numbers(layout, plane, width, (spread, "width (periods)", "not in all repeats"), left, top + down, *size)
        if parting is not None:
            words = ("Parting of the motions, median over the repeats", "parting (periods)", "never")
            _numbers(layout, plane, parting, words, left, top + 2 * down, *size)
    return layout.figure


def draw_repeats(plane: MapFile, parting: np.ndarray | None, path: str | Path, dpi: float = 200) -> None:
    """Draw what repeats say of a map into a file, see :func:`repeats_figure`; readers see the old or the complete one.

    Raises
    ------
    FigureError
        For another suffix than .png, .svg and .pdf.
    """
    check_path(path)
    save(repeats_figure(plane, parting, dpi), path)


def _numbers(
    layout: Layout, plane: Plane, values: np.ndarray, words: tuple[str, str, str], left: float, top: float, *size: float
) -> None:
    """Draw a map of numbers from 0 to the length of a simulation: bright = small, black = infinity, grey = not known.

    `words` are the title, that of the scale, and what infinity means.
    """
    title, unit, infinite = words
    most = plane.periods
    colours = transient_colours(np.where(np.isinf(values), 0, np.maximum(values, most / 1000)), most)
    ax = layout.axes(left, top, *size)
    paint(ax, plane, colours)
    ax.set_title(title, loc="left")
    label(ax, plane, "symbol", "symbol")
    width, height = size
    steps = np.linspace(most / 256, most, 256)
    bar = layout.bar(transient_colours(steps, most), (0, most), left + width + 36, top, 30, height)
    bar.set_ylabel(unit, fontsize=8)
    never = np.isinf(values)
    known = ~np.isnan(values)
    layout.swatch(BLACK, left + width + 215, top + 13, 34, 34)
    share = percent(float(never[known].mean())) if known.any() else "\u2013"
    layout.text(left + width + 263, top + 30, f"{infinite}  {share}", va="center")
