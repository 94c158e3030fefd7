"""What a map holds: its plane, what was found in each cell, and measures of the whole."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_sweep.maps.map_file import MapFile
from bow_sweep.maps.playability import MEASURES, playability
from bow_sweep.maps.terrain import TERRAINS, UNKNOWN, terrain

if TYPE_CHECKING:
    from bow_sweep.maps.axes import PlotAxis


class Measured(NamedTuple):
    """A measure of a map (:mod:`bow_sweep.maps.playability`).

    Attributes
    ----------
    value
        In `unit`; shares are 0 ... 1. None where there is nothing to measure.
    error
        Its uncertainty, from the four interleaved grids of half the density; None for small maps.
    half_grid
        Mean of those four grids; None for small maps.
    title, unit
        For people; "" is a number, "%" a share.
    """

    value: float | None
    error: float | None
    half_grid: float | None
    title: str
    unit: str

    def __str__(self) -> str:
        number = f"{self.value:.4g}" if self.value is not None else "-"
        return number if self.error is None else f"{number} ± {self.error:.2g}"


class Found:
    """What a sweep found in each cell of a plane. Arrays are (ny, nx), row 0 is the first value of y.

    Parameters
    ----------
    file
        The contents of a map.npz.
    directory
        The run that it is from; None for a map that was computed in this process.
    """

    def __init__(self, file: MapFile, directory: Path | None = None) -> None:
        self.file = file
        self.directory = directory

    # ---- what it is of

    @property
    def shape(self) -> tuple[int, int]:
        """Cells along y and x."""
        return self.file.shape

    @property
    def axes(self) -> tuple[PlotAxis, PlotAxis]:
        """The axes along x and y: `name`, `values`, `scale`."""
        return self.file.axes

    @property
    def x(self) -> NDArray[np.float64]:
        """(nx,) values of the parameter along x."""
        return self.file.x

    @property
    def y(self) -> NDArray[np.float64]:
        """(ny,) values of the parameter along y."""
        return self.file.y

    @cached_property
    def settings(self) -> dict[str, float | int | str]:
        """Every setting of the sweep by name; numbers as numbers. Empty for maps of the first versions."""
        return {name: _number(text) for name, text in self.file.values.items()}

    # ---- what was found

    @property
    def transient_periods(self) -> NDArray[np.float32]:
        """(ny, nx) periods until Helmholtz motion; 0 = never, NaN = not computed."""
        return self.file.transient_periods

    @cached_property
    def regime(self) -> NDArray[np.str_]:
        """(ny, nx) name of the regime at the last test; "pending" = no verdict."""
        return self._named(self.file.regime)

    def regime_at(self, periods: float) -> NDArray[np.str_]:
        """Return the name of the regime at the test after `periods` periods, (ny, nx).

        Raises
        ------
        ValueError
            Where there was no test then, or the file, of an older version, keeps the last test only.
        """
        if self.file.regimes is None:
            raise ValueError("this map, of an older version of bow, keeps the regimes of the last test only: m.regime")
        tests = self.file.test_periods.tolist()
        if periods not in tests:
            raise ValueError(f"periods = {periods:g}: should be one of the tests, {tests[0]} ... {tests[-1]} by fives")
        return self._named(self.file.regimes[tests.index(periods)])

    def _named(self, codes: NDArray[np.uint8]) -> NDArray[np.str_]:
        names = self.file.regime_names
        return np.array([*names, "pending"])[np.minimum(codes, len(names))]

    @cached_property
    def terrain_codes(self) -> NDArray[np.uint8]:
        """(ny, nx) code of the terrain, see `bow_sweep.maps.terrain.TERRAINS`; 255 = not computed."""
        return terrain(self.transient_periods)

    @cached_property
    def terrain(self) -> NDArray[np.str_]:
        """(ny, nx) which of the paper's five kinds of terrain surrounds each cell; "unknown" = not computed."""
        codes = self.terrain_codes
        return np.array([*TERRAINS, "unknown"])[np.where(codes == UNKNOWN, len(TERRAINS), codes)]

    @cached_property
    def numbers(self) -> dict[str, Any]:
        """Playability in plain numbers, as in report.json."""
        regime = None if self.file.simulated is not None else self.file.regime
        return playability(self.transient_periods, regime, self.file.regime_names)

    @cached_property
    def playability(self) -> dict[str, Measured]:
        """How easy the string is to play (section IV.B of the paper): measures by name.

        *helmholtz*, *largest_area*, *median_transient*, *spread_transient*, *boundary*, and the shares of the five
        kinds of terrain: :func:`bow_sweep.maps.playability.playability` says what each is.
        """
        found = self.numbers
        return {entry.name: Measured(**found[entry.name], title=entry.title, unit=entry.unit) for entry in MEASURES}


def _number(text: str) -> float | int | str:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text
