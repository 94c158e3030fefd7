"""A map: what a sweep found, its cells, tables and pictures."""

from __future__ import annotations

import os
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from bow.found import Found
from bow_sim.physics.kinds import value_text
from bow_sweep.cell.run_cells import RunCells
from bow_sweep.cell.waveform import CellError
from bow_sweep.maps.map_file import MAP, MapFile, read_map_npz, write_map_npz

if TYPE_CHECKING:
    import xarray

    from bow.cells import Cell
    from bow.shown import Picture


class _CellsComputed(RunCells):
    """The cells of a map that has no run directory: they are computed again."""

    def __init__(self, found: MapFile, source: str) -> None:
        self._given = found
        super().__init__(Path(os.devnull) / source)  # a folder that cannot be there: no bag is found

    def _map(self) -> MapFile:
        return self._given


class Map(Found):
    """A map: what a sweep found in each cell of a plane of two parameters.

    :func:`bow.sweep` computes one, :func:`bow.open` reads one. Arrays are (ny, nx), row 0 is the first value of y.

    Parameters
    ----------
    file
        The contents of its map.npz; every array is an attribute of it.
    directory
        The run that it is from; None for a map that was computed in this process.

    Examples
    --------
    >>> import bow
    >>> m = bow.sweep("fig11d", nx=8, ny=4, periods=20, progress=False)
    >>> m
    <bow.Map 8 x 4 cells: f_asym 0.5 ... 20, f_init_ratio 0 ... 2; Stiff/Cremer string, 20 periods>
    >>> m.transient_periods.shape
    (4, 8)
    >>> int((m.regime == "helmholtz").sum())
    1
    >>> m.playability["helmholtz"].value
    0.03125
    """

    def __repr__(self) -> str:
        from bow_sweep.maps.held_fixed import subject

        ny, nx = self.shape
        ends = [(axis.name, axis.values[0], axis.values[-1]) for axis in self.axes]
        spans = ", ".join(f"{name} {value_text(name, a, 'g')} ... {value_text(name, b, 'g')}" for name, a, b in ends)
        about = f"{nx} x {ny} cells: {spans}; {subject(self.file)}, {self.file.periods:g} periods"
        return f"<bow.Map {about}{f'; {self.directory}' if self.directory else ''}>"

    # ---- its cells

    @cached_property
    def cells(self) -> RunCells:
        """The cells of the run, with their bag where there is one."""
        if self.directory is None:
            return _CellsComputed(self.file, "map")
        return RunCells(self.directory)

    def cell(self, index: int | None = None, *, source: str = "auto", **at: float) -> Cell:
        """Return one cell with its waveform: from the bag of the run, else computed again.

        A waveform is checked: against the checksums in the bag, or, computed, against the recorded one.
        `Cell.checked` and `Cell.why` say what was found.

        Parameters
        ----------
        index
            iy * nx + ix; or give values.
        source
            "auto", "bag" or "computed".
        **at
            Values of the two parameters of the map: the nearest cell is taken.

        Raises
        ------
        CellError
            For a cell that the map does not have, or that cannot be had as asked; says why. It is a ValueError.

        Examples
        --------
        >>> import bow
        >>> m = bow.sweep("fig11d", nx=8, ny=4, periods=20, progress=False)
        >>> c = m.cell(f_asym=3.1, f_init_ratio=0.67)
        >>> {name: round(value, 3) for name, value in c.at.items()}
        {'f_asym': 2.43, 'f_init_ratio': 0.667}
        >>> c.bridge_force.shape
        (2780,)
        """
        from bow.cells import Cell

        if (index is None) == (not at):
            example = ", ".join(
                f"{axis.name}={value_text(axis.name, axis.values[axis.count // 2], '.3g')}" for axis in self.axes
            )
            raise CellError(f"give the number of a cell or values of both axes, for instance m.cell({example})")
        number = self.cells.nearest(at) if index is None else int(index)
        return Cell(self.cells.record(number, source))

    # ---- as tables and pictures

    @cached_property
    def ds(self) -> xarray.Dataset:
        """The map as an xarray.Dataset: coordinates with units, regimes as CF flags, tests as a dimension.

        Raises
        ------
        MissingLibrary
            Where xarray is not installed; it is an ImportError.
        """
        from bow.dataset import dataset

        return dataset(self)

    def to_netcdf(self, path: str | Path) -> Path:
        """Write `ds` as a netCDF 4 file, compressed; return its path. Readers see the old or the whole new file.

        Raises
        ------
        MissingLibrary
            Where xarray or h5netcdf is not installed; it is an ImportError.
        OSError
            Where the file cannot be written.
        """
        from bow.tables import to_netcdf

        return to_netcdf(self, path)

    def save(self, path: str | Path) -> Path:
        """Write the map as a map.npz, which :func:`bow.open` reads; return its path.

        Raises
        ------
        ValueError
            Where the path does not end in .npz.
        OSError
            Where the file cannot be written.
        """
        place = Path(path)
        if place.suffix != ".npz":
            raise ValueError(f"{place}: should end in .npz")
        write_map_npz(place, self.file)
        return place

    def plot(
        self,
        *layers: str,
        width_mm: float = 86.0,
        periods: float | None = None,
        columns: int | None = None,
        style: str = "paper",
    ) -> Picture:
        """Return a picture made for a column of a journal, with a panel for each layer; a notebook shows it.

        :func:`bow.plot` draws several maps together.

        Parameters
        ----------
        *layers
            "transient" (if none is given), "regime", "correlation", "confidence", "terrain", "reliability", "slips"
            or "corners".
        width_mm
            Width of the whole picture.
        periods
            Time of the test, for the layers that have one; None: the last.
        columns
            Number of panels beside each other; None: 2 for several from 120 mm on, else 1.
        style
            "paper", "serif" or "slides".

        Raises
        ------
        ValueError
            For a layer or a test that there is not.

        Examples
        --------
        >>> import bow
        >>> m = bow.sweep("fig11d", nx=8, ny=4, periods=20, progress=False)
        >>> m.plot("regime").caption.partition(",")[0]
        'Regime after 20 periods. Stiff/Cremer string'
        """
        from bow.pictures import picture

        return picture([self], layers or ("transient",), width_mm=width_mm, periods=periods, columns=columns,
                       style=style)  # fmt: skip

    def _repr_png_(self) -> bytes:
        return self.plot(width_mm=140.0)._repr_png_()


def open_run(run: str | Path) -> Map:
    """Return the map of a recorded run.

    Parameters
    ----------
    run
        Run directory of `bow sweep`, or a map.npz.

    Raises
    ------
    MapFileError, CellError
        Where there is no map, or it cannot be read; both are ValueErrors.

    Examples
    --------
    >>> import bow
    >>> path = bow.sweep("fig11d", nx=8, ny=4, periods=20, progress=False).save("small.npz")
    >>> bow.open(path).shape
    (4, 8)
    """
    path = Path(run)
    if path.is_dir():
        if (path / MAP).exists():
            return Map(read_map_npz(path / MAP), path)
        cells = RunCells(path)  # a run without results has verdicts in its bag
        found = Map(cells.map, path)
        found.__dict__["cells"] = cells
        return found
    return Map(read_map_npz(path), path.parent if path.name == MAP else None)
