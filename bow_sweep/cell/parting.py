"""When the motions of repeats part from those of their cells (PHYSICS.md section 15)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bow_sim.protocol import cdr
from bow_sweep.cell.waveform import CellError, Waveform
from bow_sweep.maps.slips import Pieces, join

if TYPE_CHECKING:
    from bow_sweep.cell.from_bag import BagCells

APART = 3
"""Onsets of slips that differ by more samples than this are different."""

Onsets = NDArray[np.int64]


def parting(one: Waveform, other: Waveform, period: int) -> float:
    """Return after how many nominal periods two motions part; infinity where they do not, see :func:`first_apart`."""
    first, second = (np.asarray(wave.onsets, np.int64) for wave in (one, other))
    return first_apart(first, second) / period


def first_apart(first: Onsets, second: Onsets) -> float:
    """Return the first onset of a slip that differs between two motions, in samples; infinity where none does.

    The slips are compared in their order. Where one motion has no further slip, they part at the next slip of the
    other.

    Parameters
    ----------
    first, second
        (slips,) onsets since the start, in samples.
    """
    both = min(len(first), len(second))
    apart = np.flatnonzero(np.abs(first[:both] - second[:both]) > APART)
    if len(apart):
        return float(min(first[apart[0]], second[apart[0]]))
    longer = first if len(first) > both else second
    return float(longer[both]) if len(longer) > both else np.inf


def partings(bag: BagCells, progress: Callable[[float, float], object] | None = None) -> NDArray[np.float32]:
    """Return when the motion of every repeat of a run parts from that of its cell.

    Parameters
    ----------
    bag
        Of a run with repeats. All of its slips are read, or computed again where the streams are not recorded, and
        their checksums are compared with the recorded ones.
    progress
        Called with (done, total).

    Returns
    -------
    ndarray, shape (repeats, ny, nx)
        Nominal periods; infinity = never, NaN where one of the two motions is not whole in the bag, or has another
        checksum when it is computed again.
    """
    outline = bag.outline
    cells, ny_nx = outline.plane_cells, outline.shape
    found = np.full(outline.cells - cells, np.nan, np.float32)
    itself: dict[int, Onsets] = {}
    for block in range(outline.blocks):
        numbers = outline.block(block).tolist()
        try:
            own = onsets_of(bag, block)
        except CellError:
            own = []
        for number, onsets in zip(numbers, own, strict=False):
            if number < cells:
                itself[number] = onsets
            elif number % cells in itself:
                found[number - cells] = first_apart(itself[number % cells], onsets) / outline.parameters.period
        if progress is not None:
            progress(block + 1, outline.blocks)
    return found.reshape(-1, *ny_nx)


def onsets_of(bag: BagCells, block: int) -> list[Onsets]:
    """Return the onsets of the slips of the cells of a block, samples since the start; a slip that chunks cut is one.

    Raises
    ------
    DamagedCell
        Where a message is missing, or its checksum does not hold.
    """
    chunks = [Pieces(*(slips[name] for name in Pieces._fields)) for slips in _slips(bag, block)]
    whole = join(chunks, bag.outline.chunk_samples)
    ends = np.cumsum(np.bincount(whole.cell, minlength=bag.outline.planned.size(block)))
    return np.split(whole.start, ends[:-1])


def _slips(bag: BagCells, block: int) -> Iterator[Mapping[str, Any]]:
    """Yield the fields of StickSlip of each chunk of a block: read, or computed again where they are not recorded."""
    from bow_sweep.cell.computed import block_streams
    from bow_sweep.cell.from_bag import DamagedCell
    from bow_sweep.record.again import checksum

    if len(bag.outline.recorded_chunks) == bag.outline.chunks:
        yield from (bag.stick_slip(block, chunk) for chunk in range(bag.outline.chunks))
        return
    if bag.checksum(block, 0) is None:
        raise DamagedCell(f"block {block} has no verdicts in the bag")
    for chunk, (force, slip) in enumerate(block_streams(bag.outline, block)):
        if checksum(force, slip) != bag.checksum(block, chunk):
            raise DamagedCell(f"block {block}, chunk {chunk}: computed again it has another checksum")
        yield cdr.decode("StickSlip", slip)


def median_parting(found: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the median over the repeats, (ny, nx), from (repeats, ny, nx); the lower one of two, so never halfway.

    NaN where the parting of no repeat is known.
    """
    ordered = np.sort(found, axis=0)  # NaN comes last, behind infinity
    known = np.count_nonzero(~np.isnan(found), axis=0)
    return np.take_along_axis(ordered, (np.maximum(known, 1) - 1)[None] // 2, axis=0)[0]
