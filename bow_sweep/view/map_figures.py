"""Pictures of finished maps as files: one map, its tests, several maps together."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from bow_sim.figures.page import METADATA, save
from bow_sweep.maps.map_file import MapFile, MapFileError
from bow_sweep.maps.plane import TEST_LAYERS, Plane
from bow_sweep.view import pictures


def draw_map(plane: Plane, path: str | Path, dpi: float = 200) -> None:
    """Draw transient length over the plane, in the manner of the paper's Fig 11, and the final regimes below.

    Parameters
    ----------
    plane
        A :class:`MapFile`, or a :class:`~bow_sweep.maps.plane.Snapshot` of a map that still grows.
    path
        Ends in .png, .svg or .pdf; replaced whole.
    dpi
        Dots an inch of a .png; every cell is a whole number of them wide and high.

    Raises
    ------
    MapFileError
        For another suffix.
    """
    place = _drawable(path)
    _save(place, pictures.map_figure(plane, dpi))


def draw_tests(result: MapFile, path: str | Path, periods: int | None = None, dpi: float = 200) -> None:
    """Draw the three tests and their verdict after `periods` (the end unless given): the paper's Fig 10.

    Raises
    ------
    MapFileError
        For another suffix than .png, .svg and .pdf, or where no test was made after `periods`.
    """
    place = _drawable(path)
    made = [int(length) for length in result.test_periods]
    periods = made[-1] if periods is None else periods
    if periods not in made:
        raise MapFileError(f"periods = {periods}: no test was made then, but after {_listed(made)}")
    index = made.index(periods)
    layers = {name: getattr(result, name)[index] for name in (*TEST_LAYERS, "helmholtz")}
    _save(place, pictures.tests_figure(result, layers, periods, dpi))


def draw_maps(planes: Iterable[tuple[str, Plane]], path: str | Path, dpi: float = 200) -> None:
    """Draw several maps two abreast on one scale: the whole of the paper's Fig 11. Each comes with its title.

    Raises
    ------
    MapFileError
        For another suffix than .png, .svg and .pdf, or no maps.
    """
    place, listed = _drawable(path), list(planes)
    if not listed:
        raise MapFileError("no maps to draw: should be at least one")
    _save(place, pictures.maps_figure(listed, dpi))


def _listed(numbers: list[int]) -> str:
    return ", ".join(map(str, numbers if len(numbers) < 8 else [*numbers[:3], "...", numbers[-1]]))


def _drawable(path: str | Path) -> Path:

    path = Path(path)
    if path.suffix.lower() not in METADATA:
        known = ", ".join(METADATA)
        raise MapFileError(f"{path}: cannot draw as {path.suffix or 'a file without a suffix'}; should be {known}")
    return path


def _save(path: Path, figure: Any) -> None:

    save(figure, path)
