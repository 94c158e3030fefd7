"""Several maps compared: their terrain, and how easy the string is to play in each (section IV.B)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bow_sweep.maps import differing
from bow_sweep.maps.differing import Differing, differing_programs, differing_settings, program_of
from bow_sweep.maps.map_file import MapFile, MapFileError, read_map
from bow_sweep.maps.plane import MODEL_NAMES
from bow_sweep.maps.playability import MEASURES, playability
from bow_sweep.maps.terrain import terrain

SURE = 3.0
"""A difference is significant above this number of errors."""


@dataclass(frozen=True, eq=False)
class Compared:
    """A run in a comparison.

    Attributes
    ----------
    name
        Of its directory, or of its map.npz.
    plane
        Its map.
    codes
        (ny, nx) uint8, its terrain.
    numbers
        Its playability, see :func:`bow_sweep.maps.playability.playability`.
    program
        What made it, see :func:`bow_sweep.maps.differing.program_of`.
    """

    name: str
    plane: MapFile
    codes: np.ndarray
    numbers: dict[str, Any]
    program: Mapping[str, str] = field(default_factory=dict)

    @property
    def title(self) -> str:
        """Model, v_mid and grid of the run, as text."""
        given = self.plane.values
        words = [MODEL_NAMES.get(given.get("model", ""), given.get("model", ""))]
        if "v_mid" in given:
            words.append(f"v_mid {float(given['v_mid']):g}")
        ny, nx = self.plane.shape
        return ", ".join(filter(None, (*words, f"{nx} × {ny}")))


def compare(runs: Sequence[Path]) -> list[Compared]:
    """Read runs, directories or map.npz files, and measure them.

    Raises
    ------
    MapFileError
        Where there are fewer than two runs, or one has no map, or a map without computed cells.
    """
    if len(runs) < 2:
        raise MapFileError(f"{len(runs)} run given; should be two at least")
    found = []
    for run, name in zip(runs, names(runs), strict=True):
        plane = read_map(run)
        if np.isnan(plane.transient_periods).all():
            raise MapFileError(f"{run}: none of its cells is computed; should be some, see bow sweep --resume")
        numbers = playability(plane.transient_periods, plane.regime, plane.regime_names)
        found.append(Compared(name, plane, terrain(plane.transient_periods), numbers, program_of(run)))
    return found


def names(runs: Sequence[Path]) -> list[str]:
    """Return a short name of each run: the end of its path, as long as is needed to distinguish the runs."""
    parts = [run.resolve().parts for run in runs]
    for length in range(1, max(map(len, parts)) + 1):
        short = ["/".join(part[-length:]) for part in parts]
        if len(set(short)) == len(set(parts)):
            return short
    return [str(run) for run in runs]


def difference(one: Compared, other: Compared, name: str) -> tuple[float | None, float | None]:
    """Return by how much a measure is greater in `other` than in `one`, and the error of this; None where unknown."""
    (first, error), (second, other_error) = (value_and_error(each.numbers, name) for each in (one, other))
    if first is None or second is None:
        return None, None
    if error is None or other_error is None:
        return second - first, None
    return second - first, math.hypot(error, other_error)


def settings_that_differ(found: Sequence[Compared]) -> list[Differing]:
    """Return presets and settings that are not the same in all runs."""
    planes = [each.plane for each in found]
    return differing_settings([plane.values for plane in planes], [plane.preset for plane in planes])


def programs_that_differ(found: Sequence[Compared]) -> list[Differing]:
    """Return what of kernel, classifier, machine and versions is not the same in all runs."""
    return differing_programs([each.program for each in found])


def value_and_error(numbers: dict[str, Any], name: str) -> tuple[float | None, float | None]:
    """Return the value of a measure and its error; None where unknown."""
    return numbers[name]["value"], numbers[name]["error"]


def notes(found: Sequence[Compared]) -> list[str]:
    """Return what limits a comparison of these runs, one line each."""
    result = []
    first = found[0].plane
    for each in found:
        missing = int(np.isnan(each.plane.transient_periods).sum())
        if missing:
            result.append(f"{each.name}: {missing} cells are not computed and left out")
    for each in found[1:]:
        plane = each.plane
        if (plane.x_name, plane.y_name) != (first.x_name, first.y_name) or not np.allclose(
            (plane.x[0], plane.x[-1], plane.y[0], plane.y[-1]), (first.x[0], first.x[-1], first.y[0], first.y[-1])
        ):
            result.append(f"{each.name} is another plane than {found[0].name}: shares of the two are not comparable")
        elif plane.shape != first.shape:
            result.append(f"{each.name} has another grid than {found[0].name}: boundary and terrain depend on the grid")
        if plane.periods != first.periods:
            result.append(f"{each.name} is {plane.periods:g} periods long, {found[0].name} {first.periods:g}")
    return result


def sure(one: Compared, other: Compared, name: str) -> bool:
    """Return whether a difference is significant.

    It must be greater than `SURE` errors, and at least half as great on grids of half the density: an area of terrain
    may be too small for the coarser grids.
    """
    step, error = difference(one, other, name)
    if step is None or error is None:
        return False
    coarse = other.numbers[name]["half_grid"] - one.numbers[name]["half_grid"]
    return abs(step) > SURE * error and coarse * step >= step * step / 2


def as_json(found: Sequence[Compared]) -> dict[str, Any]:
    """Return the comparison for JSON: the measures of each run, and its differences from the first run."""
    runs = [
        {"run": each.name, "map": each.title, "sweep_id": each.plane.sweep_id, "playability": each.numbers}
        for each in found
    ]
    steps = []
    for each in found[1:]:
        entry: dict[str, Any] = {"from": found[0].name, "to": each.name}
        for measure in MEASURES:
            step, error = difference(found[0], each, measure.name)
            entry[measure.name] = {"value": step, "error": error, "sure": sure(found[0], each, measure.name)}
        steps.append(entry)
    return {
        "settings": differing.as_json(settings_that_differ(found)),
        "made_by": differing.as_json(programs_that_differ(found)),
        "runs": runs,
        "differences": steps,
        "notes": notes(found),
    }
