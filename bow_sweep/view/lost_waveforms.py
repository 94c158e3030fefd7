"""The samples of inspected cells that did not reach the dashboard: from the bag, or computed again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bow_sim.protocol.states import BlockState
from bow_sim.protocol.sweep_outline import SweepOutline

BAG = "bag"
"""Name of the bag in a run directory."""

Ranges = Sequence[tuple[int, int]]
"""Ranges of samples: (first, sample after the last)."""


class Found(NamedTuple):
    """A chunk of the bridge force of a cell."""

    cell: int
    first_sample: int
    force: np.ndarray


def from_bag(directory: Path, run_id: str, missing: Mapping[int, Ranges], problems: list[str]) -> Iterator[Found]:
    """Yield the chunks in the bag of a run directory that have missing samples.

    Parameters
    ----------
    missing
        Ranges of samples by cell.
    problems
        Gets what is wrong with chunks that are left out.

    Raises
    ------
    CellError
        Where there is no such bag, or it cannot be read.
    """
    from bow_sweep.cell.from_bag import BagCells, has_bag
    from bow_sweep.cell.waveform import CellError

    if not has_bag(directory / BAG):
        raise CellError(f"{directory}: has no {BAG}/")
    bag = BagCells(directory / BAG)
    try:
        if bag.outline.run_id != run_id:
            raise CellError(f"{directory / BAG}: is of run {bag.outline.run_id}, not of run {run_id}")
        samples = bag.outline.chunk_samples
        for cell, ranges in missing.items():
            for chunk in chunks_of(ranges, samples):
                try:
                    force = bag.force(cell, chunk)
                except CellError as error:
                    problems.append(str(error))
                    continue
                if force is not None:
                    yield Found(cell, chunk * samples, force)
                elif chunk not in bag.outline.recorded_chunks:
                    problems.append(f"the run was recorded with record={bag.outline.record}")
    finally:
        bag.close()


def computed_again(plan: Mapping[str, Any], outline: SweepOutline, missing: Mapping[int, Ranges]) -> Iterator[Found]:
    """Yield the chunks that have missing samples, computed again; none where the bits could be others.

    That is so where the kernel here is not the run's. Cells of quarantined blocks are left out: simulators died of
    them.
    """
    from bow_sim.kernel.fingerprint import fingerprint
    from bow_sweep.cell.computed import compute

    if plan["fingerprint"] != fingerprint(outline.parameters, outline.x, outline.y):
        return
    states = plan["block_states"]
    done = {
        int(cell)
        for block in range(min(len(states), outline.blocks))
        if states[block] == BlockState.DONE
        for cell in outline.block(block)
    }
    samples = outline.chunk_samples
    for cell, ranges in missing.items():
        if cell in done:
            force = compute(outline, cell).bridge_force
            for chunk in chunks_of(ranges, samples):
                yield Found(cell, chunk * samples, force[chunk * samples : (chunk + 1) * samples])


def chunks_of(ranges: Ranges, samples: int) -> list[int]:
    """Return the numbers of the chunks, of `samples` each, that have a sample in one of the ranges."""
    return sorted({chunk for first, end in ranges for chunk in range(first // samples, -(-end // samples))})
