"""Pictures of maps: one map with its regimes, its three tests (Fig 10), several maps together (Fig 11)."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from bow_sim.figures.page import MUTED, check_path, save, style
from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sim.protocol.verdict_fields import PENDING
from bow_sweep.figures.caption import wrapped_limits
from bow_sweep.figures.colours import BLACK, GREY, regime_legend, transient_colours, viridis
from bow_sweep.figures.layout import Layout, cell_pixels, lengths_of, percent, titles
from bow_sweep.figures.panel import draw_limits, label, paint, places
from bow_sweep.figures.reliability import draw_reliability
from bow_sweep.maps.map_file import MapFile, MapFileError
from bow_sweep.maps.plane import (
    NEVER,
    NOT_COMPUTED,
    TEST_LAYERS,
    TEST_RANGES,
    WANTED,
    Plane,
)
from bow_sweep.maps.reliability import Reliability

MAP_PIXELS = (1280, 640)
"""Size of the map in the main picture: 6.4 by 3.2 inches, two to one as in the paper."""

PANEL_PIXELS = (768, 384)
"""Size of each of several maps in a picture."""

LINE_PITCH = 34
"""Distance of two lines of text below a title, pixels."""

LIMIT_LETTERS = 115
"""Letters in a line about limits of theory; they are plain text, which is wider."""

WHITE = (255, 255, 255)

PANELS = {
    "correlation": "correlation of successive periods",
    "slips": "significant slips in five periods",
    "corners": "travelling corners in five periods",
    "helmholtz": "Helmholtz motion: all three tests passed",
}
"""The four panels of the paper's Fig 10."""


def load_fonts() -> None:
    """Load the fonts of text and formulas, which the first picture would otherwise wait for, 0.03 s."""
    with style():
        figure = Figure(figsize=(0.1, 0.1))
        figure.text(0, 0, r"text and $f_\mathrm{asym}$")
        figure.text(0, 0, "text", weight="bold")
        figure.savefig(io.BytesIO(), format="png")


def map_figure(plane: Plane, dpi: float) -> Figure:
    """Return the main picture: the map of transient lengths, a histogram of them, and the regimes at the last test.

    A map with repeats has its reliability below.
    """
    with style():
        width, height = cell_pixels(plane, MAP_PIXELS, dpi)
        small = cell_pixels(plane, (MAP_PIXELS[0] // 2, MAP_PIXELS[1] // 2), dpi)
        title, made = titles(plane)
        made += wrapped_limits(plane, LIMIT_LETTERS)
        left, top = 155, 116 + LINE_PITCH * len(made)
        below = top + height + 180
        repeated: Reliability | None = getattr(plane, "reliability", None)
        lower = small[1] + 160 if repeated is not None else 0
        layout = Layout(left + width + 420, below + small[1] + 125 + lower, dpi)
        layout.text(left, 62, title, fontsize=13, fontweight="bold")
        for number, line in enumerate(made):
            layout.text(left, 112 + number * LINE_PITCH, line, color=MUTED)
        share = f"Helmholtz motion in {percent(plane.helmholtz_fraction())} of the plane"
        layout.text(layout.width - 40, 62, share, fontsize=9.5, ha="right")
        along = places(plane)
        ax = layout.axes(left, top, width, height)
        paint(ax, plane, transient_colours(plane.transient_periods, plane.periods), along)
        label(ax, plane, "full", "full")
        draw_limits(ax, plane, along=along)
        _scale_with_counts(layout, plane, left + width + 36, top, height)

        ax = layout.axes(left, below, *small)
        paint(ax, plane, regime_picture(plane), along)
        ax.set_title("Regime at the last test", loc="left", fontsize=9)
        draw_limits(ax, plane, labels=False, along=along)
        label(ax, plane, "symbol", "symbol")
        _regime_legend(layout, plane, left + small[0] + 50, below)
        if repeated is not None:
            draw_reliability(layout, plane, repeated, left, below + lower, *small)
        if plane.run_id:
            where = f"run {plane.run_id}  \u00b7  sweep {plane.sweep_id}"
            layout.text(layout.width - 40, layout.height - 20, where, fontsize=5.5, color="0.5", ha="right")
    return layout.figure


def regime_picture(plane: Plane) -> np.ndarray:
    """Return the colour of each cell's regime, (ny, nx, 3) uint8; grey where there is no verdict."""
    table = np.full((PENDING + 1, 3), GREY, np.uint8)
    for code, _, colour in regime_legend(plane.regime_names):
        table[code] = colour
    return table[plane.regime]


def _scale_with_counts(layout: Layout, plane: Plane, left: float, top: float, height: float) -> None:
    """Draw the colour bar, a histogram of the lengths beside it, and black and grey below it."""
    mask = plane.mask()
    extras = [("never", BLACK, NEVER), ("not computed", GREY, NOT_COMPUTED)]
    extras = [extra for extra in extras if extra[2] == NEVER or (mask == extra[2]).any()]
    box, gap = 34, 22
    tall = height - len(extras) * (box + gap)
    bar = layout.length_bar(plane, left, top, 44, tall)
    lengths = lengths_of(plane)
    tests = np.ceil(plane.transient_periods / CHUNK_PERIODS) * CHUNK_PERIODS  # Guettler's transient has any length
    counts = np.array([(tests == length).sum() for length in lengths])
    beside = layout.axes(left + 172, top, 170, tall)
    colours = transient_colours(lengths, plane.periods) / 255
    beside.barh(lengths, counts, CHUNK_PERIODS, color=colours, edgecolor="0.4", linewidth=0.2)
    beside.set_ylim(*bar.get_ylim())
    beside.set_xlim(0, max(counts.max(initial=1), 1) * 1.05)
    beside.set_yticks([])
    beside.xaxis.tick_top()
    beside.xaxis.set_label_position("top")
    beside.set_xlabel("cells", fontsize=8)
    beside.spines[["bottom", "right"]].set_visible(False)
    beside.xaxis.set_major_locator(MaxNLocator(2, integer=True))
    beside.tick_params(axis="x", labelsize=7.5, pad=1)
    for row, (name, colour, code) in enumerate(extras):
        at = top + tall + gap + row * (box + gap)
        layout.swatch(colour, left, at, 44, box)
        layout.text(left + 58, at + box / 2, f"{name}  {percent((mask == code).mean())}", va="center")


def _regime_legend(layout: Layout, plane: Plane, left: float, top: float) -> None:
    """Draw a legend of the regimes with numbers and shares of cells."""
    counts = plane.regime_counts()
    rows = list(zip(regime_legend(plane.regime_names, "not computed"), counts, strict=True))
    if not counts[-1]:
        rows.pop()
    pitch = min(46.0, MAP_PIXELS[1] / 2 / max(len(rows), 1))
    for row, ((_, name, colour), count) in enumerate(rows):
        at = top + row * pitch
        layout.swatch(colour, left, at, 0.65 * pitch, 0.65 * pitch)
        middle = at + 0.33 * pitch
        layout.text(left + pitch, middle, name, va="center")
        layout.text(left + 430, middle, f"{count}", va="center", ha="right")
        layout.text(left + 570, middle, percent(count, plane.regime.size), va="center", ha="right")


def layer_colours(name: str, values: np.ndarray) -> np.ndarray:
    """Return the colours of the results of a test, (..., 3) uint8; grey for NaN."""
    values = np.asarray(values, float)
    low, high = TEST_RANGES[name]
    colours = viridis((np.nan_to_num(values) - low) / (high - low))
    colours[np.isnan(values)] = GREY
    return colours


def tests_figure(plane: Plane, layers: Mapping[str, np.ndarray], periods: int, dpi: float) -> Figure:
    """Return the paper's Fig 10: the results of the three tests and whether all passed, (ny, nx) each."""
    with style():
        width, height = cell_pixels(plane, PANEL_PIXELS, dpi)
        title, made = titles(plane)
        left, top, across, down = 135.0, 151.0 + LINE_PITCH * len(made), width + 300, height + 165
        layout = Layout(left + across + width + 190, top + down + height + 120, dpi)
        layout.text(left, 58, f"{title}: the tests after {periods} periods", fontsize=13, fontweight="bold")
        for number, line in enumerate(made):
            layout.text(left, 106 + number * LINE_PITCH, line, color=MUTED)
        not_computed = plane.mask() == NOT_COMPUTED
        for number, (name, words) in enumerate(PANELS.items()):
            row, column = divmod(number, 2)
            at = (left + column * across, top + row * down)
            ax = layout.axes(*at, width, height)
            if name == "helmholtz":
                colours = np.where(np.asarray(layers[name], bool)[..., None], WHITE, BLACK).astype(np.uint8)
                _pass_scale(layout, at[0] + width + 28, at[1])
            else:
                colours = layer_colours(name, layers[name])
                _layer_scale(layout, name, at[0] + width + 28, at[1], height)
            colours[not_computed] = GREY
            paint(ax, plane, colours)
            ax.set_title(f"({'abcd'[number]})  {words}", loc="left")
            label(ax, plane, "full" if row else "", "" if column else "symbol")
    return layout.figure


def _layer_scale(layout: Layout, name: str, left: float, top: float, height: float) -> None:
    """Draw the colour bar of a test; the result for Helmholtz motion is in bold."""
    low, high = TEST_RANGES[name]
    if name == "correlation":
        steps, ends = np.linspace(low, high, 256), (low, high)
        ticks = [float(value) for value in np.linspace(low, high, 6)]
        texts = [f"{value:.1f}" for value in ticks]
    else:
        steps, ends = np.arange(low, high + 1), (low - 0.5, high + 0.5)
        ticks = [float(value) for value in np.arange(low, high + 1, 5)]
        texts = [f"{value:g}" for value in ticks[:-1]] + [rf"$\geq${ticks[-1]:g}"]
    bar = layout.bar(layer_colours(name, steps), ends, left, top, 36, height)
    bar.set_yticks(ticks, texts)
    bar.get_yticklabels()[ticks.index(WANTED[name])].set_fontweight("bold")


def _pass_scale(layout: Layout, left: float, top: float) -> None:
    for row, (words, colour) in enumerate((("yes", WHITE), ("no", BLACK))):
        layout.swatch(colour, left, top + 48 * row, 36, 32)
        layout.text(left + 48, top + 48 * row + 16, words, va="center")


def maps_figure(planes: Sequence[tuple[str, Plane]], dpi: float) -> Figure:
    """Return maps in two columns with one scale of transient length, each with its title."""
    with style():
        longest = max((plane for _, plane in planes), key=lambda plane: plane.periods)
        sizes = [cell_pixels(plane, PANEL_PIXELS, dpi) for _, plane in planes]
        width, height = (max(size[side] for size in sizes) for side in (0, 1))
        left, top, across, down = 135.0, 70.0, width + 130, height + 115
        columns, rows = min(2, len(planes)), -(-len(planes) // 2)
        right, bottom = left + across * (columns - 1) + width, top + down * (rows - 1) + height
        layout = Layout(right + 230, bottom + 110, dpi)
        for number, (title, plane) in enumerate(planes):
            row, column = divmod(number, 2)
            ax = layout.axes(left + column * across, top + row * down, *sizes[number])
            paint(ax, plane, transient_colours(plane.transient_periods, longest.periods))
            ax.set_title(title, loc="left")
            ax.set_title(percent(plane.helmholtz_fraction()), loc="right", fontsize=8.5, color=MUTED)
            label(ax, plane, "full" if number + columns >= len(planes) else "", "" if column else "symbol")
        tall = min(bottom - top - 60, 900.0)
        layout.length_bar(longest, right + 45, top, 40, tall)
        layout.swatch(BLACK, right + 45, top + tall + 24, 40, 34)
        layout.text(right + 99, top + tall + 41, "never", va="center")
    return layout.figure


def draw_map(plane: Plane, path: str | Path, dpi: float = 200) -> None:
    """Draw transient length over the plane, as in the paper's Fig 11, and the regimes at the last test below.

    Parameters
    ----------
    plane
        A :class:`MapFile`, or a :class:`~bow_sweep.maps.plane.Snapshot` in the middle of a sweep.
    path
        Ends in .png, .svg or .pdf. Readers see the old file or the complete new one.
    dpi
        Dots an inch of a .png; width and height of a cell are whole numbers of dots.

    Raises
    ------
    FigureError
        For another suffix.
    """
    check_path(path)
    save(map_figure(plane, dpi), path)


def draw_tests(result: MapFile, path: str | Path, periods: int | None = None, dpi: float = 200) -> None:
    """Draw the three tests after `periods` (None: the last test) and whether all passed: the paper's Fig 10.

    Raises
    ------
    FigureError
        For another suffix than .png, .svg and .pdf.
    MapFileError
        Where no test was made after `periods`.
    """
    check_path(path)
    made = [int(length) for length in result.test_periods]
    periods = made[-1] if periods is None else periods
    if periods not in made:
        raise MapFileError(f"periods = {periods}: no test was made then, but after {_listed(made)}")
    index = made.index(periods)
    layers = {name: getattr(result, name)[index] for name in (*TEST_LAYERS, "helmholtz")}
    save(tests_figure(result, layers, periods, dpi), path)


def draw_maps(planes: Iterable[tuple[str, Plane]], path: str | Path, dpi: float = 200) -> None:
    """Draw several maps in two columns with one scale, as in the paper's Fig 11; `planes` are (title, map).

    Raises
    ------
    FigureError
        For another suffix than .png, .svg and .pdf.
    MapFileError
        For no maps.
    """
    check_path(path)
    listed = list(planes)
    if not listed:
        raise MapFileError("no maps to draw: should be at least one")
    save(maps_figure(listed, dpi), path)


def _listed(numbers: list[int]) -> str:
    return ", ".join(map(str, numbers if len(numbers) < 8 else [*numbers[:3], "...", numbers[-1]]))
