"""Two runs side by side: which cell of one is nearest to a cell of the other, and in which parameters they differ."""

from __future__ import annotations

import numpy as np

from bow_sim.physics.parameters import FIELDS
from bow_sweep.maps.map_file import MapFile
from bow_sweep.maps.plane import Plane

_PLANE = ("x.", "y.")
"""Settings of a plane: they show on the axes, and are no difference of the strings."""


def same_plane(one: Plane, other: Plane) -> bool:
    """Return whether two maps have the same cells: the same parameters on the axes, with the same values."""
    return (
        (one.x_name, one.y_name, one.shape) == (other.x_name, other.y_name, other.shape)
        and np.allclose(one.x, other.x, rtol=1e-9, atol=1e-12)
        and np.allclose(one.y, other.y, rtol=1e-9, atol=1e-12)
    )


def nearest_cells(one: MapFile, other: MapFile) -> np.ndarray:
    """Return for each cell of one map the cell of the other whose parameters are nearest to it.

    A parameter on an axis of `other` that is no axis of `one` has the same value in all cells of `one`: its setting.

    Returns
    -------
    ndarray
        (cells of `one`,) int32, indices iy * nx + ix in `other`.
    """
    ny, nx = one.shape
    place = {one.x_name: (np.arange(ny * nx) % nx, one.x), one.y_name: (np.arange(ny * nx) // nx, one.y)}
    index = []
    for axis in other.axes:
        if axis.name in place:
            cells, values = place[axis.name]
            nearest = np.array([_nearest(axis.values, axis.scale, float(value)) for value in values])
            index.append(nearest[cells])
        else:
            value = _setting(one, axis.name)
            index.append(np.full(ny * nx, 0 if value is None else _nearest(axis.values, axis.scale, value)))
    return np.asarray(index[1] * len(other.x) + index[0], np.int32)


def _nearest(values: np.ndarray, scale: str, value: float) -> int:
    """Return the index of the nearest value in steps of the axis; the nearer end for one beyond it."""
    if scale == "log":
        if value <= 0:
            return int(np.argmin(values))
        return int(np.argmin(np.abs(np.log(values) - np.log(value))))
    return int(np.argmin(np.abs(values - value)))


def _setting(plane: Plane, name: str) -> float | None:
    """Return the value that all cells of a map have of a parameter; None where it is not a number."""
    field = FIELDS.get(name)
    try:
        return float(plane.values.get(name, field.default if field else ""))  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return None


def differences(one: Plane, other: Plane) -> list[tuple[str, str, str]]:
    """Return the settings in which two maps differ beside their axes: (name, value in one, value in the other)."""
    axes = {one.x_name, one.y_name, other.x_name, other.y_name}
    found = []
    for name in sorted({*one.values, *other.values} - axes):
        if name.startswith(_PLANE) or name not in FIELDS:
            continue
        first, second = (_text(plane, name) for plane in (one, other))
        if first != second:
            found.append((name, first, second))
    return found


def _text(plane: Plane, name: str) -> str:
    value = str(plane.values.get(name, FIELDS[name].default))
    try:
        return f"{float(value):g}"
    except ValueError:
        return value if len(value) <= 30 else value[:27] + "..."
