"""What stands around a map in a viewer that draws no axes: frame, ticks, labels, scales, as plain arrays.

Viewers of images count rows downwards: cell (ix, iy) covers x from ix to ix + 1 and y from ny - 1 - iy to ny - iy.
Lengths outside the map are in units that follow its size, so that a small map gets the same decorations as a large one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sweep.figures.colours import BLACK, GREY, TERRAIN_COLOURS, regime_colours, transient_colours, viridis
from bow_sweep.maps.plane import TEST_RANGES, Plane, regime_label, terrain_label
from bow_sweep.maps.terrain import TERRAINS

MIN_BAR = 36.0
"""A scale is at least so many units high, however flat the map."""

LABEL_RISE = 2.0
"""A label beside a tick starts so many units above it: half its height in a window of the usual size."""

NICE_STEPS = (1, 2, 4, 10, 20, 40, 100, 200, 400, 1000, 2000, 10_000, 100_000, 1_000_000)


@dataclass
class Decorations:
    """Lines, words and one coloured strip, in the coordinates of the map's image.

    Attributes
    ----------
    lines
        Each (points, 2).
    places, words
        (labels, 2) and their texts, centred just below.
    bar
        (rows, columns, 4) uint8 with opacity; its top left corner is at `bar_corner`, a pixel is `bar_pixel` wide.
    bounds
        ((left, right), (top, bottom)) that show all of it.
    """

    unit: float
    bounds: tuple[tuple[float, float], tuple[float, float]]
    lines: list[np.ndarray] = field(default_factory=list)
    places: list[tuple[float, float]] = field(default_factory=list)
    words: list[str] = field(default_factory=list)
    bar: np.ndarray | None = None
    bar_corner: tuple[float, float] = (0.0, 0.0)
    bar_pixel: float = 1.0

    def line(self, *points: tuple[float, float]) -> None:
        """Add a line through points."""
        self.lines.append(np.array(points, np.float32))

    def word(self, x: float, y: float, text: str) -> None:
        """Add a text whose middle of the upper edge is at a point, as rerun places labels."""
        self.places.append((x, y))
        self.words.append(text)


def unit_of(plane: Plane) -> float:
    """Return the length that is one cell on the paper's map of 128 by 64."""
    ny, nx = plane.shape
    return max(nx / 128, ny / 64)


def surroundings(plane: Plane) -> Decorations:
    """Return frame, ticks and labels of a map, and room for a scale on its right."""
    ny, nx = plane.shape
    unit = unit_of(plane)
    made = Decorations(unit, ((-13 * unit, nx + 24 * unit), (-8 * unit, ny + 11 * unit)))
    made.line((0, 0), (nx, 0), (nx, ny), (0, ny), (0, 0))
    x, y = plane.axes
    for tick in x.ticks():
        made.line((tick.position, ny), (tick.position, ny + (1.4 if tick.text else 0.7) * unit))
        if tick.text:
            made.word(tick.position, ny + 1.4 * unit, tick.text)
    for tick in y.ticks():
        made.line((0, ny - tick.position), (-(1.4 if tick.text else 0.7) * unit, ny - tick.position))
        if tick.text:
            made.word(-4.4 * unit, ny - tick.position - LABEL_RISE * unit, tick.text)
    made.word(nx / 2, ny + 5.2 * unit, x.title(mathematics=False, settings=plane.settings))
    made.word(22 * unit, -5.6 * unit, y.title(mathematics=False, settings=plane.settings))
    return made


def transient_decorations(plane: Plane) -> Decorations:
    """Return what stands around the transient lengths: a bar in the colours of the map, black and grey below it."""
    made = surroundings(plane)
    lengths = np.arange(CHUNK_PERIODS, plane.periods + 1, CHUNK_PERIODS)[::-1]
    texts = _some([f"{length:g}" for length in lengths[::-1]])[::-1]
    _scale(made, plane, transient_colours(lengths, plane.periods), texts, "transient (periods)", extras=True)
    return made


def layer_decorations(plane: Plane, name: str) -> Decorations:
    """Return what stands around the results of one test."""
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
    """Return what stands around the regimes: a strip of their colours with their names."""
    made = surroundings(plane)
    made.bounds = ((made.bounds[0][0], made.bounds[0][1] + 8 * made.unit), made.bounds[1])
    colours = np.array([*regime_colours(plane.regime_names), GREY], np.uint8)
    names = [*map(regime_label, plane.regime_names), "pending"]
    _scale(made, plane, colours, names, "regime", extras=False, words_at=15.0)
    return made


def terrain_decorations(plane: Plane) -> Decorations:
    """Return what stands around the terrain: a strip of its colours with their names."""
    made = surroundings(plane)
    made.bounds = ((made.bounds[0][0], made.bounds[0][1] + 8 * made.unit), made.bounds[1])
    colours = np.array([*TERRAIN_COLOURS, GREY], np.uint8)
    names = [*map(terrain_label, TERRAINS), "unknown"]
    _scale(made, plane, colours, names, "terrain", extras=False, words_at=15.0)
    return made


def _some(texts: list[str]) -> list[str]:
    """Return the texts with so many of them blanked that at most six are left, at round places."""
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
    """Put a bar on the right, its first colour on top, a text beside each band; `extras`: black and grey below it."""
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
        made.word(left + words_at * unit, top + (2 - LABEL_RISE) * unit, word)
    made.bar, made.bar_corner, made.bar_pixel = picture, (left, 0.0), pixel
    for index, text in enumerate(texts):
        if text:
            middle = (index + 0.5) * tall / len(colours)
            made.line((left + wide, middle), (left + wide + unit, middle))
            made.word(left + words_at * unit, middle - LABEL_RISE * unit, text)
    made.word(left + 7 * unit, -5.6 * unit, title)


def _outline(made: Decorations, left: float, top: float, wide: float, tall: float) -> None:
    made.line((left, top), (left + wide, top), (left + wide, top + tall), (left, top + tall), (left, top))
