"""Maps on paper, with Matplotlib: every cell one rectangle of whole pixels, sizes and fonts fit for print."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator, MaxNLocator

from bow_sim.model import CHUNK_PERIODS

from .layers import (
    BLACK,
    GREY,
    NEVER,
    NOT_COMPUTED,
    PENDING,
    TEST_RANGES,
    WANTED,
    Plane,
    regime_colours,
    regime_label,
    transient_colours,
    viridis,
)

UNIT_DPI = 200
"""Lengths below are pixels at this resolution."""

MAP_PIXELS = (1280, 640)
"""The map of the main picture: 6.4 by 3.2 inches, the paper's two to one."""

PANEL_PIXELS = (768, 384)
"""One of several maps on a page."""

WHITE = (255, 255, 255)

STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "mathtext.fontset": "dejavusans",
    "font.size": 8.5,
    "axes.titlesize": 9.5,
    "axes.labelsize": 9,
    "axes.linewidth": 0.7,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "xtick.minor.width": 0.5,
    "ytick.minor.width": 0.5,
    "svg.hashsalt": "bow",
    "pdf.fonttype": 42,
}
MUTED = "0.35"

MODEL_NAMES = {
    "stiff_cremer": "Stiff/Cremer",
    "delta_cremer": "Delta/Cremer",
    "raman": "Raman",
    "friedlander": "Friedlander",
    "rounded_corner": "Rounded-corner",
    "torsion_absorbed": "Torsion-absorbed",
}


class Sheet:
    """A figure laid out in pixels from its top left corner."""

    def __init__(self, width: float, height: float, dpi: float) -> None:
        self.scale = dpi / UNIT_DPI
        self.width, self.height = width, height
        self.figure = Figure(figsize=(width / UNIT_DPI, height / UNIT_DPI), dpi=dpi, facecolor="white")
        FigureCanvasAgg(self.figure)

    def axes(self, left: float, top: float, width: float, height: float) -> Axes:
        """Return axes over a rectangle."""
        rectangle = (left / self.width, 1 - (top + height) / self.height, width / self.width, height / self.height)
        return self.figure.add_axes(rectangle)

    def text(self, left: float, top: float, text: str, **style: Any) -> None:
        """Write with the baseline `top` below the upper edge."""
        self.figure.text(left / self.width, 1 - top / self.height, text, **style)


def style() -> AbstractContextManager[None]:
    """Return the settings of print, for as long as a figure is built."""
    return mpl.rc_context(STYLE)


def cell_pixels(plane: Plane, size: tuple[int, int], dpi: float) -> tuple[float, float]:
    """Return the size of a map near `size` whose cells are whole dots at `dpi`; both in pixels of `UNIT_DPI`."""
    scale = dpi / UNIT_DPI
    ny, nx = plane.shape
    dots = [max(1, round(length * scale / count)) * count for length, count in zip(size, (nx, ny), strict=True)]
    return dots[0] / scale, dots[1] / scale


def paint(ax: Axes, plane: Plane, colours: np.ndarray) -> None:
    """Fill axes with one colour a cell, (ny, nx, 3) uint8, and their ticks."""
    ny, nx = plane.shape
    ax.imshow(colours, origin="lower", extent=(0, nx, 0, ny), aspect="auto", interpolation="nearest")
    for direction, axis in zip((ax.xaxis, ax.yaxis), plane.axes, strict=True):
        ticks = axis.ticks()
        labelled = [tick for tick in ticks if tick.text]
        direction.set_major_locator(FixedLocator([tick.position for tick in labelled]))
        direction.set_major_formatter(FixedFormatter([tick.text for tick in labelled]))
        direction.set_minor_locator(FixedLocator([tick.position for tick in ticks if not tick.text]))
    ax.tick_params(which="both", direction="out")


def label(ax: Axes, plane: Plane) -> None:
    """Write the names of both axes."""
    x, y = plane.axes
    ax.set_xlabel(x.title(settings=plane.settings))
    ax.set_ylabel(y.title(settings=plane.settings))


def titles(plane: Plane) -> tuple[str, str]:
    """Return what a map is of, and how it was made."""
    given = plane.values
    model = MODEL_NAMES.get(given.get("model", ""), given.get("model", ""))
    shown = [f"{model} string"] if model else ["Map of the bowed string"]
    swept = (plane.x_name, plane.y_name)
    if "v_mid" in given and "v_mid" not in swept:
        shown.append(rf"$v_\mathrm{{mid}}$ = {_short(given['v_mid'])}")
    ny, nx = plane.shape
    made = [f"{nx} \u00d7 {ny} gestures", f"{plane.periods:g} periods each"]
    if "bow_bridge" in given and "period" in given and not {"bow_bridge", "period"} & set(swept):
        made.append(rf"$\beta$ = {given['bow_bridge']}/{given['period']}")
    if "tau_f" in given and "tau_f" not in swept:
        made.append(rf"$\tau_f$ = {_short(given['tau_f'])} samples")
    if "mu_s" in given and "mu_d" in given and not {"mu_s", "mu_d"} & set(swept):
        made.append(rf"$\mu_s$, $\mu_d$ = {_short(given['mu_s'])}, {_short(given['mu_d'])}")
    return ", ".join(shown), "  \u00b7  ".join(made)


def _short(number: str) -> str:
    try:
        return f"{float(number):g}".replace("-", "\u2212")
    except ValueError:
        return number


def _percent(part: float, whole: float) -> str:
    return f"{100 * part / whole:.1f} %"


def map_figure(plane: Plane, dpi: float) -> Figure:
    """Return the main picture: transient length, how often each occurs, and the regimes at the end."""
    with style():
        width, height = cell_pixels(plane, MAP_PIXELS, dpi)
        small_width, small_height = cell_pixels(plane, (MAP_PIXELS[0] // 2, MAP_PIXELS[1] // 2), dpi)
        left, top = 155, 150
        below = top + height + 180
        sheet = Sheet(left + width + 420, below + small_height + 125, dpi)
        title, made = titles(plane)
        sheet.text(left, 62, title, fontsize=13, fontweight="bold")
        sheet.text(left, 112, made, fontsize=8.5, color=MUTED)
        share = _percent(plane.helmholtz_fraction(), 1)
        sheet.text(sheet.width - 40, 62, f"Helmholtz motion in {share} of the plane", fontsize=9.5, ha="right")
        ax = sheet.axes(left, top, width, height)
        paint(ax, plane, transient_colours(plane.transient_periods, plane.periods))
        label(ax, plane)
        _transient_scale(sheet, plane, left + width + 36, top, height)

        small = sheet.axes(left, below, small_width, small_height)
        paint(small, plane, regime_picture(plane))
        small.set_title("Regime at the last test", loc="left", fontsize=9)
        small.set_xlabel(_symbol_only(plane.axes[0].title()))
        small.set_ylabel(_symbol_only(plane.axes[1].title()))
        _regime_legend(sheet, plane, left + small_width + 50, below)
        if plane.run_id:
            where = f"run {plane.run_id}  \u00b7  sweep {plane.sweep_id}"
            sheet.text(sheet.width - 40, sheet.height - 20, where, fontsize=5.5, color="0.5", ha="right")
    return sheet.figure


def _symbol_only(title: str) -> str:
    return title.partition("  ")[2].partition("  (")[0] or title


def regime_picture(plane: Plane) -> np.ndarray:
    """Return the colour of each cell's regime, (ny, nx, 3) uint8; grey where there is no verdict."""
    table = np.full((PENDING + 1, 3), GREY, np.uint8)
    colours = regime_colours(plane.regime_names)
    if colours:
        table[: len(colours)] = colours
    return table[plane.regime]


def _scale_lengths(plane: Plane) -> np.ndarray:
    """Return the transient lengths that can occur, (lengths,) periods."""
    return np.arange(CHUNK_PERIODS, plane.periods + 1, CHUNK_PERIODS)


def _scale_ticks(plane: Plane) -> np.ndarray:
    step = next(step for step in (5, 10, 20, 50, 100, 200, 500, 1000, 10**7) if plane.periods / step <= 8)
    return np.unique([CHUNK_PERIODS, *np.arange(step, plane.periods + 1, step)])


def _transient_scale(sheet: Sheet, plane: Plane, left: float, top: float, height: float) -> None:
    """Draw the colour bar, a band for each possible length, with the number of cells beside it."""
    lengths = _scale_lengths(plane)
    mask = plane.mask()
    extras = [("never", BLACK, NEVER), ("not computed", GREY, NOT_COMPUTED)]
    extras = [extra for extra in extras if extra[2] == NEVER or (mask == extra[2]).any()]
    box, gap = 34, 22
    tall = height - len(extras) * (box + gap)
    bar = sheet.axes(left, top, 44, tall)
    edges = (lengths[0] - CHUNK_PERIODS / 2, lengths[-1] + CHUNK_PERIODS / 2)
    colours = transient_colours(lengths, plane.periods)[:, None]
    bar.imshow(colours, origin="lower", extent=(0, 1, *edges), aspect="auto", interpolation="nearest")
    bar.set_xticks([])
    bar.yaxis.set_label_position("right")
    bar.set_yticks(_scale_ticks(plane))
    bar.tick_params(axis="y", right=True, left=False, labelright=True, labelleft=False)
    bar.set_ylabel("transient length (periods)")

    counts = np.array([(plane.transient_periods == length).sum() for length in lengths])
    beside = sheet.axes(left + 172, top, 170, tall)
    beside.barh(lengths, counts, CHUNK_PERIODS, color=colours[:, 0] / 255, edgecolor="0.4", linewidth=0.2)
    beside.set_ylim(*edges)
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
        _swatch(sheet, colour, left, at, 44, box)
        words = f"{name}  {_percent((mask == code).mean(), 1)}"
        sheet.text(left + 58, at + box / 2, words, va="center")


def _swatch(sheet: Sheet, colour: Sequence[int], left: float, top: float, width: float, height: float) -> None:
    patch = sheet.axes(left, top, width, height)
    patch.set_facecolor(tuple(np.array(colour) / 255))
    patch.set(xticks=[], yticks=[])


def _regime_legend(sheet: Sheet, plane: Plane, left: float, top: float) -> None:
    """List the regimes with their colours, numbers of cells and shares."""
    counts = plane.regime_counts()
    names = [regime_label(name) for name in plane.regime_names] + ["not computed"]
    rows = list(zip(names, [*regime_colours(plane.regime_names), GREY], counts, strict=True))
    if not counts[-1]:
        rows.pop()
    pitch = min(46.0, MAP_PIXELS[1] / 2 / max(len(rows), 1))
    for row, (name, colour, count) in enumerate(rows):
        at = top + row * pitch
        _swatch(sheet, colour, left, at, 0.65 * pitch, 0.65 * pitch)
        middle = at + 0.33 * pitch
        sheet.text(left + pitch, middle, name, va="center")
        sheet.text(left + 430, middle, f"{count}", va="center", ha="right")
        sheet.text(left + 570, middle, _percent(count, plane.regime.size), va="center", ha="right")


def test_colours(name: str, values: np.ndarray) -> np.ndarray:
    """Return the colours of one test's results, (..., 3) uint8; grey for NaN."""
    values = np.asarray(values, float)
    low, high = TEST_RANGES[name]
    colours = viridis((np.nan_to_num(values) - low) / (high - low))
    colours[np.isnan(values)] = GREY
    return colours


PANELS = {
    "correlation": "correlation of successive periods",
    "slips": "significant slips in five periods",
    "corners": "travelling corners in five periods",
    "helmholtz": "Helmholtz motion: all three tests passed",
}


def tests_figure(plane: Plane, layers: Mapping[str, np.ndarray], periods: int, dpi: float) -> Figure:
    """Return the paper's Fig 10: three tests and their verdict, (ny, nx) each, after some periods."""
    with style():
        width, height = cell_pixels(plane, PANEL_PIXELS, dpi)
        left, top, across, down = 135.0, 185.0, width + 300, height + 165
        sheet = Sheet(left + across + width + 190, top + down + height + 120, dpi)
        title, made = titles(plane)
        sheet.text(left, 58, f"{title}: the tests after {periods} periods", fontsize=13, fontweight="bold")
        sheet.text(left, 106, made, fontsize=8.5, color=MUTED)
        not_computed = plane.mask() == NOT_COMPUTED
        for number, (name, words) in enumerate(PANELS.items()):
            row, column = divmod(number, 2)
            at = (left + column * across, top + row * down)
            ax = sheet.axes(*at, width, height)
            if name == "helmholtz":
                colours = np.where(np.asarray(layers[name], bool)[..., None], WHITE, BLACK).astype(np.uint8)
                _pass_scale(sheet, at[0] + width + 28, at[1])
            else:
                colours = test_colours(name, layers[name])
                _test_scale(sheet, name, at[0] + width + 28, at[1], height)
            colours[not_computed] = GREY
            paint(ax, plane, colours)
            ax.set_title(f"({'abcd'[number]})  {words}", loc="left")
            if row:
                ax.set_xlabel(plane.axes[0].title(settings=plane.settings))
            if not column:
                ax.set_ylabel(plane.axes[1].title(settings=plane.settings))
    return sheet.figure


def _test_scale(sheet: Sheet, name: str, left: float, top: float, height: float) -> None:
    """Draw the colour bar of one test; what Helmholtz motion gives is marked."""
    bar = sheet.axes(left, top, 36, height)
    low, high = TEST_RANGES[name]
    if name == "correlation":
        steps, edges = np.linspace(low, high, 256), (low, high)
        ticks, texts = list(np.linspace(low, high, 6)), [f"{value:.1f}" for value in np.linspace(low, high, 6)]
    else:
        steps, edges = np.arange(low, high + 1), (low - 0.5, high + 0.5)
        ticks = [*np.arange(low, high + 1, 5)]
        texts = [f"{value:g}" for value in ticks[:-1]] + [rf"$\geq${ticks[-1]:g}"]
    bar.imshow(test_colours(name, steps)[:, None], origin="lower", extent=(0, 1, *edges), aspect="auto")
    bar.set_xticks([])
    bar.set_yticks(ticks, texts)
    bar.tick_params(axis="y", right=True, left=False, labelright=True, labelleft=False)
    if name in WANTED:
        bar.get_yticklabels()[ticks.index(WANTED[name])].set_fontweight("bold")


def _pass_scale(sheet: Sheet, left: float, top: float) -> None:
    for row, (words, colour) in enumerate((("yes", WHITE), ("no", BLACK))):
        _swatch(sheet, colour, left, top + 48 * row, 36, 32)
        sheet.text(left + 48, top + 48 * row + 16, words, va="center")


def maps_figure(planes: Sequence[tuple[str, Plane]], dpi: float) -> Figure:
    """Return maps two abreast on one scale of transient length, each under its title."""
    with style():
        longest = max((plane for _, plane in planes), key=lambda plane: plane.periods)
        sizes = [cell_pixels(plane, PANEL_PIXELS, dpi) for _, plane in planes]
        width, height = (max(size[side] for size in sizes) for side in (0, 1))
        left, top, across, down = 135.0, 70.0, width + 130, height + 115
        columns, rows = min(2, len(planes)), -(-len(planes) // 2)
        sheet = Sheet(left + across * (columns - 1) + width + 230, top + down * (rows - 1) + height + 110, dpi)
        for number, (title, plane) in enumerate(planes):
            row, column = divmod(number, 2)
            ax = sheet.axes(left + column * across, top + row * down, *sizes[number])
            paint(ax, plane, transient_colours(plane.transient_periods, longest.periods))
            ax.set_title(title, loc="left")
            ax.set_title(_percent(plane.helmholtz_fraction(), 1), loc="right", fontsize=8.5, color=MUTED)
            if number + columns >= len(planes):
                ax.set_xlabel(plane.axes[0].title(settings=plane.settings))
            if not column:
                ax.set_ylabel(_symbol_only(plane.axes[1].title()))
        _plain_scale(sheet, longest, left + across * (columns - 1) + width + 45, top, down * (rows - 1) + height)
    return sheet.figure


def _plain_scale(sheet: Sheet, plane: Plane, left: float, top: float, height: float) -> None:
    """Draw the colour bar alone, black for never below it."""
    lengths = _scale_lengths(plane)
    tall = min(height - 60, 900.0)
    bar = sheet.axes(left, top, 40, tall)
    edges = (lengths[0] - CHUNK_PERIODS / 2, lengths[-1] + CHUNK_PERIODS / 2)
    colours = transient_colours(lengths, plane.periods)[:, None]
    bar.imshow(colours, origin="lower", extent=(0, 1, *edges), aspect="auto", interpolation="nearest")
    bar.set_xticks([])
    bar.set_yticks(_scale_ticks(plane))
    bar.yaxis.set_label_position("right")
    bar.tick_params(axis="y", right=True, left=False, labelright=True, labelleft=False)
    bar.set_ylabel("transient length (periods)")
    _swatch(sheet, BLACK, left, top + tall + 24, 40, 34)
    sheet.text(left + 54, top + tall + 41, "never", va="center")
