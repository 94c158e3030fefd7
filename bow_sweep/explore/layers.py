"""What a map can show in the page: for each layer its values, its colours, its scale and its legend, as plain arrays.

The colours are those of ``map.png`` (:mod:`bow_sweep.figures.colours`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bow_sim.protocol.verdict_fields import PENDING
from bow_sweep.figures.colours import (
    BLACK,
    GREY,
    TERRAIN_COLOURS,
    regime_legend,
    transient_colours,
    viridis,
)
from bow_sweep.maps.map_file import MapFile
from bow_sweep.maps.plane import TEST_LAYERS, TEST_RANGES, regime_label, terrain_label
from bow_sweep.maps.terrain import TERRAINS, UNKNOWN, terrain

Colour = tuple[int, int, int]

WHITE: Colour = (255, 255, 255)

STEPS = 256
"""Number of colours of a continuous scale."""

_LATER: Colour = (178, 24, 43)
_SOONER: Colour = (33, 102, 172)
_ONLY_FIRST: Colour = (253, 174, 97)
_ONLY_SECOND: Colour = (90, 174, 97)
"""Of differences: red is later, blue is sooner (ColorBrewer's RdBu, safe for colour-blind people)."""


@dataclass(frozen=True)
class Entry:
    """One line of a legend: a colour, what it means, and the share of all cells that has it."""

    label: str
    colour: Colour
    share: float


@dataclass(frozen=True, eq=False)
class Layer:
    """What a map can show.

    Attributes
    ----------
    name, title
        Short name, and words for people.
    values
        (ny, nx) arrays, row 0 is the first value of y: one, or one for each test.
    palette
        (colours, 3) uint8: equal steps of the values between `low` and `high`.
    below, above, unknown
        Colour of values below `low`, above `high`, and of NaN.
    legends
        For each of `values` the colours that are not on the scale.
    ticks
        Values with a label on the colour bar; none for layers without one, whose legend names every colour.
    unit
        Title of the colour bar.
    """

    name: str
    title: str
    values: tuple[np.ndarray, ...]
    palette: np.ndarray
    low: float
    high: float
    below: Colour
    above: Colour
    unknown: Colour
    legends: tuple[tuple[Entry, ...], ...]
    ticks: tuple[float, ...] = ()
    unit: str = ""

    @property
    def by_test(self) -> bool:
        """Whether there are values for every test."""
        return len(self.values) > 1

    def at_last_test(self) -> Layer:
        """Return the layer with its last values only."""
        return replace(self, values=self.values[-1:], legends=self.legends[-1:])

    def colours(self, test: int = -1) -> np.ndarray:
        """Return the colour of each cell, (ny, nx, 3) uint8, as the page shows it."""
        values = np.asarray(self.values[test], float)
        with np.errstate(invalid="ignore"):
            place = np.floor((values - self.low) / (self.high - self.low) * len(self.palette))
            place = np.where(values == self.high, len(self.palette) - 1, place)
            shown = self.palette[np.clip(np.nan_to_num(place), 0, len(self.palette) - 1).astype(int)]
            shown[values < self.low] = self.below
            shown[values > self.high] = self.above
        shown[np.isnan(values)] = self.unknown
        return shown


def layers_of(plane: MapFile) -> list[Layer]:
    """Return all layers of a map; older files have no regimes and no confidence for the earlier tests."""
    known = ~np.isnan(plane.transient_periods)
    found = [_transient(plane), _regime(plane)]
    found += [_test(plane, name, known) for name in TEST_LAYERS]
    found.append(_passed(plane, known))
    if plane.confidence is not None:
        found.append(_confidence(plane))
    found.append(_terrain(plane))
    return found


def _transient(plane: MapFile) -> Layer:
    lengths = np.asarray(plane.transient_periods, np.float32)
    longest = max(1, round(plane.periods))
    legend = [Entry("never", BLACK, _share(lengths == 0))]
    if np.isnan(lengths).any():
        legend.append(Entry("not computed", GREY, _share(np.isnan(lengths))))
    return Layer(
        "transient",
        "transient length",
        (lengths,),
        transient_colours(np.arange(1, longest + 1), plane.periods),
        1e-4,  # below any transient that there is
        float(longest),
        BLACK,
        _last(transient_colours(longest, plane.periods)),
        GREY,
        (tuple(legend),),
        _round_ticks(longest),
        "periods until Helmholtz motion",
    )


def _regime(plane: MapFile) -> Layer:
    kinds = plane.regimes if plane.regimes is not None else plane.regime[None]
    named = regime_legend(plane.regime_names, "not computed")
    legends = tuple(tuple(_present(grid, named)) for grid in kinds)
    palette = np.array([colour for code, _, colour in named if code != PENDING], np.uint8).reshape(-1, 3)
    return _codes("regime", "regime", kinds, palette, legends)


def _terrain(plane: MapFile) -> Layer:
    grid = terrain(plane.transient_periods)
    named = [(code, terrain_label(kind), TERRAIN_COLOURS[code]) for code, kind in enumerate(TERRAINS)]
    named.append((UNKNOWN, "not computed", GREY))
    return _codes(
        "terrain", "terrain", grid[None], np.array(TERRAIN_COLOURS, np.uint8), (tuple(_present(grid, named)),)
    )


def _codes(
    name: str, title: str, grids: np.ndarray, palette: np.ndarray, legends: tuple[tuple[Entry, ...], ...]
) -> Layer:
    """Return a layer of codes 0, 1 ... with a colour each; others are grey."""
    values = tuple(np.asarray(grid, np.uint8) for grid in grids)
    if not len(palette):
        palette = np.array([GREY], np.uint8)
    return Layer(name, title, values, palette, -0.5, len(palette) - 0.5, GREY, GREY, GREY, legends)


def _present(grid: np.ndarray, named: Sequence[tuple[int, str, Colour]]) -> list[Entry]:
    """Return the legend of those codes that a grid has."""
    return [Entry(label, colour, _share(grid == code)) for code, label, colour in named if (grid == code).any()]


_TITLES = {
    "correlation": ("correlation of successive periods", "correlation"),
    "slips": ("slips in five periods", "slips, Helmholtz motion has 5"),
    "corners": ("corners in five periods", "corners, Helmholtz motion has 5"),
}
"""Title of each test, and of its colour bar."""


def _test(plane: MapFile, name: str, known: np.ndarray) -> Layer:
    low, high = TEST_RANGES[name]
    title, unit = _TITLES[name]
    grids = tuple(np.where(known, np.asarray(grid, np.float32), np.float32(np.nan)) for grid in getattr(plane, name))
    legends = tuple(_unknown(grid) for grid in grids)
    if name == "correlation":
        palette, ticks = viridis(np.linspace(0, 1, STEPS)), tuple(np.round(np.arange(0, 1.01, 0.2), 1).tolist())
    else:  # counts: one colour each
        palette = viridis(np.arange(high - low + 1) / (high - low))
        ticks = tuple(np.arange(low, high + 1, 5).tolist())
        low, high = low - 0.5, high + 0.5
    ends = _last(palette[:1]), _last(palette)
    return Layer(name, title, grids, palette, low, high, *ends, GREY, legends, ticks, unit)


def _passed(plane: MapFile, known: np.ndarray) -> Layer:
    grids = tuple(np.where(known, np.asarray(grid, np.uint8), UNKNOWN).astype(np.uint8) for grid in plane.helmholtz)
    named = [(1, "passed", WHITE), (0, "not passed", BLACK), (UNKNOWN, "not computed", GREY)]
    legends = tuple(tuple(_present(grid, named)) for grid in grids)
    return _codes("helmholtz", "all three tests", np.array(grids), np.array([BLACK, WHITE], np.uint8), legends)


def _confidence(plane: MapFile) -> Layer:
    assert plane.confidence is not None
    grids = tuple(np.asarray(grid, np.float32) for grid in plane.confidence)
    palette = viridis(np.linspace(0, 1, STEPS))
    legends = tuple(_unknown(grid) for grid in grids)
    ticks = tuple(np.round(np.arange(0, 1.01, 0.2), 1).tolist())
    ends = _last(palette[:1]), _last(palette)
    unit = "probability that the regime is right"
    return Layer("confidence", "confidence of the regime", grids, palette, 0, 1, *ends, GREY, legends, ticks, unit)


def _unknown(grid: np.ndarray) -> tuple[Entry, ...]:
    missing = np.isnan(grid)
    return (Entry("none", GREY, _share(missing)),) if missing.any() else ()


ONLY_FIRST, ONLY_SECOND = -1e6, 1e6
"""Values of a difference where Helmholtz motion came in one map only."""


def difference_layer(first: MapFile, second: MapFile) -> Layer:
    """Return by how many periods the transient is longer in the second of two maps of one plane.

    Cells with Helmholtz motion in one of them only are beyond the scale: `ONLY_FIRST`, `ONLY_SECOND`. The first colour
    of the scale is for those with Helmholtz motion in neither. NaN is not computed in one of them.
    """
    one, two = (np.asarray(plane.transient_periods, float) for plane in (first, second))
    unknown = np.isnan(one) | np.isnan(two)
    both, neither = (one > 0) & (two > 0), (one == 0) & (two == 0)
    widest = 10 * math.ceil(max(1.0, float(np.max(np.abs(two - one), where=both, initial=0.0))) / 10)
    end = widest + 1.0  # no value is at an end, where rounding would decide its colour
    step = 2 * end / STEPS
    values = np.where(both, two - one, np.where(neither, -end - step / 2, np.where(one > 0, ONLY_FIRST, ONLY_SECOND)))
    values = np.where(unknown, np.nan, values).astype(np.float32)
    shares = {
        "Helmholtz motion in A only": (_ONLY_FIRST, values == ONLY_FIRST),
        "in B only": (_ONLY_SECOND, values == ONLY_SECOND),
        "in neither": (BLACK, neither),
        "not computed": (GREY, unknown),
    }
    legend = tuple(Entry(words, colour, _share(mask)) for words, (colour, mask) in shares.items() if mask.any())
    return Layer(
        "difference",
        "difference of transient length, B − A",
        (values,),
        np.concatenate([np.array([BLACK], np.uint8), _diverging(STEPS)]),
        -end - step,
        end,
        _ONLY_FIRST,
        _ONLY_SECOND,
        GREY,
        (legend,),
        tuple(np.linspace(-widest, widest, 5).tolist()),
        "periods; red: later in B",
    )


def _diverging(count: int) -> np.ndarray:
    """Return colours from blue through almost white to red, (count, 3) uint8."""
    middle = (247, 247, 247)
    place = np.linspace(-1, 1, count)
    channels = [np.interp(place, (-1, 0, 1), (_SOONER[c], middle[c], _LATER[c])) for c in range(3)]
    return np.stack(channels, axis=-1).round().astype(np.uint8)


def _last(colours: np.ndarray) -> Colour:
    red, green, blue = np.asarray(colours).reshape(-1, 3)[-1].tolist()
    return red, green, blue


def _share(mask: np.ndarray) -> float:
    return float(np.mean(mask))


def _round_ticks(longest: int) -> tuple[float, ...]:
    step = next(step for step in (1, 5, 10, 20, 50, 100, 200, 500, 1000, 10**7) if longest / step <= 8)
    return tuple(float(tick) for tick in range(step, longest + 1, step)) or (float(longest),)


def hex_colour(colour: Sequence[int] | np.ndarray) -> str:
    """Return a colour as "#rrggbb"."""
    return "#{:02x}{:02x}{:02x}".format(*(int(channel) for channel in colour))


def regime_names(plane: MapFile) -> list[str]:
    """Return the names of the regimes by code, for people."""
    return [regime_label(name) for name in plane.regime_names]
