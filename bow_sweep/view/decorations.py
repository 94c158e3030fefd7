"""Frame, ticks, labels and colour scale of a map, as plain arrays, for a viewer that does not draw them itself.

A map is always drawn `WIDTH` by `HEIGHT` units, however many cells it has, so that it fills its view; cells are
stretched. The viewer counts rows of an image downwards: cell (ix, iy) of a map of nx by ny cells is the rectangle from
x = ix WIDTH/nx and y = (ny - 1 - iy) HEIGHT/ny.

The viewer writes labels in one size on the screen, whatever the scale. Here their boxes are estimated for the smallest
view in which they should be readable, a quarter of a window of 1440 by 900; in larger views they take less space.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sweep.figures.colours import BLACK, GREY, TERRAIN_COLOURS, regime_legend, transient_colours, viridis
from bow_sweep.maps.axes import Tick
from bow_sweep.maps.held_fixed import caption
from bow_sweep.maps.limit_lines import limit_note
from bow_sweep.maps.plane import TEST_RANGES, Plane, terrain_label
from bow_sweep.maps.terrain import TERRAINS

WIDTH, HEIGHT = 128.0, 64.0
"""Size of every map, units: two to one as in the paper's Fig 11."""

LETTER, PADDING, LINE = 1.43, 3.4, 4.8
"""Size of labels at the design scale, units: width of a letter, width of the two margins, height of a label."""

TICK, MINOR_TICK, GAP = 1.4, 0.7, 0.8
"""Lengths of ticks with and without a label, and least distance between two labels, units."""

BELOW, TITLE = HEIGHT + LINE / 2 + 0.2, -1.5 * LINE - 0.4
"""Upper edges of the labels below the map and of the titles above it: a tick of y at a corner has a label beside it."""

BAR_WIDTH, PIXEL = 4.0, 0.5
"""Width of a colour scale, and of one of its pixels, units."""

BOX_PITCH = 6.5
"""Distance of two boxes below a colour scale, units."""

CAPTION_LETTERS = 100
"""Letters in a line of the caption; longer lines would make the view wider than the map needs."""

FORMULAS = "formulas: Accounts"
"""Where the formulas of limits are: the map would be too small with them below it."""

LEGEND_WIDTH, LEGEND_HEIGHT = 184.0, 100.0
"""Size of the legend of regimes, which has a view of its own, units of that view."""

LEGEND_COLUMNS, SWATCH, LEGEND_STROKE = (2.0, 86.0), 9.0, 6.0
LEGEND_LETTER, LEGEND_PADDING, LEGEND_LINE = 3.2, 7.0, 11.0
"""Left edges of its columns, width and height of a colour, and size of its labels as above, in the same units."""

NICE_STEPS = (1, 2, 4, 10, 20, 40, 100, 200, 400, 1000, 2000, 10_000, 100_000, 1_000_000)

Box = tuple[float, float, float, float]
"""Left, top, right and bottom of a label, units."""


def text_width(text: str) -> float:
    """Return the width of a label at the design scale, units."""
    return LETTER * len(text) + PADDING


@dataclass
class Decorations:
    """Lines, labels and one coloured bar around a map, in units.

    Attributes
    ----------
    lines
        Each (points, 2).
    places, labels
        Points (x, y), and the texts whose upper edges are centred at them.
    bar
        (rows, columns, 4) uint8, with opacity; a pixel is `PIXEL` wide. Its top left corner is at `bar_corner`.
    """

    lines: list[np.ndarray] = field(default_factory=list)
    places: list[tuple[float, float]] = field(default_factory=list)
    labels: list[str] = field(default_factory=list)
    bar: np.ndarray | None = None
    bar_corner: tuple[float, float] = (0.0, 0.0)

    def line(self, *points: tuple[float, float]) -> None:
        """Add a line through points."""
        self.lines.append(np.array(points, np.float32))

    def label(self, x: float, y: float, text: str) -> None:
        """Add a text; the middle of its upper edge is at a point, as rerun places labels."""
        self.places.append((x, y))
        self.labels.append(text)

    def label_from(self, left: float, y: float, text: str) -> None:
        """Add a text by its left edge."""
        self.label(left + text_width(text) / 2, y, text)

    def boxes(self) -> list[Box]:
        """Return the estimated box of each label."""
        sizes = [text_width(text) / 2 for text in self.labels]
        return [(x - half, y, x + half, y + LINE) for (x, y), half in zip(self.places, sizes, strict=True)]

    @property
    def bounds(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """((left, right), (top, bottom)) of all of it."""
        points = np.vstack([*self.lines, *(np.reshape(box, (2, 2)) for box in self.boxes())])
        (left, top), (right, bottom) = points.min(axis=0) - 1, points.max(axis=0) + 1
        return (float(left), float(right)), (float(top), float(bottom))


def cell_centres(plane: Plane) -> np.ndarray:
    """Return the middle of each cell, (ny * nx, 2), in the order of the cells, and so from the lowest row up."""
    ny, nx = plane.shape
    iy, ix = np.divmod(np.arange(ny * nx), nx)
    return np.column_stack([(ix + 0.5) * WIDTH / nx, HEIGHT - (iy + 0.5) * HEIGHT / ny])


def cell_size(plane: Plane) -> tuple[float, float]:
    """Return width and height of a cell, units."""
    ny, nx = plane.shape
    return WIDTH / nx, HEIGHT / ny


def surroundings(plane: Plane) -> Decorations:
    """Return frame, ticks and labels of a map."""
    made = _surroundings(plane)
    return Decorations([*made.lines], [*made.places], [*made.labels])


@lru_cache(maxsize=1)
def _surroundings(plane: Plane) -> Decorations:
    """Return what :func:`surroundings` returns; all pictures of a map have it."""
    made = Decorations()
    made.line((0, 0), (WIDTH, 0), (WIDTH, HEIGHT), (0, HEIGHT), (0, 0))
    x, y = plane.axes
    for tick, place in _placed(x.ticks(), WIDTH / x.count, lambda text: text_width(text) + GAP):
        made.line((place, HEIGHT), (place, HEIGHT + (TICK if tick.text else MINOR_TICK)))
        if tick.text:
            made.label(place, BELOW, tick.text)
    for tick, along in _placed(y.ticks(), HEIGHT / y.count, lambda text: LINE + GAP):
        place = HEIGHT - along
        made.line((0, place), (-(TICK if tick.text else MINOR_TICK), place))
        if tick.text:
            made.label(-TICK - GAP - text_width(tick.text) / 2, place - LINE / 2, tick.text)
    made.label(WIDTH / 2, BELOW + LINE + GAP, x.title(plane.settings))
    made.label_from(made.bounds[0][0] + 1, TITLE, y.title(plane.settings))
    return made


def _placed(ticks: Sequence[Tick], unit: float, extent: object) -> list[tuple[Tick, float]]:
    """Return the ticks with their places; a label that would touch another gives way, powers of ten last.

    Parameters
    ----------
    unit
        Size of a cell along the axis, units.
    extent
        Function from a text to the space that its label needs along the axis, units.
    """
    taken: list[tuple[float, float]] = []
    kept = set()
    for tick in sorted(ticks, key=lambda tick: (tick.text.strip("0.") != "1", tick.position)):
        middle, half = tick.position * unit, extent(tick.text) / 2 if tick.text else 0.0  # type: ignore[operator]
        if tick.text and all(middle - half >= end or middle + half <= start for start, end in taken):
            taken.append((middle - half, middle + half))
            kept.add(tick)
    return [(tick if tick in kept else Tick(tick.position, ""), tick.position * unit) for tick in ticks]


def _captioned(plane: Plane) -> Decorations:
    """Return frame, ticks and labels, and below them what is the same in all cells."""
    made = surroundings(plane)
    top = made.bounds[1][1] - 1 + GAP
    for number, line in enumerate([*caption(plane, CAPTION_LETTERS), *limit_note(plane, FORMULAS)]):
        made.label(WIDTH / 2, top + number * (LINE + GAP / 2), line)
    return made


def transient_decorations(plane: Plane) -> Decorations:
    """Return the decorations of the transient lengths: a bar in the colours of the map, black and grey below it."""
    made = _captioned(plane)
    lengths = np.arange(CHUNK_PERIODS, plane.periods + 1, CHUNK_PERIODS)[::-1]
    texts = _some([f"{length:g}" for length in lengths[::-1]])[::-1]
    boxes = [("never", BLACK), ("pending", GREY)]
    _scale(made, transient_colours(lengths, plane.periods), texts, "transient (periods)", boxes)
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
    _scale(made, viridis(shares[::-1]), texts[::-1], name, [("pending", GREY)])
    return made


def regime_decorations(plane: Plane) -> Decorations:
    """Return the decorations of the regimes: a bar of their colours with their names."""
    made = surroundings(plane)
    legend = regime_legend(plane.regime_names)
    _scale(made, np.array([colour for _, _, colour in legend], np.uint8), [label for _, label, _ in legend], "regime")
    return made


def terrain_decorations(plane: Plane) -> Decorations:
    """Return the decorations of the terrain: a bar of its colours with their names."""
    made = _captioned(plane)
    colours = np.array([*TERRAIN_COLOURS, GREY], np.uint8)
    _scale(made, colours, [*map(terrain_label, TERRAINS), "unknown"], "terrain")
    return made


def reliability_decorations(plane: Plane) -> Decorations:
    """Return the decorations of the shares of repeats that end as their cell: a bar from 1 on top to 0."""
    made = _captioned(plane)
    texts = [f"{step / 40:g}" if step % 8 == 0 else "" for step in range(40, -1, -1)]
    _scale(made, viridis(np.linspace(1, 0, 41)), texts, "repeats that end alike", [("not known", GREY)])
    return made


def number_decorations(
    plane: Plane, title: str, limits: tuple[float, float], none: Sequence[tuple[str, tuple[int, int, int]]] = ()
) -> Decorations:
    """Return the decorations of a picture of numbers: a bar from the last of two limits on top down to the first.

    Parameters
    ----------
    limits
        The numbers at the dark and at the bright end of viridis.
    none
        Names and colours of cells without a number.
    """
    made = surroundings(plane)
    values = np.linspace(*limits, 41)
    texts = [f"{value:.3g}" if index % 8 == 0 else "" for index, value in enumerate(values)]
    _scale(made, viridis(np.linspace(1, 0, 41)), texts[::-1], title, none)
    return made


def legend(names: Sequence[str]) -> tuple[np.ndarray, list[Box]]:
    """Return the legend of the lines of the regimes: a stroke for each, (n, 2, 2), and the boxes of their names."""
    rows = -(-len(names) // len(LEGEND_COLUMNS))
    strokes, boxes = [], []
    for number, name in enumerate(names):
        column, row = divmod(number, rows)
        left, middle = LEGEND_COLUMNS[column], (row + 0.5) * LEGEND_HEIGHT / rows
        cap = LEGEND_STROKE / 2  # the ends of a stroke are round
        strokes.append([(left + cap, middle), (left + SWATCH - cap, middle)])
        start = left + SWATCH + 3
        width = LEGEND_LETTER * len(name) + LEGEND_PADDING
        boxes.append((start, middle - LEGEND_LINE / 2, start + width, middle + LEGEND_LINE / 2))
    return np.array(strokes, np.float32), boxes


def _some(texts: list[str]) -> list[str]:
    """Return the texts with at most about six of them kept, at regular distances; the others are empty."""
    step = next(step for step in NICE_STEPS if len(texts) / step <= 6)
    return [text if (index + 1) % step == 0 or index == 0 else "" for index, text in enumerate(texts)]


def _scale(
    made: Decorations,
    colours: np.ndarray,
    texts: Sequence[str],
    title: str,
    boxes: Sequence[tuple[str, tuple[int, int, int]]] = (),
) -> None:
    """Add a bar on the right, its first colour on top, with a text beside each band.

    Parameters
    ----------
    colours
        (bands, 3) uint8.
    texts
        One for each band; "" for none.
    boxes
        Names and colours of what stands below the bar.
    """
    left, words = WIDTH + 4, WIDTH + 4 + BAR_WIDTH + 1 + GAP
    tall = HEIGHT - BOX_PITCH * len(boxes)
    picture = np.zeros((round(HEIGHT / PIXEL), round(BAR_WIDTH / PIXEL), 4), np.uint8)
    count = round(tall / PIXEL)
    bands = np.arange(count) * len(colours) // count
    picture[:count] = np.append(colours[bands], np.full((count, 1), 255), axis=1)[:, None]
    _outline(made, left, 0, tall)
    for number, (word, colour) in enumerate(boxes):
        top = tall + BOX_PITCH * (number + 1) - 4
        first = round(top / PIXEL)
        picture[first : first + 8] = (*colour, 255)
        _outline(made, left, top, 4)
        made.label_from(words, top + 2 - LINE / 2, word)
    made.bar, made.bar_corner = picture, (left, 0.0)
    free = -np.inf
    for index, text in enumerate(texts):
        middle = (index + 0.5) * tall / len(colours)
        if text and middle - LINE / 2 >= free:
            free = middle + LINE / 2
            made.line((left + BAR_WIDTH, middle), (left + BAR_WIDTH + 1, middle))
            made.label_from(words, middle - LINE / 2, text)
    made.label_from(left, TITLE, title)


def _outline(made: Decorations, left: float, top: float, tall: float) -> None:
    right = left + BAR_WIDTH
    made.line((left, top), (right, top), (right, top + tall), (left, top + tall), (left, top))
