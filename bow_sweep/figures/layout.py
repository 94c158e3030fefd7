"""A Matplotlib figure laid out in pixels: maps whose cells are whole dots, axes, colour bars, titles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import PcolorImage
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FixedFormatter, FixedLocator

from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sweep.figures.colours import transient_colours
from bow_sweep.maps.held_fixed import gesture_of, held_fixed, string_of
from bow_sweep.maps.limit_lines import drawn
from bow_sweep.maps.limits import LABELS
from bow_sweep.maps.plane import Plane

UNIT_DPI = 200
"""Lengths are pixels at this resolution."""


class Layout:
    """A figure whose parts are placed in pixels from its top left corner.

    Parameters
    ----------
    width, height
        Pixels of `UNIT_DPI`.
    dpi
        Dots an inch of the figure as a file.
    """

    def __init__(self, width: float, height: float, dpi: float) -> None:
        self.width, self.height = width, height
        self.figure = Figure(figsize=(width / UNIT_DPI, height / UNIT_DPI), dpi=dpi, facecolor="white")
        FigureCanvasAgg(self.figure)

    def axes(self, left: float, top: float, width: float, height: float) -> Axes:
        """Return new axes in a rectangle."""
        rectangle = (left / self.width, 1 - (top + height) / self.height, width / self.width, height / self.height)
        return self.figure.add_axes(rectangle)

    def text(self, left: float, top: float, text: str, **style: Any) -> None:
        """Write a text whose baseline is `top` below the upper edge of the figure."""
        self.figure.text(left / self.width, 1 - top / self.height, text, **style)

    def swatch(self, colour: Sequence[int], left: float, top: float, width: float, height: float) -> None:
        """Draw a rectangle of one colour with a frame."""
        corner = (left / self.width, 1 - (top + height) / self.height)
        patch = Rectangle(
            corner,
            width / self.width,
            height / self.height,
            transform=self.figure.transFigure,
            facecolor=tuple(np.array(colour) / 255),
            edgecolor=rcParams["axes.edgecolor"],
            linewidth=rcParams["axes.linewidth"],
        )
        self.figure.add_artist(patch)

    def bar(self, colours: np.ndarray, ends: tuple[float, float], left: float, top: float, *size: float) -> Axes:
        """Draw a colour bar with ticks on its right; `size` is width and height, the first colour is at the bottom."""
        bar = self.axes(left, top, *size)
        bar.imshow(colours[:, None], origin="lower", extent=(0, 1, *ends), aspect="auto", interpolation="nearest")
        bar.set_xticks([])
        bar.yaxis.set_label_position("right")
        bar.tick_params(axis="y", right=True, left=False, labelright=True, labelleft=False)
        return bar

    def length_bar(self, plane: Plane, left: float, top: float, *size: float) -> Axes:
        """Draw the colour bar of transient length: a band for each possible length."""
        lengths = lengths_of(plane)
        half = CHUNK_PERIODS / 2
        bar = self.bar(
            transient_colours(lengths, plane.periods), (lengths[0] - half, lengths[-1] + half), left, top, *size
        )
        step = next(step for step in (5, 10, 20, 50, 100, 200, 500, 1000, 10**7) if plane.periods / step <= 8)
        bar.set_yticks(np.unique([CHUNK_PERIODS, *np.arange(step, plane.periods + 1, step)]))
        bar.set_ylabel("transient length (periods)")
        return bar


def lengths_of(plane: Plane) -> np.ndarray:
    """Return the possible transient lengths, (lengths,) periods."""
    return np.arange(CHUNK_PERIODS, plane.periods + 1, CHUNK_PERIODS)


def cell_pixels(plane: Plane, size: tuple[int, int], dpi: float) -> tuple[float, float]:
    """Return a size near `size` for a map whose cells are whole dots at `dpi`; both in pixels of `UNIT_DPI`."""
    scale = dpi / UNIT_DPI
    ny, nx = plane.shape
    dots = [max(1, round(length * scale / count)) * count for length, count in zip(size, (nx, ny), strict=True)]
    return dots[0] / scale, dots[1] / scale


def paint(ax: Axes, plane: Plane, colours: np.ndarray) -> None:
    """Draw a map, a colour for each cell, (ny, nx, 3) uint8, and the ticks of its axes."""
    ny, nx = plane.shape
    # The dots are those of imshow(), but it would resample them in floating point.
    ax.add_image(PcolorImage(ax, np.arange(nx + 1), np.arange(ny + 1), colours))
    ax.set(xlim=(0, nx), ylim=(0, ny))
    for direction, axis in zip((ax.xaxis, ax.yaxis), plane.axes, strict=True):
        ticks = axis.ticks()
        labelled = [tick for tick in ticks if tick.text]
        direction.set_major_locator(FixedLocator([tick.position for tick in labelled]))
        direction.set_major_formatter(FixedFormatter([tick.text for tick in labelled]))
        direction.set_minor_locator(FixedLocator([tick.position for tick in ticks if not tick.text]))
    ax.tick_params(which="both", direction="out")


def label(ax: Axes, plane: Plane, x: str = "", y: str = "") -> None:
    """Write the titles of the axes: "full" with symbol and unit, "symbol" alone, or "" for none."""
    for kind, axis, write in ((x, plane.axes[0], ax.set_xlabel), (y, plane.axes[1], ax.set_ylabel)):
        title = axis.title(settings=plane.settings)
        if kind:
            write(title if kind == "full" else title.partition("  ")[2].partition("  (")[0] or title)


def draw_limits(ax: Axes, plane: Plane, labels: bool = True) -> None:
    """Draw the limits of theory over a map as lines, white within black so that they are seen on every colour."""
    outline = [withStroke(linewidth=3.2, foreground="black")]
    for each in drawn(plane):
        dashes: Literal["-", "--"] = "--" if each.limit.name in DASHED else "-"
        for run in each.runs:
            ax.add_line(Line2D(*run.T, color="white", linewidth=1.4, linestyle=dashes, path_effects=outline))
        if labels:
            words, (x, y) = LABELS[each.limit.name], each.label
            ax.text(
                x,
                y,
                words,
                color="white",
                fontsize=8,
                fontweight="bold",
                ha="center",
                va="center",
                path_effects=outline,
            )


DASHED = ("schelleng_min", "guettler_high")
"""Limits whose lines are broken, so that two of them are told apart without their labels."""

MADE_LETTERS = 115
"""Letters in a line below the title of a map."""


def titles(plane: Plane) -> tuple[str, list[str]]:
    """Return the title of a map, and lines with its grid and with what is the same in all cells."""
    held = held_fixed(plane)
    title = [string_of(plane), *(each.line(mathematics=True) for each in held if each.name == "v_mid")]
    ny, nx = plane.shape
    made = [f"{nx} \u00d7 {ny} gestures", f"{plane.periods:g} periods each"]
    if gesture := gesture_of(plane):
        made.insert(1, gesture)
    if "adaptive" in plane.values:
        made.append(f"{percent(float(plane.values['adaptive']))} simulated at most, the rest predicted")
    if "repeats" in plane.values:
        made.append(f"{plane.values['repeats']} repeats of each")
    rest = [each for each in held if each.name != "v_mid"]
    widths = [*map(len, made), *(len(each.line()) for each in rest)]
    lines, used = [made[0]], widths[0]
    for part, width in zip([*made[1:], *(each.line(mathematics=True) for each in rest)], widths[1:], strict=True):
        if used + width + 5 <= MADE_LETTERS:
            lines[-1], used = f"{lines[-1]}  \u00b7  {part}", used + width + 5
        else:
            lines, used = [*lines, part], width
    return ", ".join(title), lines


def percent(part: float, whole: float = 1.0) -> str:
    """Return a share as text, in percent."""
    return f"{100 * part / whole:.1f} %"
