"""A study: a family of maps over further parameters, computed in this process or recorded by `bow study`."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bow.maps import Map, open_run
from bow.optional import library
from bow.sweeps import AxisGiven, computed, given_settings, written
from bow.tables import PACKED
from bow_sim.atomic_files import sync_directory
from bow_sim.physics.errors import ParameterError
from bow_sweep.maps.playability import MEASURES
from bow_sweep.run.directory import CAMPAIGN, STUDY
from bow_sweep.study.campaigns import study_in
from bow_sweep.study.over import Over, over_of
from bow_sweep.study.plan import Study as Plan
from bow_sweep.study.plan import short
from bow_sweep.study.report import Report, contents, measured, read_runs, text
from bow_sweep.study.usual import overs_of

if TYPE_CHECKING:
    import xarray

    from bow.shown import Picture

OverGiven = Mapping[str, "str | Sequence[object]"] | Iterable[str]

LAYERS = ("transient_periods", "regime", "terrain", "count", "flattening", "regressions", "simulated")
"""Layers of a map in the dataset of a study, unless those of every test are asked for."""

LAST = "the layers are those of the last test; s.dataset(tests=True) and s.to_netcdf(path, tests=True) have all tests"
ALL = "the layers are those of all tests, and of the last one"


class Study:
    """A family of maps over further parameters. :func:`bow.study` computes one, :func:`bow.open` reads one.

    Printed, it is the table of `bow study`.

    Parameters
    ----------
    plan
        What was asked.
    maps
        In order; the last further parameter changes fastest.
    report
        The contents of study.json.
    directory
        Of a recorded study; None for one that was computed in this process.

    Examples
    --------
    >>> import bow
    >>> s = bow.study("fig11d", {"mu_s": [0.8, 1.2]}, nx=4, ny=4, periods=20, progress=False)
    >>> s.shape, s.parameters["mu_s"]
    ((2,), [0.8, 1.2])
    >>> s.table["helmholtz"].shape
    (2,)
    >>> s.at(mu_s=0.8).settings["mu_s"]
    0.8
    """

    def __init__(self, plan: Plan, maps: Sequence[Map], report: Report, directory: Path | None = None) -> None:
        self.plan = plan
        self.maps = tuple(maps)
        self.report = report
        self.directory = directory

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each further parameter."""
        return self.plan.shape

    @property
    def parameters(self) -> dict[str, list[float | str]]:
        """Further parameter -> its values."""
        return {over.name: _values(over) for over in self.plan.overs}

    def at(self, **values: float | str) -> Map:
        """Return the map of some values of the further parameters: of numbers, the nearest is taken.

        Raises
        ------
        ValueError
            Where a further parameter is not given, or is none of this study.
        """
        names = [over.name for over in self.plan.overs]
        if sorted(values) != sorted(names):
            raise ValueError(f"at({', '.join(values)}): should name {', '.join(names)}")
        place = tuple(_nearest(over, values[over.name]) for over in self.plan.overs)
        return self.maps[int(np.ravel_multi_index(place, self.shape))]

    @cached_property
    def table(self) -> dict[str, np.ndarray]:
        """A row for each map: the further parameters, each measure, and its standard error after "_error".

        Shares are 0 ... 1; NaN where there is nothing to measure, or a map is too small for an error. For pandas:
        ``pandas.DataFrame(s.table)``.
        """
        entries = self.report["maps"]
        out = {name: np.array([entry["values"][name] for entry in entries]) for name in self.parameters}
        for entry in MEASURES:
            found = [measured(each["playability"], entry.name) for each in entries]
            out[entry.name] = _floats(each.value for each in found)
            out[f"{entry.name}_error"] = _floats(each.error for each in found)
        return out

    @cached_property
    def ds(self) -> xarray.Dataset:
        """All maps as one xarray.Dataset, with a dimension for each further parameter.

        It has the layers of the last test, as its attribute `tests` says, and every measure of playability with its
        error.

        Raises
        ------
        MissingLibrary
            Where xarray is not installed; it is an ImportError.
        ValueError
            Where the maps are not of one plane.
        """
        return self.dataset()

    def dataset(self, *, tests: bool = False) -> xarray.Dataset:
        """Return `ds`, with `tests` also the layers of every test, along a dimension `test`: some 30 times as much.

        Raises
        ------
        MissingLibrary
            Where xarray is not installed; it is an ImportError.
        ValueError
            Where the maps are not of one plane, or, with `tests`, not tested at the same times.
        """
        return _dataset(self, tests)

    def to_netcdf(self, path: str | Path, *, tests: bool = False) -> Path:
        """Write `ds` as a netCDF 4 file; return its path. Readers see the old or the whole new file.

        With `tests` the file has the layers of every test too, see :meth:`dataset`.

        Raises
        ------
        MissingLibrary, ValueError
            As for `ds`; also where h5netcdf is not installed.
        OSError
            Where the file cannot be written.
        """
        library("h5netcdf", "a netCDF file")
        place = Path(path)
        aside = place.with_name(f".{place.name}.part")
        ds = self.dataset(tests=True) if tests else self.ds
        packed = {name: PACKED for name, values in ds.data_vars.items() if values.dtype.kind in "iufb"}
        try:
            ds.to_netcdf(aside, engine="h5netcdf", encoding=packed)
            os.replace(aside, place)
            sync_directory(place.parent)
        finally:
            aside.unlink(missing_ok=True)
        return place

    def plot(self) -> Picture:
        """Return the picture of `bow study`: measures with errors against the parameters, and all maps."""
        from bow.shown import Picture
        from bow_sweep.study.picture import heading, study_figure

        return Picture(study_figure(self.plan, self.report, [each.file for each in self.maps]), heading(self.plan))

    def _repr_png_(self) -> bytes:
        return self.plot()._repr_png_()

    def __str__(self) -> str:
        return "\n".join(text(self.report))

    def __repr__(self) -> str:
        spans = ", ".join(
            f"{over.name} {short(over.values[0])} ... {short(over.values[-1])}" for over in self.plan.overs
        )
        return f"<bow.Study of {len(self.maps)} maps: {spans}{f'; {self.directory}' if self.directory else ''}>"


def study(
    preset: str = "",
    over: OverGiven = (),
    *,
    nx: int | None = None,
    ny: int | None = None,
    x: AxisGiven | None = None,
    y: AxisGiven | None = None,
    settings: Iterable[str] = (),
    workers: int | None = None,
    progress: bool = True,
    **parameters: object,
) -> Study:
    """Compute a family of maps in this process: the product of the values of further parameters.

    Parameters
    ----------
    preset
        Name of a preset, as of `bow sweep`.
    over
        Further parameters: a mapping from name to values, or to a text as in ``{"mu_s": "0.6:1.2:4"}``; or texts as
        after `bow study --over`, where a name alone stands for values along its usual axis.
    nx, ny, x, y, settings, workers, progress, **parameters
        As for :func:`bow.sweep`; they hold for all maps.

    Raises
    ------
    ParameterError
        For a map that cannot be computed; names the setting, its value and what would be right. It is a ValueError.
    """
    given = given_settings(nx, ny, x, y, settings, parameters)
    plan = Plan(preset, tuple(given), _overs(preset, given, over))
    members = plan.members
    maps, runs = [], {}
    for number, member in enumerate(members, 1):
        began = time.monotonic()
        found = computed(member.sweep, workers, progress, f"map {number} of {len(members)}")
        maps.append(found)
        cells = {"planned": member.sweep.budget, "done": member.sweep.budget, "quarantined": 0, "outstanding": 0}
        runs[member.name] = {
            "sweep_id": member.sweep.sweep_id,
            "cells": cells,
            "samples": cells["done"] * member.sweep.parameters.samples,
            "wall_seconds": time.monotonic() - began,
            "playability": found.numbers,
        }
    return Study(plan, maps, contents(plan, runs))


def open_study(directory: str | Path) -> Study:
    """Return a recorded study that is finished.

    Raises
    ------
    RunError, MapFileError
        Where there is none, or it is not finished; both name the file.
    """
    place = Path(directory)
    plan = study_in(place)
    report = contents(plan, read_runs(place, plan))
    return Study(plan, [open_run(place / member.name) for member in plan.members], report, place)


def open_any(path: str | Path) -> Any:
    """Return the map of a recorded run (:class:`bow.Map`), or a recorded study (:class:`bow.Study`).

    Parameters
    ----------
    path
        Run directory of `bow sweep`, a map.npz, or directory of `bow study`.

    Raises
    ------
    MapFileError, CellError, RunError
        Where there is no map, or it cannot be read.

    Examples
    --------
    >>> import bow
    >>> path = bow.sweep("fig11d", nx=8, ny=4, periods=20, progress=False).save("small.npz")
    >>> bow.open(path).shape
    (4, 8)
    """
    place = Path(path)
    if any((place / name).exists() for name in (STUDY, CAMPAIGN)):
        return open_study(place)
    return open_run(place)


# ---- parameters


def _overs(preset: str, settings: Sequence[str], given: OverGiven) -> tuple[Over, ...]:
    if not isinstance(given, Mapping):
        return overs_of(preset, settings, [given] if isinstance(given, str) else list(given))
    found = []
    for name, values in given.items():
        if isinstance(values, str):
            found.append(over_of(f"{name}={values}"))
            continue
        found.append(Over(name, tuple(written(name, value) for value in values)))
    return tuple(found)


def _values(over: Over) -> list[float | str]:
    numbers = over.numbers
    return list(over.values) if numbers is None else numbers.tolist()


def _nearest(over: Over, value: float | str) -> int:
    numbers = over.numbers
    if numbers is None:
        if value not in over.values:
            raise ParameterError(f"{over.name} = {value!r}: should be one of {', '.join(over.values)}")
        return over.values.index(str(value))
    return int(np.argmin(np.abs(np.log(numbers / float(value)) if over.is_log else numbers - float(value))))


def _floats(values: Iterable[float | None]) -> np.ndarray:
    return np.array([np.nan if value is None else value for value in values], float)


# ---- xarray


def _dataset(of: Study, tests: bool) -> xarray.Dataset:
    from bow.dataset import TEST, dataset

    xr = library("xarray", "s.ds")
    first = of.maps[0].file
    for each in of.maps[1:]:
        one, other = first, each.file
        if (one.x_name, one.y_name) != (other.x_name, other.y_name) or not (
            np.array_equal(one.x, other.x) and np.array_equal(one.y, other.y)
        ):
            raise ValueError("the maps are of different planes, which are no dataset together; see each map's own")
        if tests and not np.array_equal(one.test_periods, other.test_periods):
            raise ValueError("the maps are tested at different times, so that their tests have no dimension together")
    maps = [dataset(each) for each in of.maps]
    dimensions = [f"over_{name}" if name in maps[0].variables else name for name in of.parameters]
    variables: dict[str, Any] = {}
    for name in dict.fromkeys([*LAYERS, *(maps[0].data_vars if tests else ())]):
        if all(name in each for each in maps):
            stacked = np.stack([each[name].values for each in maps])
            whole = stacked.reshape(*of.shape, *stacked.shape[1:])
            variables[name] = ((*dimensions, *maps[0][name].dims), whole, maps[0][name].attrs)
    for entry in MEASURES:
        unit = {"units": entry.unit or "1"}
        words = {"": entry.title, "_error": f"standard error of: {entry.title}"}
        for ending, title in words.items():
            key = f"playability_{entry.name}{ending}"
            variables[key] = (
                dimensions,
                of.table[f"{entry.name}{ending}"].reshape(of.shape),
                {"long_name": title} | unit,
            )
            if entry.unit == "%":
                variables[key][2]["units"] = "1"
    coordinates: dict[str, Any] = {
        dimension: (dimension, np.array(values), {"long_name": name})
        for dimension, (name, values) in zip(dimensions, of.parameters.items(), strict=True)
    }
    plane = {name: maps[0].coords[name] for name in (*maps[0][LAYERS[0]].dims, *([TEST] if tests else []))}
    same = {
        name: value
        for name, value in maps[0].attrs.items()
        if all(name in each.attrs and np.array_equal(each.attrs[name], value) for each in maps)
    }
    return xr.Dataset(variables, coordinates | plane, same | {"tests": ALL if tests else LAST})
