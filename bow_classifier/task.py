"""What the classifier must know of a sweep to judge it: read from the settings that the plan announces.

The plan itself is downstream (:mod:`bow_sweep.plan`); here is only which cells are in which block, how fast each is
bowed, and what is asked of them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bow_sim.model import ParameterError
from bow_sim.spec import Spec, split

from .judge import Geometry
from .regime import Thresholds


@dataclass(frozen=True, eq=False)
class Task:
    """The judging of one sweep.

    Attributes
    ----------
    run_id, sweep_id
        Which messages belong to it.
    geometry
        Of the string: the same for all cells.
    thresholds
        Of the tests.
    bow_speeds
        (cells of the sweep,) final bow speed v_b of every cell, or (1,) where it is not swept.
    cells, block_cells, chunks
        Cells of the sweep; cells of a block (the last may have fewer); chunks of every block.
    """

    run_id: str
    sweep_id: str
    geometry: Geometry
    thresholds: Thresholds
    bow_speeds: NDArray[np.float64]
    cells: int
    block_cells: int
    chunks: int

    @classmethod
    def from_settings(cls, run_id: str, sweep_id: str, settings: Iterable[str]) -> Task:
        """Return the task that the settings of a resolved sweep describe, as ``Plan.spec.settings`` holds them.

        Raises
        ------
        ParameterError
            For settings that are not those of a resolved sweep, or that make cells of a block differ in geometry.
        """
        spec = split(settings)
        parameters = spec.parameters()
        counts = spec.number("x", "count"), spec.number("y", "count")
        block_cells = spec.number("", "block_cells")
        for name, number in (("x.count", counts[0]), ("y.count", counts[1]), ("block_cells", block_cells)):
            if number < 1:
                raise ParameterError(f"{name} = {number}: should be 1 or more")
        for axis in ("x", "y"):
            name = getattr(spec, axis).get("name")
            if name in ("period", "bow_bridge", "periods"):
                raise ParameterError(f"{axis}.name = {name!r}: cells of one sweep must share it")
        return cls(
            run_id,
            sweep_id,
            Geometry.of(parameters),
            Thresholds.from_mapping(spec.classifier),
            _bow_speeds(spec, counts, parameters.v_b),
            counts[0] * counts[1],
            block_cells,
            parameters.chunks,
        )

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return -(-self.cells // self.block_cells)

    def block(self, block: int) -> NDArray[np.uint32]:
        """Return the cells of a block, (cells of the block,)."""
        start = block * self.block_cells
        return np.arange(start, min(start + self.block_cells, self.cells), dtype=np.uint32)

    def bow_speed(self, cells: NDArray[np.uint32]) -> NDArray[np.float64]:
        """Return the final bow speed of `cells`, (cells,) or (1,)."""
        return self.bow_speeds if len(self.bow_speeds) == 1 else self.bow_speeds[cells]


def _bow_speeds(spec: Spec, counts: tuple[int, int], common: float) -> NDArray[np.float64]:
    """Return the final bow speed of every cell where it is an axis of the map, else the common one, (1,)."""
    for axis, group in enumerate((spec.x, spec.y)):
        if group.get("name") == "v_b":
            try:
                first, last = float(str(group["first"])), float(str(group["last"]))
            except (KeyError, ValueError) as error:
                raise ParameterError(f"axis of v_b: first and last should be numbers ({error})") from None
            space = np.geomspace if group.get("scale") == "log" else np.linspace
            speeds = space(first, last, counts[axis])
            return np.tile(speeds, counts[1]) if axis == 0 else np.repeat(speeds, counts[0])
    return np.array([common])
