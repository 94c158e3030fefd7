"""Repeats of every cell with slightly other bow forces: how sure is what a map says of a cell (PHYSICS.md section 15).

A sweep with ``repeats=K`` simulates each cell of its plane 1 + K times. Repeat 0 is the cell itself, with the values of
the axes; in repeats 1 ... K the forces at the end and at the start are each multiplied by 1 + jitter r, r uniform in
-1 ... 1. In messages the number of a repeated cell is ``repeat * (cells of the plane) + cell``, so that the cells
themselves keep their numbers.

r is a hash of (seed, cell, repeat, force), made of whole numbers only: it is the same on every machine, and does not
depend on the order or the blocks in which cells are computed.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bow_sim.physics.cells import paper_lanes
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import Parameters
from bow_sim.protocol.sweep_spec import Axis, Spec, real_number, whole_number

NAMES = ("repeats", "jitter", "seed")
"""The settings."""

MAX_SEED = 2**32 - 1

F_ASYM, F_INIT = 0, 1
"""Numbers of the two forces in the hash."""

_STEP, _FIRST, _SECOND = (np.uint64(n) for n in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB))
"""The constants of SplitMix64 (Steele, Lea, Flood 2014)."""


@dataclass(frozen=True)
class Repeats:
    """How often, and with which deviations, the cells of a sweep are repeated.

    Attributes
    ----------
    count
        Repeats of each cell beside the cell itself; 0: none.
    jitter
        Largest relative deviation of a force, 0 ... 1 (excluded).
    seed
        0 ... `MAX_SEED`; another one gives other deviations.
    """

    count: int = 0
    jitter: float = 0.01
    seed: int = 0

    @classmethod
    def of(cls, spec: Spec) -> Repeats:
        """Read the settings ``repeats``, ``jitter`` and ``seed``.

        Raises
        ------
        ParameterError
            For a value that cannot be, deviations without repeats, or repeats of an adaptive sweep.
        """
        for name in NAMES[1:]:
            if spec.repeats is None and getattr(spec, name) is not None:
                value = getattr(spec, name)
                raise ParameterError(f"{name} = {value}: says how cells are repeated; give repeats too, for example 8")
        count = cls.count if spec.repeats is None else whole_number("repeats", spec.repeats)
        jitter = cls.jitter if spec.jitter is None else real_number("jitter", spec.jitter)
        seed = cls.seed if spec.seed is None else whole_number("seed", spec.seed)
        if count < 0:
            raise ParameterError(f"repeats = {count}: should be 0 (none) or more, for example 8")
        if not 0 <= jitter < 1:
            raise ParameterError(f"jitter = {jitter:g}: should be at least 0 and less than 1, for example 0.01")
        if not 0 <= seed <= MAX_SEED:
            raise ParameterError(f"seed = {seed}: should be 0 ... {MAX_SEED}")
        if count and (share := spec.share("adaptive", 1.0)) < 1:
            raise ParameterError(
                f"repeats = {count}: adaptive = {share:g} leaves cells out, which cannot be repeated; "
                "should be repeats=0, or adaptive=1"
            )
        return cls(count, jitter, seed) if count else cls()

    def settings(self) -> dict[str, object]:
        """Return the settings by name; none where there are no repeats."""
        return dict(zip(NAMES, (self.count, self.jitter, self.seed), strict=True)) if self.count else {}

    def check(self, parameters: Parameters, x: Axis, y: Axis) -> None:
        """Check that the largest deviations leave forces that can be, at the corners of the plane.

        Raises
        ------
        ParameterError
            Where they do not.
        """
        if not self.count:
            return
        more, less = 1 + self.jitter, 1 - self.jitter
        for (x_end, x_value), (y_end, y_value) in itertools.product(x.tried(), y.tried()):
            try:
                corner = parameters.replace(**{x.name: x_value, y.name: y_value})
                if corner.sustained:
                    corner.replace(f_asym=corner.f_asym * more, sustained=corner.sustained * more)
                else:
                    corner.replace(f_asym=corner.f_asym * more, f_init_ratio=corner.f_init_ratio * more / less)
            except ParameterError as error:
                where = f"jitter = {self.jitter:g}: at x.{x_end} and y.{y_end}"
                raise ParameterError(f"{where}, with the largest deviation: {error}") from None

    def cells(self, plane_cells: int) -> int:
        """Return the number of cells to simulate, from that of the plane."""
        return (1 + self.count) * plane_cells

    def factors(self, cells: NDArray[np.integer], plane_cells: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return by how much f_asym and f_init of some cells are multiplied, (cells,) each; 1 for repeat 0.

        Parameters
        ----------
        cells
            (cells,) numbers with repeats.
        plane_cells
            Cells of the plane.
        """
        repeat, cell = np.divmod(np.asarray(cells, np.int64), plane_cells)
        first, second = (
            np.where(repeat > 0, 1 + self.jitter * deviations(self.seed, cell, repeat, force), 1.0)
            for force in (F_ASYM, F_INIT)
        )
        return first, second

    def vary(
        self,
        parameters: Parameters,
        lanes: Mapping[str, NDArray[np.float64]],
        cells: NDArray[np.integer],
        plane_cells: int,
    ) -> dict[str, NDArray[np.float64]]:
        """Return the values of cells with the deviations of their repeats.

        Parameters
        ----------
        parameters
            What all cells share.
        lanes
            Values by name, (cells,) each, in the paper's units or in SI.
        cells, plane_cells
            As for :meth:`factors`.

        Returns
        -------
        dict
            As `lanes`, unchanged, where the sweep has no repeats. Else in the paper's units, with `f_asym` and
            `f_init_ratio`: f_init is their product. Where the initial force is `sustained` times a maximum, with that.
        """
        if not self.count:
            return dict(lanes)
        varied = {name: np.asarray(values, np.float64) for name, values in paper_lanes(parameters, lanes).items()}
        of_asym, of_init = self.factors(cells, plane_cells)
        if parameters.sustained or "sustained" in varied:
            changes = {"f_asym": of_asym, "sustained": of_init}
        else:
            changes = {"f_asym": of_asym, "f_init_ratio": of_init / of_asym}
        for name, factor in changes.items():
            varied[name] = varied.get(name, np.full(len(factor), getattr(parameters, name))) * factor
        return varied


NO_REPEATS = Repeats()
"""Every cell once."""


def deviations(seed: int, cell: ArrayLike, repeat: ArrayLike, force: int) -> NDArray[np.float64]:
    """Return r, uniform in [-1, 1), for some cells and repeats; a multiple of 2^-52 (PHYSICS.md section 15).

    Parameters
    ----------
    seed
        Of the sweep.
    cell, repeat
        (n,) numbers of cells of the plane, and of repeats.
    force
        `F_ASYM` or `F_INIT`.

    Returns
    -------
    ndarray, shape (n,)
    """
    hashed = _mixed(np.atleast_1d(np.uint64(seed)))
    for key in (cell, repeat, force):
        hashed = _mixed(hashed + np.atleast_1d(np.asarray(key, np.uint64)))
    steps = (hashed >> np.uint64(11)).astype(np.int64) - (1 << 52)
    return steps / float(1 << 52)


def _mixed(numbers: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return the output of SplitMix64 for states `numbers`, modulo 2^64."""
    z = numbers + _STEP
    z = (z ^ (z >> np.uint64(30))) * _FIRST
    z = (z ^ (z >> np.uint64(27))) * _SECOND
    return z ^ (z >> np.uint64(31))
