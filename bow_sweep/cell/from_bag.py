"""Cells out of a bag: only the messages of the cell's block are read, at the places that the bag's index gives."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bow_sim.protocol import cdr
from bow_sim.protocol.states import BlockState
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sim.protocol.verdict_fields import VERDICT_FIELDS
from bow_sweep.cell.waveform import CellError, Waveform, joined, part_of
from bow_sweep.maps.basin_map import Basin
from bow_sweep.record.bag import BagError, bags_in
from bow_sweep.record.bag_contents import Chunks, Place, Progress, Survey
from bow_sweep.record.index_contents import IndexSurvey
from bow_sweep.record.mcap_reader import Scan
from bow_sweep.record.mcap_records import Message
from bow_sweep.record.mcap_writer import FOOTER_SIZE, MAGIC
from bow_sweep.record.notes import too_new
from bow_sweep.record.run_bags import NOT_HERE, in_words, read_run


class DamagedCell(CellError):
    """The bag's messages of a cell are not all there, or a checksum does not hold; names block and chunk."""


class _CellSurvey(IndexSurvey):
    """Finds the messages of complete files by their index; files that are cut off, or still written, by reading all."""

    def read_file(self, scan: Scan) -> Iterator[Message]:
        """Take in the messages of a file."""
        read = IndexSurvey if _is_complete(scan.path) else Survey
        yield from read.read_file(self, scan)


def _is_complete(path: Path) -> bool:
    """Return whether a file has its end: the writer closed it."""
    size = path.stat().st_size
    with open(path, "rb") as file:
        file.seek(max(0, size - len(MAGIC)))
        return file.read() == MAGIC and size > FOOTER_SIZE + 2 * len(MAGIC)


class BagCells:
    """The cells in the bags of a run. The files stay open.

    Parameters
    ----------
    directory
        Of the bag, with those of stations in it.
    progress
        Called with (done, total) bytes of the bag's files.

    Attributes
    ----------
    outline
        The sweep, from the recorded plan.
    fingerprint
        Of the kernel that computed the run.

    Raises
    ------
    CellError
        Where the bag cannot be read, or holds no plan.
    """

    def __init__(self, directory: Path, progress: Progress | None = None) -> None:
        try:
            self._survey = read_run(directory, _CellSurvey, progress)
        except OSError as error:
            raise CellError(f"{directory}: cannot be read: {error.strerror}") from None
        except BagError as error:
            raise CellError(str(error)) from None
        if why := too_new(self._survey.version):
            raise CellError(f"{directory}: {why}")
        if self._survey.expected is None:
            what = self._survey.problems[0]["what"] if self._survey.problems else "no messages"
            raise CellError(f"{directory}: holds no plan, so no cell can be found in it ({what})")
        self.outline: SweepOutline = self._survey.expected
        self.fingerprint = str(self._survey.plan["fingerprint"])
        self._chunks = Chunks()
        planned = self.outline.planned
        self._block = np.full(self.outline.cells, -1)
        self._row = np.zeros(self.outline.cells, int)
        for block in range(planned.count):
            cells = planned.block(block)
            self._block[cells], self._row[cells] = block, np.arange(len(cells))

    def close(self) -> None:
        """Close the files."""
        self._chunks.__exit__()

    def block_of(self, cell: int) -> int | None:
        """Return the block of a cell; None where an adaptive sweep has not planned it."""
        return int(self._block[cell]) if self._block[cell] >= 0 else None

    def chunks_of(self, cell: int) -> int:
        """Return how many chunks of a cell are in the bag, with both streams."""
        block = self.block_of(cell)
        force, slip = (self._survey.places[topic] for topic in ("bridge_force", "stick_slip"))
        keys = [] if block is None else [(block, chunk) for chunk in range(self.outline.chunks)]
        return sum(key in force and key in slip for key in keys)

    def given_up(self, cell: int) -> bool:
        """Return whether the run has given up the block of a cell: simulators died of it."""
        block, states = self.block_of(cell), self._survey.plan["block_states"]
        return block is not None and block < len(states) and states[block] == BlockState.QUARANTINED

    def checksum(self, block: int, chunk: int) -> int | None:
        """Return the checksum of a chunk's streams that a verdict or a receipt states; None where none does."""
        verdict = self._survey.verdicts.get((block, chunk))
        return verdict.chunk_checksum if verdict else None

    def waveform(self, cell: int) -> Waveform:
        """Return the motion of a cell; the checksum of every message that it comes from is checked.

        Raises
        ------
        DamagedCell
            Where messages are missing, or a checksum does not hold.
        """
        block, row = self.block_of(cell), int(self._row[cell])
        if block is None:
            raise DamagedCell(f"cell {cell}: not simulated in this run")
        parts = []
        for chunk in range(self.outline.chunks):
            if any((block, chunk) not in self._survey.places[topic] for topic in ("bridge_force", "stick_slip")):
                if chunk not in self.outline.recorded_chunks:
                    raise DamagedCell(f"cell {cell}: {self._not_recorded(chunk)}")
                if self._survey.is_unseen(block):
                    raise DamagedCell(f"cell {cell}: {self._elsewhere(block)}")
                have = f"{self.chunks_of(cell)} of {self.outline.chunks} chunks"
                raise DamagedCell(f"cell {cell}: the bag has {have} of its block {block}; chunk {chunk} is missing")
            try:
                force, slip = self.streams(block, chunk)
            except DamagedCell as error:
                raise DamagedCell(f"cell {cell}: {error}") from None
            parts.append(part_of(row, self.outline.chunk_samples, force["data"], slip))
        return joined(parts, self.outline.chunk_samples)

    def streams(self, block: int, chunk: int) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the fields of BridgeForce and StickSlip of all cells of a block in a chunk; checksums are checked.

        Raises
        ------
        DamagedCell
            Where a message is missing, or its checksum does not hold.
        """
        return self._stream("bridge_force", "BridgeForce", block, chunk), self.stick_slip(block, chunk)

    def stick_slip(self, block: int, chunk: int) -> dict[str, Any]:
        """Return the fields of StickSlip of all cells of a block in a chunk; raises as :meth:`streams`."""
        return self._stream("stick_slip", "StickSlip", block, chunk)

    def _stream(self, topic: str, name: str, block: int, chunk: int) -> dict[str, Any]:
        place = self._survey.places[topic].get((block, chunk))
        if place is None:
            if chunk not in self.outline.recorded_chunks:
                raise DamagedCell(self._not_recorded(chunk))
            if self._survey.is_unseen(block):
                raise DamagedCell(self._elsewhere(block))
            raise DamagedCell(f"block {block}, chunk {chunk} is missing in the bag")
        try:
            return self.outline.unseal(name, self._read(place))
        except (BagError, cdr.WireError, OSError) as error:
            raise DamagedCell(f"block {block}, chunk {chunk} of the bag is damaged: {error}") from None

    def _not_recorded(self, chunk: int) -> str:
        return f"the run was recorded with record={self.outline.record}, without the waveforms of chunk {chunk}"

    def _elsewhere(self, block: int) -> str:
        station = in_words(self._survey.counts_from[block])
        return f"its block {block} was done at {station}, {NOT_HERE}"

    def force(self, cell: int, chunk: int) -> np.ndarray | None:
        """Return the bridge force of a cell in one chunk, (samples,) float32; None where the bag does not have it.

        Raises
        ------
        DamagedCell
            Where the checksum of its message does not hold.
        """
        block, row, samples = self.block_of(cell), int(self._row[cell]), self.outline.chunk_samples
        place = None if block is None else self._survey.places["bridge_force"].get((block, chunk))
        if place is None:
            return None
        try:
            values = self.outline.unseal("BridgeForce", self._read(place))
        except (BagError, cdr.WireError, OSError) as error:
            raise DamagedCell(f"cell {cell}: block {block}, chunk {chunk} of the bag is damaged: {error}") from None
        return np.array(values["data"][row * samples : (row + 1) * samples], np.float32)

    def _read(self, place: Place) -> bytes:
        """Return a whole message; the survey of the index knows its place only.

        Raises
        ------
        BagError
            Where it is in a compressed chunk, or the file ends before it.
        """
        return bytes(self._chunks.read(place))

    def verdicts(self, cell: int) -> dict[str, np.ndarray]:
        """Return the recorded verdicts on a cell by the name of the field, (tests,) each."""
        block, row, tests = self.block_of(cell), int(self._row[cell]), self.outline.chunks
        out = {name: field.array((tests,)) for name, field in VERDICT_FIELDS.items()}
        for chunk in range(tests):
            found = None if block is None else self._survey.verdicts.get((block, chunk))
            if found is not None:
                for name, values in out.items():
                    values[chunk] = found.layers[name][row]
        return out

    def basin(self) -> Basin:
        """Return all recorded verdicts."""
        outline = self.outline
        basin = Basin(outline.x.count, outline.y.count, outline.chunks, outline.repeats.count)
        for (block, chunk), verdict in sorted(self._survey.verdicts.items()):
            basin.take(chunk, self.outline.block(block), verdict.layers)
        return basin


def has_bag(directory: Path) -> bool:
    """Return whether a directory is a bag, or holds those of a run's stations."""
    return bool(bags_in(directory))
