"""study.png: measures of playability against the parameters of a study, and all its maps, small."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatterMathtext, LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter

from bow_sim.figures.page import DPI, INCHES, MUTED, check_path, save, style
from bow_sim.physics.body import mode_setting
from bow_sim.physics.fields import as_number
from bow_sim.physics.instruments import SI
from bow_sim.physics.parameters import FIELDS
from bow_sweep.figures.colours import transient_colours, viridis
from bow_sweep.figures.panel import label as label_axes
from bow_sweep.figures.panel import paint
from bow_sweep.figures.symbols import label, symbol_of
from bow_sweep.maps.plane import MODEL_NAMES, Plane
from bow_sweep.maps.playability import Measure
from bow_sweep.study.over import Over
from bow_sweep.study.plan import Study, short
from bow_sweep.study.report import BY_NAME, Report, measured, significant

PICTURE = "study.png"

PANELS = ("helmholtz", "largest_area", "median_transient", "spread_transient", "boundary", "smooth")
"""Measures that are drawn, in two rows."""

COLUMNS = 6
"""Small maps beside each other, where only one parameter changes."""

WIDEST, MOST = 12, 96
"""Small maps beside each other, and in all, at most."""

NARROW_DECADES = 1.6

KEY = "bars: standard errors; filled: significantly different from the first map"

MOST_LINES = 8
"""Lines of a panel that have a colour and an entry in the legend each."""


def draw_study(study: Study, content: Report, planes: Sequence[Plane], path: str | Path) -> None:
    """Draw a study into a file.

    Parameters
    ----------
    content
        Its report.
    planes
        Its maps, in order.
    path
        Ends in .png, .svg or .pdf. Readers see the old file or the complete new one.

    Raises
    ------
    FigureError
        For another suffix.
    OSError
        Where the file cannot be written.
    """
    check_path(path)
    save(study_figure(study, content, planes), path)


def study_figure(study: Study, content: Report, planes: Sequence[Plane]) -> Figure:
    """Return the picture of a study; arguments as for :func:`draw_study`."""
    drawn = planes if len(planes) <= MOST else ()
    places, titles, rows = _grid(study) if drawn else ([], [], [])
    across = max((column for _, column in places), default=0) + 1
    down = max((row for row, _ in places), default=-1) + 1
    wide, tall = INCHES, 3.9
    small = (wide - 0.9) / max(across, 3) * 0.52 + (0.27 if not rows or across < 2 else 0.16)
    below = down * small + (0.5 if down else 0.0)
    with style():
        figure = Figure(figsize=(wide, 0.5 + tall + below), dpi=DPI, facecolor="white", layout="constrained")
        FigureCanvasAgg(figure)
        parts: Any = figure.subfigures(2, 1, height_ratios=(0.5 + tall, below)) if down else [figure]
        at: Any = {"x": 0.01, "ha": "left"}
        parts[0].suptitle(heading(study) + "\n", fontsize=10, fontweight="bold", **at)
        parts[0].text(y=1 - 0.36 / (0.5 + tall), s=KEY, fontsize=7, color=MUTED, **at)
        _measures(parts[0], study, content)
        if down:
            _maps(parts[1], drawn, places, titles, rows)
        else:
            figure.text(0.01, 0.0, f"{len(planes)} maps: too many to be drawn here", fontsize=7, color=MUTED)
    return figure


def heading(study: Study) -> str:
    """Return what a study is, in a line."""
    first = study.members[0].sweep.parameters.model
    if study.title:
        return study.title
    names = (over.name if not is_known(over.name) else symbol_of(over.name).words for over in study.overs)
    return f"{MODEL_NAMES.get(first, first)}: over {', '.join(names)}"


def parameter_title(study: Study, name: str) -> str:
    """Return the title of an axis along which a parameter changes, for Matplotlib."""
    if not is_known(name):
        return name
    return label(symbol_of(name, study.members[0].sweep.settings(), [over.name for over in study.overs]))


def is_known(name: str) -> bool:
    """Return whether a name is that of a parameter with a symbol."""
    return bool(name in FIELDS or name in SI or mode_setting(name))


def value_title(name: str, value: str) -> str:
    """Return what a further parameter is in a map, for Matplotlib: "symbol = value"."""
    if not is_known(name) or as_number(value) is None:
        return short(value)
    return f"${symbol_of(name).tex} = {_tex(value)}$"


def _tex(value: str) -> str:
    digits, e, power = short(value).partition("e")
    return f"{digits}\\times 10^{{{int(power)}}}".removeprefix("1\\times ") if e else digits


# ---- measures


def _measures(part: Any, study: Study, content: Report) -> None:
    axes = part.subplots(2, len(PANELS) // 2)
    for ax, name in zip(np.ravel(axes), PANELS, strict=True):
        _measure(ax, BY_NAME[name], study, content)
    for ax in axes[-1]:
        ax.set_xlabel(parameter_title(study, study.overs[0].name), fontsize=8)
    for ax in axes[0]:
        ax.tick_params(labelbottom=False)
    if len(study.overs) > 1 and axes[0, 0].get_legend_handles_labels()[0]:
        handles, labels = axes[0, 0].get_legend_handles_labels()
        part.legend(handles, labels, loc="outside right upper", fontsize=7, frameon=False)


def _measure(ax: Axes, measure: Measure, study: Study, content: Report) -> None:
    """Draw a measure with its errors: a line for each combination of the other parameters."""
    first = study.overs[0]
    places = positions(first)
    entries = np.reshape(np.arange(len(study.members)), (study.shape[0], -1))
    scale = 100 if measure.unit == "%" else 1
    lines = entries.shape[1]
    for line in range(lines):
        of = [content["maps"][index] for index in entries[:, line]]
        found = [measured(entry["playability"], measure.name) for entry in of]
        values = np.array([np.nan if each.value is None else scale * each.value for each in found])
        errors = np.array([0.0 if each.error is None else scale * each.error for each in found])
        colour = tuple(viridis(0.1 + 0.75 * line / max(lines - 1, 1)) / 255) if lines > 1 else "#1f4e79"
        ax.errorbar(places, values, yerr=errors, fmt="-", lw=1.0, elinewidth=0.9, capsize=2, color=colour)
        sure = np.array([_differs(content, entry["run"], measure.name) for entry in of])
        fixed = [value_title(name, str(value)) for name, value in of[0]["values"].items() if name != first.name]
        words = ", ".join(fixed) if lines <= MOST_LINES else "_"
        ax.plot(places[sure], values[sure], "o", ms=4, color=colour, label="_")
        ax.plot(places[~sure], values[~sure], "o", ms=4, color=colour, mfc="white", label="_")
        ax.plot([], [], "-", color=colour, label=words or "_")
    if first.numbers is None:
        ax.set_xticks(places, [short(value) for value in first.values], rotation=20 if len(places) > 3 else 0)
        ax.set_xlim(-0.4, len(places) - 0.6)
    elif first.is_log:
        log_axis(ax.xaxis, places)
    else:
        ax.xaxis.set_major_locator(MaxNLocator(4))
    ax.set_title(measure.title + (f"  ({measure.unit})" if measure.unit else ""), loc="left", fontsize=8)
    ax.yaxis.set_major_locator(MaxNLocator(4))
    ax.tick_params(labelsize=7)
    ax.grid(lw=0.4, color="0.88")
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)


def _differs(content: Report, run: str, name: str) -> bool:
    found = significant(content, "first", run)
    return name in found and found[name].significant


def log_axis(axis: Any, values: np.ndarray) -> None:
    """Make an axis logarithmic, with labels that have room: 1, 2, 5 in a range of few decades, else powers of ten."""
    axis.axes.set(**{f"{axis.axis_name}scale": "log"})
    narrow = np.ptp(np.log10(values)) < NARROW_DECADES if len(values) else True
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if narrow else (1,), numticks=12))
    axis.set_major_formatter(StrMethodFormatter("{x:g}") if narrow else LogFormatterMathtext())
    axis.set_minor_formatter(NullFormatter())


def positions(over: Over) -> np.ndarray:
    """Return where the values of a parameter are on an axis, (values,); texts follow each other."""
    numbers = over.numbers
    return np.arange(len(over.values), dtype=float) if numbers is None else numbers


# ---- maps


def _grid(study: Study) -> tuple[list[tuple[int, int]], list[str], list[str]]:
    """Return (row, column) of each map, a title for each, and titles of the rows where a row has its own."""
    values = [[value_title(over.name, value) for value in over.values] for over in study.overs]
    if len(study.overs) > 1 and study.shape[0] <= WIDEST:
        rest = list(itertools.product(*values[1:]))
        order = list(itertools.product(range(study.shape[0]), range(len(rest))))
        titles = [values[0][column] if row == 0 else "" for column, row in order]
        return [(row, column) for column, row in order], titles, [",\n".join(words) for words in rest]
    flat = [", ".join(words) for words in itertools.product(*values)]
    columns = min(len(flat), COLUMNS)
    return [divmod(number, columns) for number in range(len(flat))], flat, []


def _maps(
    part: Any, planes: Sequence[Plane], places: Sequence[tuple[int, int]], titles: Sequence[str], rows: Sequence[str]
) -> None:
    """Draw the maps in a grid, with one scale of transient length."""
    longest = max(plane.periods for plane in planes)
    grid = part.subplots(max(row for row, _ in places) + 1, max(column for _, column in places) + 1, squeeze=False)
    for ax in np.ravel(grid):
        ax.set_axis_off()
    last = max(row for row, _ in places)
    for plane, (row, column), title in zip(planes, places, titles, strict=True):
        ax = grid[row, column]
        ax.set_axis_on()
        paint(ax, plane, transient_colours(plane.transient_periods, longest))
        for image in ax.images:  # this kind of image has no extent for the layout
            image.set_in_layout(False)
        ax.tick_params(labelsize=4.5, length=1.5, which="both", width=0.4, pad=1)
        if column:
            ax.tick_params(labelleft=False)
        ax.set_title(title, fontsize=5.5, pad=2)
        label_axes(ax, plane, "symbol" if row == last else "", "symbol" if not column else "")
        ax.xaxis.label.set_size(6)
        ax.yaxis.label.set_size(6)
        if rows and not column:
            at: Any = {"xycoords": "axes fraction", "ha": "right", "va": "center"}
            ax.annotate(rows[row], (-0.38, 0.5), fontsize=5.5, rotation=90, **at)
    colours = transient_colours(np.linspace(1e-6, longest, 256), longest) / 255
    bar = part.colorbar(
        ScalarMappable(Normalize(0, longest), ListedColormap(colours)), ax=grid, shrink=0.9, aspect=30, pad=0.01
    )
    bar.set_label("transient length (periods); black: never", fontsize=6)
    bar.ax.tick_params(labelsize=5.5)
