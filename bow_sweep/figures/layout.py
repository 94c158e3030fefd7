"""A Matplotlib figure laid out in pixels: maps whose cells are whole dots, axes, colour bars, titles."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context, rcParams
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sweep.figures.caption import gesture_text, held_texts, made_texts, units_text
from bow_sweep.figures.colours import transient_colours
from bow_sweep.figures.symbols import plain
from bow_sweep.maps.held_fixed import string_of
from bow_sweep.maps.plane import Plane

UNIT_DPI = 200
"""Lengths are pixels at this resolution."""


class Canvas(FigureCanvasAgg):
    """A canvas that keeps parsed formulas for the next figure: to parse them takes a quarter of the time of a map."""

    _parser: Any = None

    def get_renderer(self) -> Any:
        """Return the renderer, with the parser that was the first one's."""
        renderer: Any = super().get_renderer()
        Canvas._parser = renderer.mathtext_parser = Canvas._parser or renderer.mathtext_parser
        return renderer


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
        Canvas(self.figure)

    def axes(self, left: float, top: float, width: float, height: float) -> Axes:
        """Return new axes in a rectangle."""
        rectangle = (left / self.width, 1 - (top + height) / self.height, width / self.width, height / self.height)
        with rc_context({"axes.titley": 1.0}):  # else where a title has place is found out, even where there is none
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


MADE_LETTERS = 130
"""Letters in a line below the title of a map."""


def titles(plane: Plane) -> tuple[str, list[str]]:
    """Return the title of a map, and lines with its grid and with what is the same in all cells."""
    held = held_texts(plane)
    first = [text for text in held if r"v_\mathrm{mid}" in text][:1]
    made = made_texts(plane)
    if gesture := gesture_text(plane):
        made.insert(1, gesture)
    parts = [*made, *(text for text in held if text not in first), units_text(plane)]
    return ", ".join([string_of(plane), *first]), in_lines(filter(None, parts))


def in_lines(parts: Iterable[str]) -> list[str]:
    """Return texts in lines of at most `MADE_LETTERS`, with points between them."""
    lines: list[str] = []
    used = 0
    for part in parts:
        width = len(plain(part))
        if lines and used + width + 5 <= MADE_LETTERS:
            lines[-1], used = f"{lines[-1]}  \u00b7  {part}", used + width + 5
        else:
            lines, used = [*lines, part], width
    return lines


def percent(part: float, whole: float = 1.0) -> str:
    """Return a share as text, in percent."""
    return f"{100 * part / whole:.1f} %"
