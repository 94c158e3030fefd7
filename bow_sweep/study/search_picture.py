"""optimise.png: the values that a search found, map by map, and the measure against each parameter."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from bow_sim.figures.page import BLUE, DPI, INCHES, ORANGE, check_path, save, style
from bow_sweep.figures.symbols import label, symbol_of
from bow_sweep.maps.playability import MEASURES
from bow_sweep.study.picture import is_known, log_axis
from bow_sweep.study.search import HIGHEST, Search, Trial, best

PICTURE = "optimise.png"

COLUMNS = 3


def draw_search(search: Search, trials: Sequence[Trial], path: str | Path) -> None:
    """Draw a search into a file.

    Raises
    ------
    FigureError
        For another suffix than .png, .svg and .pdf.
    OSError
        Where the file cannot be written.
    """
    check_path(path)
    save(search_figure(search, trials), path)


def search_figure(search: Search, trials: Sequence[Trial]) -> Figure:
    """Return the picture of a search.

    Above are the values in the order of the maps, with the best so far; below, the measure against each parameter, and
    for two parameters their plane.
    """
    measure = next(each for each in MEASURES if each.name == search.measure)
    scale = 100 if measure.unit == "%" else 1
    values = np.array([np.nan if each.found.value is None else scale * each.found.value for each in trials])
    errors = np.array([0.0 if each.found.error is None else scale * each.found.error for each in trials])
    top = best(search, trials)
    panels = len(search.ranges) + (len(search.ranges) == 2)
    rows = -(-panels // COLUMNS)
    unit = f"  ({measure.unit.replace('%', '% of the plane')})" if measure.unit else ""
    with style():
        figure = Figure(figsize=(INCHES, 2.6 + 2.2 * rows), dpi=DPI, facecolor="white", layout="constrained")
        FigureCanvasAgg(figure)
        parts: Any = figure.subfigures(2, 1, height_ratios=(2.6, 2.2 * rows))
        above, below = parts
        words = f"Search for the {search.goal}: {measure.title}"
        above.suptitle(words, x=0.01, ha="left", fontsize=10, fontweight="bold")
        _course(above.subplots(), search, values, errors, top, measure.title + unit)
        axes = np.ravel(below.subplots(rows, min(panels, COLUMNS), squeeze=False))
        for ax in axes[panels:]:
            ax.set_axis_off()
        for ax, each in zip(axes, search.ranges, strict=False):
            places = np.array([float(trial.values[each.name]) for trial in trials])
            _scatter(ax, places, values, errors, top)
            ax.set_xlabel(_title(search, each.name), fontsize=8)
            ax.set_ylabel(measure.title + unit, fontsize=7.5)
            if each.scale == "log":
                log_axis(ax.xaxis, places)
        if len(search.ranges) == 2:
            _plane(axes[2], search, trials, values, top, measure.title + unit)
    return figure


def _course(ax: Axes, search: Search, values: np.ndarray, errors: np.ndarray, top: int | None, title: str) -> None:
    numbers = np.arange(1, len(values) + 1)
    ax.errorbar(numbers, values, yerr=errors, fmt="o", ms=3.5, lw=0.9, capsize=2, color=BLUE, mfc="white")
    if top is not None:
        so_far = np.fmax.accumulate(values) if search.goal == HIGHEST else np.fmin.accumulate(values)
        ax.plot(numbers, so_far, drawstyle="steps-post", lw=1.0, color=ORANGE, label="best so far")
        ax.plot(numbers[top], values[top], "o", ms=5, color=ORANGE, label="best")
        ax.legend(fontsize=7, frameon=False)
    ax.set_xlabel("map", fontsize=8)
    ax.set_ylabel(title, fontsize=7.5)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    _plain(ax)


def _scatter(ax: Axes, places: np.ndarray, values: np.ndarray, errors: np.ndarray, top: int | None) -> None:
    ax.errorbar(places, values, yerr=errors, fmt="o", ms=3.5, lw=0.9, capsize=2, color=BLUE, mfc="white")
    if top is not None:
        ax.plot(places[top], values[top], "o", ms=5, color=ORANGE)
    _plain(ax)


def _plane(ax: Axes, search: Search, trials: Sequence[Trial], values: np.ndarray, top: int | None, title: str) -> None:
    """Draw the places of the maps in the plane of two parameters, coloured by their values."""
    x, y = ([float(trial.values[each.name]) for trial in trials] for each in search.ranges)
    shown: Any = ax.scatter(x, y, c=values, s=22, cmap="viridis", edgecolor="0.3", linewidth=0.4, plotnonfinite=False)
    if top is not None:
        ax.plot(x[top], y[top], "o", ms=8, mfc="none", color=ORANGE, mew=1.4)
    axes: tuple[Any, Any] = (ax.xaxis, ax.yaxis)
    for each, axis, places in zip(search.ranges, axes, (x, y), strict=True):
        if each.scale == "log":
            log_axis(axis, np.array(places))
        axis.set_label_text(_title(search, each.name), fontsize=8)
    _plain(ax)
    bar = ax.figure.colorbar(shown, ax=ax, pad=0.02)
    bar.set_label(title, fontsize=6.5)
    bar.ax.tick_params(labelsize=6)


def _title(search: Search, name: str) -> str:
    if not is_known(name):
        return name
    settings = search.trial(0, {each.name: each.text(each.low) for each in search.ranges}).sweep.settings()
    return label(symbol_of(name, settings, [each.name for each in search.ranges]))


def _plain(ax: Axes) -> None:
    ax.tick_params(labelsize=7)
    ax.grid(lw=0.4, color="0.88")
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
