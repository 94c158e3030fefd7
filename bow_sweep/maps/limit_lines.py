"""The limits of a map as lines in its pictures, with labels and captions."""

from __future__ import annotations

import math
import textwrap
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_sweep.maps.axes import PlotAxis
from bow_sweep.maps.limits import LABELS, TITLES, Limit, limits, why_no_bounds
from bow_sweep.maps.plane import Plane

BETWEEN = 16
"""Points between two of a curve where it is drawn."""


class Drawn(NamedTuple):
    """A limit in a picture of a map.

    Parameters
    ----------
    limit : Limit
    runs : tuple of ndarray, each (points, 2)
        What of it lies within the axes, positions in cells.
    label : tuple of float
        Position of its label, cells.
    """

    limit: Limit
    runs: tuple[NDArray[np.float64], ...]
    label: tuple[float, float]


def drawn(plane: Plane) -> tuple[Drawn, ...]:
    """Return the limits that lie within the axes of a map, with positions for lines and labels."""
    found: list[Drawn] = []
    for limit in limits(plane):
        runs = _inside(plane, limit)
        if runs:
            found.append(Drawn(limit, runs, _label(plane, runs, [each.label for each in found], len(found))))
    return tuple(found)


def _inside(plane: Plane, limit: Limit) -> tuple[NDArray[np.float64], ...]:
    """Return the parts of a limit within the axes, positions in cells, each (points, 2)."""
    x, y = plane.axes
    points = np.array([(_position(x, a), _position(y, b)) for a, b in zip(limit.x, limit.y, strict=True)])
    steps = np.arange(BETWEEN * (len(points) - 1) + 1) / BETWEEN
    fine = np.column_stack([np.interp(steps, np.arange(len(points)), column) for column in points.T])
    ny, nx = plane.shape
    inside = np.isfinite(fine).all(axis=1) & (fine >= 0).all(axis=1) & (fine <= (nx, ny)).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    return tuple(fine[first:last] for first, last in edges.reshape(-1, 2) if last - first > 1)


def _position(axis: PlotAxis, value: float) -> float:
    if not math.isfinite(value) or (axis.scale == "log" and value <= 0):
        return math.nan
    return axis.position(value)


def _label(
    plane: Plane, runs: tuple[NDArray[np.float64], ...], taken: list[tuple[float, float]], number: int
) -> tuple[float, float]:
    """Return where the label of a limit is best: within the map, off its edges and away from other labels."""
    ny, nx = plane.shape
    points = np.concatenate(runs)
    shares = points / (nx, ny)
    room = np.minimum(shares, 1 - shares)
    good = np.minimum(room[:, 0] / 0.08, 1) + np.minimum(room[:, 1] / 0.1, 1)
    for x, y in taken:
        away = np.abs(shares - np.array([x / nx, y / ny]))
        good = good + np.minimum(np.maximum(away[:, 0] / 0.2, away[:, 1] / 0.15), 1)
    wanted = np.abs(np.linspace(0, 1, len(points)) - (0.7, 0.3)[number % 2])
    x, y = points[int(np.argmax(good - 0.2 * wanted))]
    return float(x), float(y)


def limit_lines(plane: Plane, width: int) -> list[str]:
    """Return formulas and inputs of the limits, and which lie outside of the axes, as lines for a caption.

    Parameters
    ----------
    width
        Letters in a line, where words allow it.
    """
    found = limits(plane)
    shown = {each.limit.name for each in drawn(plane)}
    lines: list[str] = _wrapped(why_no_bounds(plane) or "", width)
    same_inputs = len({each.inputs for each in found}) == 1
    for each in found:
        where = "" if each.name in shown else f"{TITLES[each.name]} lies outside of the axes: "
        told = not same_inputs or each is found[-1]
        lines += _wrapped(f"{where}{each.formula}" + f", {each.inputs}" * told, width)
    return lines


def limit_note(plane: Plane, where: str) -> list[str]:
    """Return a line that says what the lines over a map are, where there is no space for formulas; else [].

    Parameters
    ----------
    where
        Where the formulas are.
    """
    found = limits(plane)
    if not found:
        return [why] if (why := why_no_bounds(plane)) else []
    shown = {each.limit.name for each in drawn(plane)}
    words = [f"{LABELS[each.name]}: {TITLES[each.name]}" for each in found if each.name in shown]
    words += [f"{TITLES[each.name]} lies outside of the axes" for each in found if each.name not in shown]
    return [", ".join(words) + f" ({where})"]


def _wrapped(text: str, width: int) -> list[str]:
    return textwrap.wrap(text, width, break_long_words=False, break_on_hyphens=False, subsequent_indent="    ")
