"""Blocks computed again and held against what a bag says of them: what proves verdicts whose streams are not recorded.

A verdict states the checksum of the streams that it judged. The kernel gives the same bytes again, so checksums and
verdicts must be the recorded ones. A checksum covers all cells of a block, so whole blocks are computed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bow_classifier.stream import Classifier
from bow_classifier.task import Task
from bow_sim.protocol import cdr
from bow_sim.protocol.recording import PROVED_CELLS
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sim.protocol.verdict_fields import differing

if TYPE_CHECKING:
    from bow_sweep.record.bag_contents import Key, Survey, Verdict


class Kernel(NamedTuple):
    """What computes blocks again: :func:`bow_sweep.cell.computed.kernel`.

    Attributes
    ----------
    fingerprint
        Takes the outline of a sweep; returns what this machine computes for it.
    streams
        Takes the outline of a sweep and a block; yields the messages BridgeForce and StickSlip of each chunk.
    """

    fingerprint: Callable[[SweepOutline], str]
    streams: Callable[[SweepOutline, int], Iterator[tuple[bytes, bytes]]]


@dataclass(frozen=True)
class Again:
    """What is to be computed again.

    Attributes
    ----------
    kernel
        Computes the blocks.
    cells
        Number of cells, at least, drawn in whole blocks; infinity for all, None for `PROVED_CELLS` of a run that does
        not record all streams, and none of another.
    seed
        Of the draw.
    """

    kernel: Kernel
    cells: float | None = None
    seed: int = 0

    def draw(self, outline: SweepOutline, blocks: Sequence[int]) -> list[int]:
        """Return some of the blocks, ascending: so many that they have the wanted number of cells."""
        recorded = len(outline.recorded_chunks) == outline.chunks
        wanted = self.cells if self.cells is not None else 0 if recorded else PROVED_CELLS
        drawn: list[int] = []
        for block in np.random.default_rng(self.seed).permutation(np.asarray(blocks, int)).tolist():
            if wanted <= 0:
                break
            drawn.append(block)
            wanted -= outline.planned.size(block)
        return sorted(drawn)


def checksum(force: bytes, slip: bytes) -> int:
    """Return the checksum of a chunk from its messages BridgeForce and StickSlip, as receipts and verdicts state it."""
    heads = [cdr.decode_head(name, data) for name, data in (("BridgeForce", force), ("StickSlip", slip))]
    return cdr.chunk_checksum(heads[0]["block"], heads[0]["chunk"], *(int(head["checksum"]) for head in heads))


def compare(survey: Survey, task: Task, block: int, kernel: Kernel) -> Iterator[tuple[Key, str]]:
    """Compute a block again; yield each of its chunks, and what differs from the bag there, "" for nothing.

    Ends after the first chunk that differs: what follows from other streams differs too.

    Raises
    ------
    ParameterError
        Where the block cannot be computed here.
    """
    classifier = Classifier("0" * 16)
    classifier.open(task)
    for chunk, (force, slip) in enumerate(kernel.streams(task.outline, block)):
        known = survey.verdicts.get((block, chunk))
        if known is None:
            return  # reported before
        what = _differs(known, survey, task, kernel, classifier, force, slip)
        yield (block, chunk), what
        if what:
            return


def _differs(
    known: Verdict, survey: Survey, task: Task, kernel: Kernel, classifier: Classifier, force: bytes, slip: bytes
) -> str:
    """Return what differs between the verdict of a chunk and the one on the chunk computed again; "" for nothing."""
    there, here = str(survey.plan["fingerprint"]), kernel.fingerprint(task.outline)
    other = f"; the run's kernel is another one, so nothing is proved here: {there}, here is {here}"
    made = checksum(force, slip)
    out = classifier.take("BridgeForce", force) + classifier.take("StickSlip", slip)
    if made != known.chunk_checksum:
        what = f"the verdicts are on chunk {known.chunk_checksum:016x}, computed again it is {made:016x}"
        return what + other * (there != here)
    if len(out) != 1:
        return f"the classifier does not take it: {'; '.join(classifier.complaints) or 'it gave no verdict'}"
    again = cdr.decode("Verdicts", out[0])
    names = differing(known.layers, again)
    same_hash = task.thresholds.hash == survey.plan["classifier"]
    if same_hash and not names and known.checksum != again["checksum"]:
        names = ["checksum"]  # of all fields
    return f"the verdicts derived again differ in {', '.join(names)}" if names else ""
