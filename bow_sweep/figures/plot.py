"""A figure for a paper: one or several maps as panels, with the scales that they share.

`bow plot` and :meth:`bow.Map.plot` draw it. Lengths in this module are inches, sizes of letters points.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bow_sim.figures.page import STYLE
from bow_sweep.figures.layers import LayerError, Panel, Shown, shown
from bow_sweep.figures.panel import Along, axis_titles, draw_borders, draw_limits, number, paint, places, set_ticks
from bow_sweep.figures.sheet import LABEL, SMALL, TICKS, TITLE, Sheet, ink_on
from bow_sweep.figures.symbols import limit_symbol
from bow_sweep.maps.axes import Tick
from bow_sweep.maps.limit_lines import drawn
from bow_sweep.maps.map_file import MapFile

NARROWEST_MM, WIDEST_MM = 40.0, 400.0
MM = 1 / 25.4
SHAPE = 0.62
"""Height of a panel over its width, where cells would be too narrow as squares."""

GAP, RIGHT = 0.16, 0.10
"""Between two columns, and beside the last one."""


class Style(NamedTuple):
    """How a figure looks: `factor` on all sizes of letters and lines, and settings of Matplotlib."""

    factor: float
    settings: dict[str, Any]


STYLES = {
    "paper": Style(1.0, {}),
    "serif": Style(1.08, {"font.family": "STIXGeneral", "mathtext.fontset": "stix"}),
    "slides": Style(1.7, {}),
}
"""Letters of 6.5 to 8 points without serifs; the same with serifs, like Times; letters and lines 1.7 times as large."""


def figure(
    panels: Sequence[Panel],
    width_mm: float = 86.0,
    columns: int | None = None,
    style: str = "paper",
    dpi: float = 300.0,
    shape: float | None = None,
) -> Figure:
    """Return a figure of one or several panels; several have letters, (a), (b) ...

    Panels that show the same are explained together: one scale below them. Neighbours with the same axes share titles
    and ticks.

    Parameters
    ----------
    panels
        In rows, from left to right.
    width_mm
        Width of the whole figure.
    columns
        None: 2 for several panels from 120 mm on, else 1.
    style
        One of `STYLES`.
    dpi
        Dots an inch of a .png.
    shape
        Height over width of a panel; None: cells are squares, or wider.

    Raises
    ------
    LayerError
        Where a map does not have what is to be drawn.
    ValueError
        For a width, a shape, a style or a number of columns that cannot be.
    """
    if not panels:
        raise LayerError("no maps to draw: should be at least one")
    if style not in STYLES:
        raise ValueError(f"style {style!r}: should be one of {', '.join(STYLES)}")
    _check("width", width_mm, NARROWEST_MM, WIDEST_MM, " mm")
    _check("shape", shape or 1.0, 0.1, 5.0)
    _check("dpi", dpi, 50, 1200)
    across = columns or (2 if len(panels) > 1 and width_mm >= 120 else 1)
    _check("columns", across, 1, 6)
    settings: Any = {**STYLE, **STYLES[style].settings}
    with rc_context(settings):
        return _Figure(panels, width_mm * MM, min(across, len(panels)), STYLES[style].factor, dpi, shape).figure


def _check(name: str, value: float, low: float, high: float, unit: str = "") -> None:
    if not low <= value <= high:
        raise ValueError(f"{name} = {value:g}{unit}: should be {low:g} ... {high:g}{unit}")


class _Figure(Sheet):
    """A figure under construction: panels in `columns`, `rows` of them."""

    def __init__(
        self, panels: Sequence[Panel], width: float, columns: int, factor: float, dpi: float, shape: float | None
    ) -> None:
        super().__init__(width, factor, dpi)
        self.panels = list(panels)
        self.columns = columns
        longest = max(panel.plane.periods for panel in panels)
        self.shown = [shown(panel.plane, panel.layer, panel.periods, longest) for panel in panels]
        self.along = [places(panel.plane) for panel in panels]
        self._lay_out(shape)

    # ---- which panels are beside each other, and what they share

    def _neighbour(self, index: int, rows: int, columns: int) -> int | None:
        row, column = divmod(index, self.columns)
        other = (row + rows) * self.columns + column + columns
        return other if 0 <= column + columns < self.columns and 0 <= other < len(self.panels) else None

    def _same_axis(self, one: int, other: int | None, side: int) -> bool:
        if other is None:
            return False
        first, second = self.panels[one].plane.axes[side], self.panels[other].plane.axes[side]
        titles = [self._titles(i)[side] for i in (one, other)]
        return first.name == second.name and np.array_equal(first.values, second.values) and titles[0] == titles[1]

    def _same_scale(self, one: int, other: int | None) -> bool:
        """Return whether two panels are explained together."""
        if other is None:
            return False
        scales = [(self.panels[i].layer, self.shown[i].ends) for i in (one, other)]
        return scales[0] == scales[1]

    def _members(self, last: int) -> list[Shown]:
        """Return what the panels show that the strip below panel `last` explains."""
        found = [last]
        while (above := self._neighbour(found[-1], -1, 0)) is not None and self._same_scale(above, last):
            found.append(above)
        return [self.shown[i] for i in found]

    def _titles(self, index: int, words: bool = False) -> tuple[str, str]:
        return axis_titles(self.panels[index].plane, words)

    # ---- sizes

    def _lay_out(self, shape: float | None) -> None:
        f, count = self.factor, len(self.panels)
        together = self.columns > 1 and all(self._same_scale(0, i) for i in range(count))
        below = [self._neighbour(i, 1, 0) for i in range(count)]
        explained = [not together and not self._same_scale(i, below[i]) for i in range(count)]
        with_x = [explained[i] or not self._same_axis(i, below[i], 0) for i in range(count)]
        with_y = [not self._same_axis(i, self._neighbour(i, 0, -1), 1) for i in range(count)]
        wide = [self._beside(i) if with_y[i] else 0.0 for i in range(count)]
        lefts = [max(wide[i] for i in range(column, count, self.columns)) for column in range(self.columns)]
        across = (self.width - sum(lefts) - GAP * f * (self.columns - 1) - RIGHT * f) / self.columns
        if across < 0.5 * f:
            where = f"width = {self.width / MM:.0f} mm, columns = {self.columns}"
            raise ValueError(f"{where}: panels would be too narrow; should be wider, or of fewer columns")
        at_column = [sum(lefts[: i + 1]) + i * (across + GAP * f) for i in range(self.columns)]
        tall = [across * (shape or _shape(panel.plane)) for panel in self.panels]
        at, tops, strips = 0.05 * f, [], []
        for first in range(0, count, self.columns):
            row = range(first, min(first + self.columns, count))
            at += (0.10 * f if any(explained[i] for i in range(first)) else 0.0) + (
                0.16 * f if self._headed(row) else 0.0
            )
            tops += [at for _ in row]
            bottom = at
            for i in row:
                under = self._below(i) if with_x[i] else 0.05 * f
                if explained[i]:
                    strips.append((self._members(i), at_column[i % self.columns], at + tall[i] + under, across))
                    under += self.strip_height(self._members(i), across)
                bottom = max(bottom, at + tall[i] + under)
            at = bottom
        if together:
            whole = self.width - lefts[0] - RIGHT * f
            strips.append((self.shown, lefts[0], at, whole))
            at += self.strip_height(self.shown, whole)
        self.grow(at + 0.04 * f)
        for i, panel in enumerate(self.panels):
            box = (at_column[i % self.columns], tops[i], across, tall[i])
            self._draw(i, panel, box, with_x[i], with_y[i])
        for strip in strips:
            self.strip(*strip)

    def _headed(self, row: Sequence[int]) -> bool:
        return len(self.panels) > 1 or any(self.panels[i].title for i in row)

    def _beside(self, index: int) -> float:
        """Return the room that title and ticks of the y axis take."""
        texts = [tick.text for tick in self.along[index][1].ticks() if tick.text]
        ticks = max((self.size(number(text), TICKS)[0] for text in texts), default=0.0)
        return ticks + self.size("Ag", LABEL)[1] + 0.13 * self.factor

    def _below(self, index: int) -> float:
        """Return the room that title and ticks of the x axis take."""
        return self.size(self._titles(index)[0], LABEL)[1] + self.size("0", TICKS)[1] + 0.14 * self.factor

    # ---- panels

    def _draw(
        self, index: int, panel: Panel, box: tuple[float, float, float, float], with_x: bool, with_y: bool
    ) -> None:
        left, top, width, height = box
        ax = self.axes(*box)
        along, found, f = self.along[index], self.shown[index], self.factor
        paint(ax, panel.plane, found.colours, along)
        if panel.layer == "reliability" and panel.plane.reliability is not None:
            draw_borders(ax, panel.plane.reliability.reliable, 0.6 * f, along)
        draw_limits(ax, panel.plane, width=0.9 * f, size=SMALL * f, along=along)
        if panel.layer == "regime":
            self._letters(ax, panel.plane, found, along, (width, height))
        ax.tick_params(labelsize=TICKS * f, pad=1.8 * f, length=2.5 * f, width=0.6 * f)
        ax.tick_params(which="minor", length=1.5 * f, width=0.45 * f)
        for side, (direction, length, kept) in enumerate(((ax.xaxis, width, with_x), (ax.yaxis, height, with_y))):
            set_ticks(direction, self._thinned(along[side], length, side))
            if not kept:
                direction.set_ticklabels([])
                continue
            full, short = (self._titles(index, words)[side] for words in (True, False))
            title = full if self.size(full, LABEL)[0] <= length else short
            direction.set_label_text(title, fontsize=LABEL * f)
            direction.labelpad = 2.0 * f
        letter = f"({chr(ord('a') + index)})" if len(self.panels) > 1 else ""
        head: dict[str, Any] = {"fontsize": TITLE * f, "va": "baseline"}
        shift = self.size(letter, TITLE)[0] + 0.10 * f if letter else 0.0
        self.text(left, top - 0.06 * f, letter, fontweight="bold", **head)
        self.text(left + shift, top - 0.06 * f, self._cut(panel.title, width - shift), **head)

    def _cut(self, text: str, width: float) -> str:
        """Return as much of a title as there is room for: some of its parts, or its beginning and three dots."""
        parts = text.split(", ")
        for count in range(len(parts), 0, -1):
            if self.size(shorter := ", ".join(parts[:count]), TITLE)[0] <= width:
                return shorter
        words = re.sub(r"[$\\{}]", "", parts[0])
        while words and self.size(words + "\u2026", TITLE)[0] > width:
            words = words[:-1]
        return words + "\u2026"

    def _thinned(self, along: Along, length: float, side: int) -> list[Tick]:
        """Return the ticks of an axis with as many labels as do not touch each other."""
        ticks = along.ticks()
        labelled = [tick for tick in ticks if tick.text]
        room = [self.size(number(tick.text), TICKS)[side] / 2 + 0.025 * self.factor for tick in labelled]
        at = [tick.position / along.axis.count * length for tick in labelled]
        for chosen in _choices(labelled):
            if all(at[j] - at[i] >= room[i] + room[j] for i, j in pairwise(chosen)):
                kept = {labelled[i].position for i in chosen}
                return [tick if tick.position in kept else tick._replace(text="") for tick in ticks]
        return ticks

    def _letters(
        self, ax: Axes, plane: MapFile, found: Shown, along: tuple[Along, Along], panel: tuple[float, float]
    ) -> None:
        """Write the letter of each regime into its two largest areas, where there is room."""
        from scipy.ndimage import distance_transform_edt, label  # takes a third of a second

        assert found.codes is not None
        ny, nx = found.codes.shape
        width, height = panel
        size = 6.5 * self.factor
        free = ~self._under_labels(plane, panel)
        for code, (_, colour, letter) in enumerate(found.names):
            if not letter:
                continue
            regions, count = label(found.codes == code)
            areas = np.bincount(regions.ravel(), minlength=count + 1)[1:]
            for region in np.argsort(-areas, kind="stable")[:2] + 1:
                inside = np.pad((regions == region) & free, 1)
                room = distance_transform_edt(inside, sampling=(height / ny, width / nx))[1:-1, 1:-1]
                iy, ix = np.unravel_index(int(np.argmax(room)), room.shape)
                if room[iy, ix] < 0.75 * size / 72:
                    continue
                x, y = (float(way.at(np.array(i + 0.5))) for way, i in zip(along, (ix, iy), strict=True))
                ax.text(x, y, letter, color=ink_on(colour), fontsize=size, ha="center", va="center_baseline")

    def _under_labels(self, plane: MapFile, panel: tuple[float, float]) -> np.ndarray:
        """Return which cells the symbols of the limits of theory cover, (ny, nx) bool."""
        ny, nx = plane.shape
        covered = np.zeros((ny, nx), bool)
        for each in drawn(plane):
            wide, tall = self.size(f"${limit_symbol(each.limit.name)}$", SMALL)
            x, y = each.label
            across, up = wide / 2 / panel[0] * nx, tall / 2 / panel[1] * ny
            rows = slice(max(0, int(y - up)), int(y + up) + 1)
            covered[rows, max(0, int(x - across)) : int(x + across) + 1] = True
        return covered


def _shape(plane: MapFile) -> float:
    ny, nx = plane.shape
    return min(1.0, max(SHAPE, ny / nx))


def _choices(ticks: Sequence[Tick]) -> Iterator[list[int]]:
    """Yield which labels of an axis to keep: all, every second, every third ...; ones of a decade before others."""
    for stride in range(1, len(ticks) + 1):
        found = [list(range(first, len(ticks), stride)) for first in range(stride)]
        yield from sorted(found, key=lambda chosen: -sum(_is_one(ticks[i].text) for i in chosen) / len(chosen))


def _is_one(text: str) -> bool:
    return re.fullmatch(r"-?(1(0*|e.*)|0|0\.0*1)", text) is not None
