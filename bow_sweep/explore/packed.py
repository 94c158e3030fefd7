"""The last periods of every cell of a run, packed small for a page without a server."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sweep.cell.run_cells import RunCells
from bow_sweep.cell.waveform import CellError

BATCH = 512
"""Cells that are computed together."""

Progress = Callable[[float, float], None]
"""Called with (done, total)."""


@dataclass(frozen=True, eq=False)
class LastPeriods:
    """The ends of all waveforms of a run.

    Attributes
    ----------
    force
        (cells, samples) float32, bridge force.
    offset
        (cells + 1,) uint32: the slips of cell c are those from offset[c] to offset[c + 1].
    onset, duration
        (slips,) uint32, samples since the first of `force`.
    computed
        Number of cells that were computed again, because the bag does not have them.
    why
        Reason of the first of them; "" for none.
    given_up
        Number of cells whose block the run has given up, because simulators died of it: they are not computed, and
        rest in `force`.
    """

    force: NDArray[np.float32]
    offset: NDArray[np.uint32]
    onset: NDArray[np.uint32]
    duration: NDArray[np.uint32]
    computed: int
    why: str
    given_up: int


def last_periods(run: RunCells, periods: int, progress: Progress | None = None) -> LastPeriods:
    """Return the last periods of every cell: from the bag block by block, computed again where the bag has them not.

    Parameters
    ----------
    run
        The run.
    periods
        Nominal periods, at most those of the run.

    Raises
    ------
    CellError
        For cells that are not in the bag, and cannot be simulated.
    """
    sweep = run.sweep
    samples = periods * sweep.parameters.period
    force = np.zeros((run.cells, samples), np.float32)
    slips: list[tuple[NDArray[Any], NDArray[Any]]] = [(np.zeros(0), np.zeros(0))] * run.cells
    missing = np.ones(run.cells, bool)

    def take(chunks: Iterator[tuple[NDArray[np.intp], list[Any]]]) -> None:
        done = run.cells - int(missing.sum())
        for cells, parts in chunks:
            of_all, found = _joined(parts, len(cells), samples)
            own = cells[cells < run.cells]  # the first ones: cells ascend
            force[own] = of_all[: len(own)]
            for row, cell in enumerate(own.tolist()):
                slips[cell] = found[row]
            missing[own] = False
            done += len(own)
            if progress is not None:
                progress(done, run.cells)

    reasons = ["there is no bag" if run.bag is None else ""]
    take(_recorded(run, periods, reasons))
    given_up = 0
    if run.bag is not None:
        for cell in np.flatnonzero(missing).tolist():
            if run.bag.given_up(cell):
                missing[cell] = False
                given_up += 1
    computed = int(missing.sum())
    if computed and not any(reasons):
        reasons.append("the run did not simulate them")
    take(_computed(run, np.flatnonzero(missing), periods))
    counts = [len(onset) for onset, _ in slips]
    return LastPeriods(
        force=force,
        offset=np.concatenate([[0], np.cumsum(counts)]).astype(np.uint32),
        onset=np.concatenate([onset for onset, _ in slips]).astype(np.uint32),
        duration=np.concatenate([duration for _, duration in slips]).astype(np.uint32),
        computed=computed,
        why=next(filter(None, reasons), "") if computed else "",
        given_up=given_up,
    )


def _recorded(run: RunCells, periods: int, reasons: list[str]) -> Iterator[tuple[NDArray[np.intp], list[Any]]]:
    """Yield the cells of each block in the bag, and their last chunks; reasons why blocks are left out are added."""
    if run.bag is None:
        return
    outline = run.bag.outline
    wanted = range(outline.chunks - math.ceil(periods / CHUNK_PERIODS), outline.chunks)
    for block in range(outline.planned.count):
        cells = np.asarray(outline.block(block), np.intp)
        if cells[0] >= run.cells:  # repeats, which have the last numbers
            return
        try:
            streams = [run.bag.streams(block, chunk) for chunk in wanted]
        except CellError as error:
            reasons.append(str(error))
            continue
        yield cells, [(force["data"], slip) for force, slip in streams]


def _computed(run: RunCells, cells: NDArray[np.intp], periods: int) -> Iterator[tuple[NDArray[np.intp], list[Any]]]:
    """Yield cells in batches, and their last chunks, computed again."""
    from bow_sim.kernel.block import Block
    from bow_sim.physics.errors import ParameterError
    from bow_sim.physics.kinds import common
    from bow_sweep.cell.parameters import lanes

    parameters = run.sweep.parameters
    kept = math.ceil(periods / CHUNK_PERIODS)
    kinds = run.sweep.kinds
    of_one = [cells] if kinds is None else [cells[kinds[cells] == kind] for kind in np.unique(kinds[cells])]
    for some in (part[start : start + BATCH] for part in of_one for start in range(0, len(part), BATCH)):
        try:
            block = Block(*common(parameters, lanes(run.sweep, some))[:2])
        except ParameterError as error:
            raise CellError(f"{run.directory}: its cells cannot be computed again: {error}") from None
        chunks = [block.advance() for _ in range(parameters.chunks)][-kept:]
        yield some, [(chunk.bridge_force.reshape(-1), chunk._asdict()) for chunk in chunks]


def _joined(parts: list[Any], cells: int, samples: int) -> tuple[NDArray[np.float32], list[Any]]:
    """Return the last samples of some cells, (cells, samples), and (onset, duration) of the slips of each."""
    force = np.concatenate([np.asarray(data, np.float32).reshape(cells, -1) for data, _ in parts], axis=1)
    cut = force.shape[1] - samples
    length = force.shape[1] // len(parts)
    found = []
    for row in range(cells):
        onsets, ends = [], []
        for number, (_, slip) in enumerate(parts):
            own = slice(*(int(place) for place in slip["offsets"][row : row + 2]))
            onset = np.asarray(slip["onset"][own], np.int64) + number * length - cut
            onsets.append(np.maximum(onset, 0))
            ends.append(onset + np.asarray(slip["duration"][own], np.int64))
        onset, end = np.concatenate(onsets), np.concatenate(ends)
        inside = end > 0
        found.append((onset[inside], (end - onset)[inside]))
    return force[:, cut:], found


@dataclass(frozen=True, eq=False)
class Packed:
    """Waveforms as small whole numbers: force = middle + step * value, to half a step.

    Attributes
    ----------
    values
        (cells, samples) int16 or int8.
    middle, step
        (cells,) float32.
    """

    values: NDArray[Any]
    middle: NDArray[np.float32]
    step: NDArray[np.float32]


def pack(force: NDArray[np.float32], bits: int) -> Packed:
    """Return waveforms with 16 or 8 bits a sample: equal steps from the least to the greatest sample of each cell.

    A value differs from the sample by half a step, and by the rounding of float32.
    """
    kind: Any = np.int16 if bits == 16 else np.int8
    top = int(np.iinfo(kind).max)
    low, high = force.min(axis=1).astype(np.float64), force.max(axis=1).astype(np.float64)
    middle, step = ((low + high) / 2).astype(np.float32), ((high - low) / (2 * top)).astype(np.float32)
    safe = np.where(step > 0, step, 1).astype(np.float64)
    values = np.round((force - middle[:, None].astype(np.float64)) / safe[:, None])
    return Packed(np.clip(values, -top, top).astype(kind), middle, step)
