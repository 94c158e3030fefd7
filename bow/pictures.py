"""A map as a picture for a paper: one layer, true symbols and units on its axes, vector, fonts embedded."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from bow.found import Found
from bow.shown import Picture
from bow_sim.figures.page import DPI, style
from bow_sweep.figures.colours import (
    BLACK,
    GREY,
    TERRAIN_COLOURS,
    regime_colours,
    transient_colours,
    viridis,
)
from bow_sweep.figures.layout import paint
from bow_sweep.maps.held_fixed import caption, unit_of
from bow_sweep.maps.plane import TEST_RANGES, regime_label, terrain_label
from bow_sweep.maps.terrain import TERRAINS

if TYPE_CHECKING:
    from bow_sweep.maps.axes import PlotAxis

LAYERS = {
    "transient": "periods until Helmholtz motion",
    "regime": "regime",
    "terrain": "terrain",
    "correlation": "correlation of successive periods",
    "confidence": "probability that the regime is right",
    "slips": "significant slips in five periods",
    "corners": "travelling corners in five periods",
}
"""What each layer of a picture shows."""

NARROWEST_MM, WIDEST_MM = 40.0, 400.0

MM = 1 / 25.4
LEFT, RIGHT, TOP = 0.50, 0.10, 0.08
"""Inches beside and above the panel."""
BELOW_AXIS, LINE = 0.40, 0.135
"""Inches from the panel to the legend, and from one of its lines to the next."""
SHAPE = 0.62
"""Height of a panel over its width, where cells would be too narrow as squares."""

LONGEST_CAPTION = 400


class _Scale(NamedTuple):
    """A layer in colours, (ny, nx, 3) uint8, and what explains them: a bar from low to high, or names."""

    colours: np.ndarray
    ends: tuple[float, float] | None = None
    bar: np.ndarray | None = None
    names: tuple[tuple[str, tuple[int, int, int]], ...] = ()


def picture(of: Found, layer: str = "transient", *, width_mm: float = 86.0, periods: float | None = None) -> Picture:
    """Return the picture of a layer: :meth:`bow.Map.plot` is this."""
    if layer not in LAYERS:
        raise ValueError(f"layer {layer!r}: should be one of {', '.join(LAYERS)}")
    if not NARROWEST_MM <= width_mm <= WIDEST_MM:
        raise ValueError(f"width_mm = {width_mm:g}: should be {NARROWEST_MM:g} ... {WIDEST_MM:g}")
    scale, when = _scale(of, layer, periods)
    with style():
        figure = _drawn(of, layer, scale, width_mm * MM)
    words = f"{LAYERS[layer]}{when}"
    return Picture(figure, words)


def full_caption(of: Found, layer: str = "transient", periods: float | None = None) -> str:
    """Return what belongs below the picture in a paper: the layer, the string and what is the same in all cells."""
    _, when = _scale(of, layer, periods)
    return f"{LAYERS[layer]}{when}: {' '.join(caption(of.file, LONGEST_CAPTION))}"


def _scale(of: Found, layer: str, periods: float | None) -> tuple[_Scale, str]:
    """Return a layer in colours, and the time of its test in words."""
    found = of.file
    if layer in ("transient", "terrain"):
        if periods is not None:
            raise ValueError(f"periods = {periods:g}: layer {layer!r} is of all tests together; leave it out")
        if layer == "terrain":
            return _codes(of.terrain_codes, TERRAINS, TERRAIN_COLOURS, terrain_label), ""
        return _transient(of), ""
    tests = found.test_periods.tolist()
    if periods is not None and periods not in tests:
        raise ValueError(f"periods = {periods:g}: should be one of the tests, {tests[0]} ... {tests[-1]} by fives")
    when = f" after {periods or tests[-1]:g} periods"
    at = tests.index(periods) if periods is not None else -1
    if layer == "regime":
        codes = found.regime if periods is None or found.regimes is None else found.regimes[at]
        return _codes(codes, found.regime_names, regime_colours(found.regime_names), regime_label), when
    values = getattr(found, layer)
    if values is None:
        raise ValueError(f"layer {layer!r}: this map, of an older version of bow, does not have it")
    low, high = TEST_RANGES.get(layer, (0.0, 1.0))
    shown = np.asarray(values[at], float)
    colours = viridis((np.nan_to_num(shown) - low) / (high - low))
    colours[np.isnan(shown)] = GREY
    missing = (("none", GREY),) if np.isnan(shown).any() else ()
    return _Scale(colours, (low, high), viridis(np.linspace(0, 1, 256)), missing), when


def _transient(of: Found) -> _Scale:
    lengths, longest = of.transient_periods, of.file.periods
    bar = np.linspace(1e-6, longest, 256)
    names = [(name, colour) for name, colour, there in (
        ("never", BLACK, (lengths == 0).any()), ("not computed", GREY, np.isnan(lengths).any())) if there]  # fmt: skip
    return _Scale(transient_colours(lengths, longest), (0, longest), transient_colours(bar, longest), tuple(names))


def _codes(codes: np.ndarray, names: Any, colours: Any, label: Any) -> _Scale:
    table = np.full((256, 3), GREY, np.uint8)
    table[: len(colours)] = colours
    there = np.bincount(codes.ravel(), minlength=256)
    shown = [(label(name), tuple(colours[code])) for code, name in enumerate(names) if there[code]]
    if there[len(names) :].any():
        shown.append(("not computed", GREY))
    return _Scale(table[codes], names=tuple(shown))


def _drawn(of: Found, layer: str, scale: _Scale, width: float) -> Figure:
    """Draw a panel with its legend below; lengths are inches."""
    across = width - LEFT - RIGHT
    ny, nx = of.shape
    tall = across * min(1.0, max(SHAPE, ny / nx))
    columns = max(1, int(across / 1.2))
    lines = -(-len(scale.names) // columns)
    bar = 0.42 if scale.ends else 0.0
    below = BELOW_AXIS + bar + LINE * lines + 0.05
    height = TOP + tall + below
    figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    ax = figure.add_axes((LEFT / width, below / height, across / width, tall / height))
    paint(ax, of.file, scale.colours)
    x, y = of.axes
    ax.set_xlabel(_symbol(x), fontsize=8, labelpad=2)
    ax.set_ylabel(_symbol(y), fontsize=8, labelpad=2)
    ax.tick_params(labelsize=7)
    if scale.ends and scale.bar is not None:
        at = (LEFT / width, (below - BELOW_AXIS - 0.09) / height, across / width, 0.09 / height)
        _bar(figure.add_axes(at), scale, LAYERS[layer])
    if scale.names:
        patches = [Patch(facecolor=_share(c), edgecolor="0.3", lw=0.4, label=name) for name, c in scale.names]
        place: Any = {
            "loc": "lower left",
            "bbox_to_anchor": (LEFT / width, 0.0),
            "borderaxespad": 0.1,
            "borderpad": 0.2,
        }
        figure.legend(handles=patches, ncols=columns, fontsize=6.5, frameon=False, handlelength=1.2,
                      handleheight=0.9, columnspacing=1.0, labelspacing=0.3, **place)  # fmt: skip
    return figure


def _share(colour: tuple[int, int, int]) -> tuple[float, float, float]:
    red, green, blue = (channel / 255 for channel in colour)
    return red, green, blue


def _bar(ax: Axes, scale: _Scale, words: str) -> None:
    assert scale.bar is not None and scale.ends is not None
    ax.imshow(scale.bar[None], aspect="auto", extent=(*scale.ends, 0, 1), interpolation="nearest")
    ax.set_yticks([])
    ax.tick_params(labelsize=6.5, length=2, pad=1.5)
    ax.set_xlabel(words, fontsize=7, labelpad=1)


def _symbol(axis: PlotAxis) -> str:
    """Return the symbol of an axis with its unit."""
    title = axis.title()
    symbol = title.partition("  ")[2].partition("  (")[0] or title.partition("  (")[0]
    unit = unit_of(axis.name).replace("v_b", "$v_b$").replace("Y_T", "$Y_T$")
    return f"{symbol}  ({unit})" if unit else symbol
