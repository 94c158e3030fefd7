"""What a panel of a map shows: a layer in colours, and what explains them, a scale or names. Plain arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bow_sweep.figures.colours import (
    BLACK,
    GREY,
    TERRAIN_COLOURS,
    regime_colours,
    transient_colours,
    viridis,
)
from bow_sweep.maps.map_file import MapFile
from bow_sweep.maps.plane import TEST_RANGES, regime_label, terrain_label

Colour = tuple[int, int, int]

LAYERS = {
    "transient": "periods until Helmholtz motion",
    "regime": "regime",
    "correlation": "correlation of successive periods",
    "confidence": "probability that the regime is right",
    "terrain": "terrain",
    "reliability": "share of repeats that end alike",
    "slips": "significant slips in five periods",
    "corners": "travelling corners in five periods",
}
"""The layers, and what each shows."""

AT_A_TEST = ("regime", "correlation", "confidence", "slips", "corners")
"""The layers with a value for each test."""

LETTERS = {
    "no_oscillation": "N",
    "helmholtz": "H",
    "multiple_slip": "S",
    "multiple_flyback": "F",
    "other_periodic": "P",
    "aperiodic": "A",
    "helmholtz_extra_slips": "E",
    "raman_higher": "R",
    "anomalous_low_frequency": "L",
    "subharmonic": "U",
    "wolf": "W",
}
"""A letter for each regime, for prints without colours and for those who cannot distinguish them."""


class LayerError(ValueError):
    """A map cannot be drawn as asked; the message says which layers or tests it has."""


@dataclass(frozen=True)
class Panel:
    """A panel of a figure.

    Attributes
    ----------
    plane
        The map.
    layer
        One of `LAYERS`.
    periods
        Time of the test; None: the last.
    title
        Above the panel; "" for none.
    """

    plane: MapFile
    layer: str = "transient"
    periods: float | None = None
    title: str = ""


class Shown(NamedTuple):
    """A layer in colours, and what explains them.

    Attributes
    ----------
    colours
        (ny, nx, 3) uint8.
    words
        What it shows.
    ends
        Lowest and highest value of the scale; None for names.
    bar
        (steps, 3) uint8, the colours of the scale from low to high.
    names
        Of colours that are not on the scale, or of all: label, colour and letter ("" for none).
    codes
        (ny, nx) uint8 index into `names`, for layers of names; else None.
    """

    colours: np.ndarray
    words: str
    ends: tuple[float, float] | None = None
    bar: np.ndarray | None = None
    names: tuple[tuple[str, Colour, str], ...] = ()
    codes: np.ndarray | None = None


def available(plane: MapFile) -> list[str]:
    """Return the names of the layers that a map has."""
    always = ("transient", "regime", "terrain")
    return [name for name in LAYERS if name in always or getattr(plane, name) is not None]


def shown(plane: MapFile, layer: str, periods: float | None = None, longest: float | None = None) -> Shown:
    """Return a layer of a map in colours.

    Parameters
    ----------
    layer
        One of `LAYERS`.
    periods
        Time of the test, for a layer of `AT_A_TEST`; None: the last test.
    longest
        Periods at the end of the scale of transient lengths; None: those of this map.

    Raises
    ------
    LayerError
        For a layer or a test that the map does not have.
    """
    if layer not in LAYERS:
        raise LayerError(f"layer {layer!r}: should be one of {', '.join(LAYERS)}")
    if layer not in available(plane):
        why = "a sweep without repeats" if layer == "reliability" else "a run of an older version"
        raise LayerError(f"layer {layer!r}: not in this map, of {why}; it has {', '.join(available(plane))}")
    at = index_of_test(plane, layer, periods)
    if layer == "transient":
        return _transient(plane.transient_periods, longest or plane.periods)
    if layer == "terrain":
        from bow_sweep.maps.terrain import TERRAINS, terrain  # needs scipy

        return _named(terrain(plane.transient_periods), TERRAINS, TERRAIN_COLOURS, terrain_label, {}, layer)
    if layer == "regime":
        codes = plane.regime if at is None or plane.regimes is None else plane.regimes[at]
        return _named(codes, plane.regime_names, regime_colours(plane.regime_names), regime_label, LETTERS, layer)
    if layer == "reliability":
        assert plane.reliability is not None
        return _numbers(plane.reliability.reliability, (0.0, 1.0), layer, "not computed")
    low, high = TEST_RANGES.get(layer, (0.0, 1.0))
    return _numbers(getattr(plane, layer)[at if at is not None else -1], (low, high), layer, "none")


def index_of_test(plane: MapFile, layer: str, periods: float | None) -> int | None:
    """Return the index of the test after `periods`; None for the last one, and for layers of all tests together.

    Raises
    ------
    LayerError
        Where there is none.
    """
    if periods is None:
        return None
    if layer not in AT_A_TEST:
        raise LayerError(f"periods = {periods:g}: layer {layer!r} is of all tests together; leave it out")
    tests = plane.test_periods.tolist()
    if periods not in tests:
        raise LayerError(f"periods = {periods:g}: should be one of the tests, {tests[0]} ... {tests[-1]} by fives")
    if layer == "regime" and plane.regimes is None and periods != tests[-1]:
        raise LayerError(f"periods = {periods:g}: this map, of an older version, has the regimes of the last test only")
    return int(tests.index(periods))


def _transient(lengths: np.ndarray, longest: float) -> Shown:
    bar = np.linspace(longest / 256, longest, 256)
    extra = (("never", BLACK, (lengths == 0).any()), ("not computed", GREY, np.isnan(lengths).any()))
    names = tuple((name, colour, "") for name, colour, there in extra if there)
    colours = transient_colours(lengths, longest)
    return Shown(colours, LAYERS["transient"], (0.0, longest), transient_colours(bar, longest), names)


def _numbers(values: np.ndarray, ends: tuple[float, float], layer: str, missing: str) -> Shown:
    low, high = ends
    values = np.asarray(values, float)
    colours = viridis((np.nan_to_num(values) - low) / (high - low))
    colours[np.isnan(values)] = GREY
    names = ((missing, GREY, ""),) if np.isnan(values).any() else ()
    return Shown(colours, LAYERS[layer], ends, viridis(np.linspace(0, 1, 256)), names)


def _named(
    codes: np.ndarray,
    names: Sequence[str],
    colours: Sequence[Colour],
    label: Callable[[str], str],
    letters: dict[str, str],
    layer: str,
) -> Shown:
    table = np.full((256, 3), GREY, np.uint8)
    table[: len(colours)] = colours
    there = np.bincount(codes.ravel(), minlength=256)
    kept = [code for code in range(len(names)) if there[code]]
    listed = [(label(names[code]), colours[code], letters.get(names[code], "")) for code in kept]
    index = np.full(256, len(kept), np.uint8)
    index[kept] = np.arange(len(kept))
    if there[len(names) :].any():
        listed.append(("not computed", GREY, ""))
    return Shown(table[codes], LAYERS[layer], names=tuple(listed), codes=index[codes])
