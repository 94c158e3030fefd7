"""Several maps compared: playability with uncertainties, and the settings that differ."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bow.maps import Map, open_run
from bow.shown import Picture
from bow_sweep.maps import compare as terrain_comparison
from bow_sweep.maps.compare import Compared
from bow_sweep.maps.differing import program_of, typed
from bow_sweep.maps.map_file import MapFileError
from bow_sweep.maps.playability import MEASURES


class Difference(NamedTuple):
    """By how much a measure is greater in one map than in the first.

    Attributes
    ----------
    value
        None where one of the two has no value.
    error
        None for small maps, whose uncertainty is not known.
    sure
        Whether it is above three errors, and is seen on the coarser grids too.
    """

    value: float | None
    error: float | None
    sure: bool


class Comparison:
    """How maps differ from the first of them. :func:`bow.compare` makes it; printed, it is a table.

    Parameters
    ----------
    names
        Short names of the maps.
    maps
        Two or more.
    """

    def __init__(self, names: tuple[str, ...], maps: tuple[Map, ...]) -> None:
        self.names = names
        self.maps = maps
        self.compared = tuple(
            Compared(name, each.file, each.terrain_codes, each.numbers, program_of(each.directory))
            for name, each in zip(names, maps, strict=True)
        )

    @property
    def differences(self) -> dict[str, dict[str, Difference]]:
        """Name of a map -> name of a measure -> its difference from the first map."""
        first, *others = self.compared
        return {
            other.name: {
                entry.name: Difference(
                    *terrain_comparison.difference(first, other, entry.name),
                    terrain_comparison.sure(first, other, entry.name),
                )
                for entry in MEASURES
            }
            for other in others
        }

    @property
    def settings(self) -> dict[str, tuple[Any, ...]]:
        """The settings that are not the same in all maps: name -> value in each, presets first.

        "an axis" stands where a parameter is an axis of a map; None where nothing is known.
        """
        found = terrain_comparison.settings_that_differ(self.compared)
        return {each.name: tuple(typed(value) for value in each.values) for each in found}

    @property
    def made_by(self) -> dict[str, tuple[Any, ...]]:
        """What of kernel, classifier, machine and versions is not the same in all runs; {} for computed maps."""
        return {each.name: each.values for each in terrain_comparison.programs_that_differ(self.compared)}

    @property
    def notes(self) -> list[str]:
        """What limits the comparison, a sentence each."""
        return terrain_comparison.notes(self.compared)

    def as_dict(self) -> dict[str, Any]:
        """Return everything in plain values, as `bow compare --json` prints it."""
        return terrain_comparison.as_json(self.compared)

    def plot(self) -> Picture:
        """Return a picture: maps, their terrain, and the measures with error bars."""
        from bow_sweep.figures.terrain import comparison

        panels = [(f"{each.name}   {each.title}", each.plane, each.codes) for each in self.compared]
        figure = comparison(panels, self.names, [each.numbers for each in self.compared])
        return Picture(figure, f"comparison of {', '.join(self.names)}")

    def __str__(self) -> str:
        two = len(self.maps) == 2
        settings = terrain_comparison.settings_that_differ(self.compared)
        rows = [["setting", *self.names]] if settings else [["no setting differs"]]
        rows += [[each.name, *(f"{value} {each.unit}".rstrip() for value in each.values)] for each in settings]
        rows += [[], ["measure", *self.names, *(["difference"] * two)]]
        for entry in MEASURES:
            values = [terrain_comparison.value_and_error(each.numbers, entry.name) for each in self.compared]
            row = [f"{entry.title}{f', {entry.unit}' if entry.unit else ''}", *(entry.text(*each) for each in values)]
            if two:
                step = self.differences[self.names[1]][entry.name]
                row.append(entry.text(step.value, step.error, signed=True) + (" *" if step.sure else ""))
            rows.append(row)
        if made_by := self.made_by:
            rows += [[], *([name, *(str(value) for value in values)] for name, values in made_by.items())]
        widths = [max(len(row[i]) for row in rows if i < len(row)) for i in range(max(map(len, rows)))]
        lines = [
            "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=False)).rstrip() for row in rows
        ]
        lines += [f"note: {note}" for note in self.notes]
        return "\n".join(lines + ["* is sure"] * two)

    __repr__ = __str__

    def _repr_png_(self) -> bytes:
        return self.plot()._repr_png_()


def compare(*maps: Map | str | Path, names: tuple[str, ...] | None = None) -> Comparison:
    """Compare maps: how easy the string is to play in each, and which settings differ.

    Parameters
    ----------
    *maps
        Two or more, or the directories of runs.
    names
        Short names of them; None: those of their directories, or "1", "2" ...

    Raises
    ------
    MapFileError
        Where there are fewer than two maps, or one has no computed cell. It is a ValueError.

    Examples
    --------
    >>> import bow
    >>> a = bow.sweep("fig11d", nx=8, ny=4, periods=20, progress=False)
    >>> b = bow.sweep("fig11c", nx=8, ny=4, periods=20, progress=False)
    >>> found = bow.compare(a, b, names=("stiff", "delta"))
    >>> found.settings["model"]
    ('stiff_cremer', 'delta_cremer')
    >>> found.differences["delta"]["helmholtz"].sure
    False
    """
    found = tuple(each if isinstance(each, Map) else open_run(each) for each in maps)
    if len(found) < 2:
        raise MapFileError(f"{len(found)} map given; should be two at least")
    given = names or _names(found)
    if len(given) != len(found) or len(set(given)) < len(found):
        raise ValueError(f"names = {given!r}: should be {len(found)} different names")
    for name, each in zip(given, found, strict=True):
        if np.isnan(each.transient_periods).all():
            raise MapFileError(f"{name}: none of its cells is computed; should be some, see bow sweep --resume")
    return Comparison(tuple(given), found)


def _names(maps: tuple[Map, ...]) -> tuple[str, ...]:
    directories = [each.directory for each in maps]
    known = [directory for directory in directories if directory is not None]
    if len(known) == len(maps) and len({path.resolve() for path in known}) == len(maps):
        return tuple(terrain_comparison.names(known))
    return tuple(str(number) for number in range(1, len(maps) + 1))
