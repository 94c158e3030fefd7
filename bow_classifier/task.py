"""What the classifier must know of a sweep to judge it: read from the settings that the plan announces.

The plan itself is downstream (:mod:`bow_sweep.plan.sweep`); here is only which cells are in which block, how fast and
where each is bowed, and what is asked of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bow_classifier.block_classifier import Geometry
from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import Parameters
from bow_sim.protocol.blocks import Blocks
from bow_sim.protocol.limits import check_size
from bow_sim.protocol.sweep_spec import Spec, axis_values, split


@dataclass(frozen=True, eq=False)
class Task:
    """The judging of one sweep.

    Attributes
    ----------
    run_id, sweep_id
        Which messages belong to it.
    geometry
        Of the string: the same for all cells, but for the bow's position.
    thresholds
        Of the tests.
    bow_speeds
        (cells of the sweep,) final bow speed v_b of every cell, or (1,) where it is not swept.
    bow_bridges
        (cells of the sweep,) round trip bow-bridge-bow of every cell, samples, or (1,) where it is not swept.
    planned
        The blocks, as far as they are planned.
    chunks
        Of every block.
    """

    run_id: str
    sweep_id: str
    geometry: Geometry
    thresholds: Thresholds
    bow_speeds: NDArray[np.float64]
    bow_bridges: NDArray[np.int64]
    planned: Blocks
    chunks: int

    @classmethod
    def from_settings(
        cls, run_id: str, sweep_id: str, settings: Iterable[str], rounds: NDArray[np.uint8] | None = None
    ) -> Task:
        """Return the task that the settings of a resolved sweep describe, as ``Plan.spec.settings`` holds them.

        Parameters
        ----------
        rounds
            ``Plan.rounds``; None or empty: one round of all cells.

        Raises
        ------
        ParameterError
            For settings that are not those of a resolved sweep, or that make cells of a block differ in length, or
            rounds that are none of this plane.
        """
        spec = split(settings)
        parameters = spec.parameters()
        counts = spec.number("x", "count"), spec.number("y", "count")
        block_cells = spec.number("", "block_cells")
        check_size(*counts, block_cells, parameters)
        for axis in ("x", "y"):
            name = getattr(spec, axis).get("name")
            if name in ("period", "periods"):
                raise ParameterError(f"{axis}.name = {name!r}: cells of one sweep must share it")
        return cls(
            run_id,
            sweep_id,
            Geometry.of(parameters),
            Thresholds.from_mapping(spec.classifier),
            _swept(spec, counts, "v_b", parameters.v_b),
            _bow_bridges(spec, counts, parameters),
            Blocks.announced(counts[0] * counts[1], block_cells, np.zeros(0, np.uint8) if rounds is None else rounds),
            parameters.chunks,
        )

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return self.planned.count

    def block(self, block: int) -> NDArray[np.uint32]:
        """Return the cells of a block, (cells of the block,)."""
        return self.planned.block(block)

    def bow_speed(self, cells: NDArray[np.uint32]) -> NDArray[np.float64]:
        """Return the final bow speed of `cells`, (cells,) or (1,)."""
        return self.bow_speeds if len(self.bow_speeds) == 1 else self.bow_speeds[cells]

    def bow_bridge(self, cells: NDArray[np.uint32]) -> NDArray[np.int64]:
        """Return the round trip bow-bridge-bow of `cells`, samples, (cells,) or (1,)."""
        return self.bow_bridges if len(self.bow_bridges) == 1 else self.bow_bridges[cells]


def _swept(spec: Spec, counts: tuple[int, int], name: str, common: float) -> NDArray[np.float64]:
    """Return the parameter of every cell where it is an axis of the map, else the common one, (1,)."""
    for axis, group in enumerate((spec.x, spec.y)):
        if group.get("name") == name:
            values = _values(group, counts[axis])
            return np.tile(values, counts[1]) if axis == 0 else np.repeat(values, counts[0])
    return np.array([common], dtype=np.float64)


def _values(group: Mapping[str, object], count: int) -> NDArray[np.float64]:
    """Return the values along an axis, (count,)."""
    where, scale = f"axis of {group['name']}", group.get("scale")
    try:
        first, last = float(str(group["first"])), float(str(group["last"]))
    except (KeyError, ValueError) as error:
        raise ParameterError(f"{where}: first and last should be numbers ({error})") from None
    if scale not in ("log", "linear"):
        raise ParameterError(f"{where}: scale = {scale!r}: should be 'log' or 'linear'")
    for value in (first, last):
        if not math.isfinite(value) or (scale == "log" and value <= 0):
            right = "a number above 0" if scale == "log" else "a finite number"
            raise ParameterError(f"{where}: {value!r}: should be {right} on a {scale} axis")
    return axis_values(str(scale), first, last, count)


def _bow_bridges(spec: Spec, counts: tuple[int, int], parameters: Parameters) -> NDArray[np.int64]:
    bridges = _swept(spec, counts, "bow_bridge", parameters.bow_bridge)
    for value in np.unique(bridges).tolist():
        try:
            parameters.replace(bow_bridge=value)
        except ParameterError as error:
            raise ParameterError(f"axis of bow_bridge: {error}") from None
    return bridges.astype(np.int64)
