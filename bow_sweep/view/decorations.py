"""Frame, ticks, labels and colour scale of a map, as plain arrays, for a viewer that does not draw them itself.

Viewers count the rows of an image downwards: cell (ix, iy) covers x from ix to ix + 1 and y from ny - 1 - iy to
ny - iy. Lengths outside the map are in a unit that follows its size, so that small and large maps look alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sweep.figures.colours import BLACK, GREY, TERRAIN_COLOURS, regime_legend, transient_colours, viridis
from bow_sweep.maps.plane import TEST_RANGES, Plane, terrain_label
from bow_sweep.maps.terrain import TERRAINS

MIN_BAR = 36.0
"""Least height of a colour scale, units."""

LABEL_RISE = 2.0
"""Distance from a tick up to the upper edge of its label, units: half the height of a label in a usual window."""

NICE_STEPS = (1, 2, 4, 10, 20, 40, 100, 200, 400, 1000, 2000, 10_000, 100_000, 1_000_000)


@dataclass
class Decorations:
    """Lines, labels and one coloured bar, in the coordinates of the image of the map.

    Attributes
    ----------
    lines
        Each (points, 2).
    unit
        Unit of lengths outside the map, cells.
    bounds
        ((left, right), (top, bottom)) of all of it.
    places, labels
        Points (x, y), and the texts whose upper edges are centred at them.
    bar
        (rows, columns, 4) uint8, with opacity. Its top left corner is at `bar_corner`; a pixel is `bar_pixel` wide.
    """

    unit: float
    bounds: tuple[tuple[float, float], tuple[float, float]]
    lines: list[np.ndarray] = field(default_factory=list)
    places: list[tuple[float, float]] = field(default_factory=list)
    labels: list[str] = field(default_factory=list)
    bar: np.ndarray | None = None
    bar_corner: tuple[float, float] = (0.0, 0.0)
    bar_pixel: float = 1.0

    def line(self, *points: tuple[float, float]) -> None:
        """Add a line through points."""
        self.lines.append(np.array(points, np.float32))

    def label(self, x: float, y: float, text: str) -> None:
        """Add a text; the middle of its upper edge is at a point, as rerun places labels."""
        self.places.append((x, y))
        self.labels.append(text)


def unit_of(plane: Plane) -> float:
    """Return the unit of lengths outside the map, cells: one cell for the paper's map of 128 by 64."""
    ny, nx = plane.shape
    return max(nx / 128, ny / 64)


def surroundings(plane: Plane) -> Decorations:
    """Return frame, ticks and labels of a map, with space for a colour scale on the right."""
    ny, nx = plane.shape
    unit = unit_of(plane)
    made = Decorations(unit, ((-13 * unit, nx + 24 * unit), (-8 * unit, ny + 11 * unit)))
    made.line((0, 0), (nx, 0), (nx, ny), (0, ny), (0, 0))
    x, y = plane.axes
    for tick in x.ticks():
        made.line((tick.position, ny), (tick.position, ny + (1.4 if tick.text else 0.7) * unit))
        if tick.text:
            made.label(tick.position, ny + 1.4 * unit, tick.text)
    for tick in y.ticks():
        made.line((0, ny - tick.position), (-(1.4 if tick.text else 0.7) * unit, ny - tick.position))
        if tick.text:
            made.label(-4.4 * unit, ny - tick.position - LABEL_RISE * unit, tick.text)
    made.label(nx / 2, ny + 5.2 * unit, x.title(mathematics=False, settings=plane.settings))
    made.label(22 * unit, -5.6 * unit, y.title(mathematics=False, settings=plane.settings))
    return made


def transient_decorations(plane: Plane) -> Decorations:
    """Return the decorations of the transient lengths: a bar in the colours of the map, black and grey below it."""
    made = surroundings(plane)
    lengths = np.arange(CHUNK_PERIODS, plane.periods + 1, CHUNK_PERIODS)[::-1]
    texts = _some([f"{length:g}" for length in lengths[::-1]])[::-1]
    _scale(made, plane, transient_colours(lengths, plane.periods), texts, "transient (periods)", extras=True)
    return made


def layer_decorations(plane: Plane, name: str) -> Decorations:
    """Return the decorations of the results of a test."""
    made = surroundings(plane)
    low, high = TEST_RANGES[name]
    values = np.linspace(low, high, 41) if name == "correlation" else np.arange(low, high + 1)
    wanted = values[::8] if name == "correlation" else values[::5]
    texts = [f"{value:.2g}" if value in wanted else "" for value in values]
    if name != "correlation":
        texts[-1] += " +"
    shares = (values - low) / (high - low)
    _scale(made, plane, viridis(shares[::-1]), texts[::-1], name, extras=False)
    return made


def regime_decorations(plane: Plane) -> Decorations:
    """Return the decorations of the regimes: a bar of their colours with their names."""
    made = surroundings(plane)
    made.bounds = ((made.bounds[0][0], made.bounds[0][1] + 8 * made.unit), made.bounds[1])
    legend = regime_legend(plane.regime_names)
    colours = np.array([colour for _, _, colour in legend], np.uint8)
    labels = [label for _, label, _ in legend]
    _scale(made, plane, colours, labels, "regime", extras=False, words_at=15.0)
    return made


def terrain_decorations(plane: Plane) -> Decorations:
    """Return the decorations of the terrain: a bar of its colours with their names."""
    made = surroundings(plane)
    made.bounds = ((made.bounds[0][0], made.bounds[0][1] + 8 * made.unit), made.bounds[1])
    colours = np.array([*TERRAIN_COLOURS, GREY], np.uint8)
    names = [*map(terrain_label, TERRAINS), "unknown"]
    _scale(made, plane, colours, names, "terrain", extras=False, words_at=15.0)
    return made


def _some(texts: list[str]) -> list[str]:
    """Return the texts with at most about six of them kept, at regular distances; the others are empty."""
    step = next(step for step in NICE_STEPS if len(texts) / step <= 6)
    return [text if (index + 1) % step == 0 or index == 0 else "" for index, text in enumerate(texts)]


def _scale(
    made: Decorations,
    plane: Plane,
    colours: np.ndarray,
    texts: Sequence[str],
    title: str,
    *,
    extras: bool,
    words_at: float = 11.0,
) -> None:
    """Add a bar on the right, its first colour on top, with a text beside each band.

    Parameters
    ----------
    colours
        (bands, 3) uint8.
    texts
        One for each band; "" for none.
    extras
        Whether black and grey stand below the bar.
    words_at
        Distance of the middle of the texts from the bar, units.
    """
    ny, nx = plane.shape
    unit = made.unit
    left, wide, pixel = nx + 4 * unit, 4 * unit, unit / 2
    boxes = [("never", BLACK), ("pending", GREY)] if extras else []
    high = max(float(ny), MIN_BAR * unit)
    tall = high - 6 * unit * len(boxes)
    (west, east), (north, south) = made.bounds
    made.bounds = ((west, east), (north, max(south, high + 4 * unit)))
    picture = np.zeros((round(high / pixel), round(wide / pixel), 4), np.uint8)
    count = round(tall / pixel)
    bands = np.arange(count) * len(colours) // count
    picture[:count] = np.append(colours[bands], np.full((count, 1), 255), axis=1)[:, None]
    _outline(made, left, 0, wide, tall)
    for number, (word, colour) in enumerate(boxes):
        top = tall + (2 + 6 * number) * unit
        first = round(top / pixel)
        picture[first : first + 8] = (*colour, 255)
        _outline(made, left, top, wide, 4 * unit)
        made.label(left + words_at * unit, top + (2 - LABEL_RISE) * unit, word)
    made.bar, made.bar_corner, made.bar_pixel = picture, (left, 0.0), pixel
    for index, text in enumerate(texts):
        if text:
            middle = (index + 0.5) * tall / len(colours)
            made.line((left + wide, middle), (left + wide + unit, middle))
            made.label(left + words_at * unit, middle - LABEL_RISE * unit, text)
    made.label(left + 7 * unit, -5.6 * unit, title)


def _outline(made: Decorations, left: float, top: float, wide: float, tall: float) -> None:
    made.line((left, top), (left + wide, top), (left + wide, top + tall), (left, top + tall), (left, top))
