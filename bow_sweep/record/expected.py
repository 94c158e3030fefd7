"""What the messages of one run have to look like: from its plan, without the kernel or the classifier at hand."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bow_sim.physics.errors import ParameterError
from bow_sim.protocol import cdr
from bow_sim.protocol.blocks import Blocks
from bow_sim.protocol.limits import check_size
from bow_sim.protocol.sweep_spec import split

OPEN, CLOSED = 1, 2
"""Plan.state."""

DONE, QUARANTINED = 1, 2
"""Values of Plan.block_states; 0 is outstanding."""

_IDENTIFIER = re.compile("[0-9a-f]{16}")


@dataclass(frozen=True, eq=False)
class Expected:
    """The outline of a run.

    Attributes
    ----------
    run_id, sweep_id
        16 hexadecimal digits each.
    classifier
        Hash of the classifier's parameters: other verdicts are not this run's.
    shape
        (ny, nx) of the plane.
    planned
        The blocks, as far as they are planned.
    adaptive
        Share of the cells to simulate at most.
    chunks, chunk_samples
        Chunks of every block, and samples of every chunk.
    """

    run_id: str
    sweep_id: str
    classifier: str
    shape: tuple[int, int]
    planned: Blocks
    adaptive: float
    chunks: int
    chunk_samples: int

    @classmethod
    def of(cls, plan: Mapping[str, Any]) -> Expected:
        """Return the outline of the run that a decoded Plan describes.

        Raises
        ------
        ParameterError
            Where the plan is not one that can be run; the identifiers are checked because they name directories.
        """
        for name in ("run_id", "sweep_id"):
            if not _IDENTIFIER.fullmatch(plan[name]):
                raise ParameterError(f"{name} = {plan[name]!r}: should be 16 hexadecimal digits")
        spec = split(plan["spec.settings"])
        parameters = spec.parameters()
        counts = spec.number("x", "count"), spec.number("y", "count")
        block_cells = spec.number("", "block_cells")
        check_size(*counts, block_cells, parameters)
        adaptive = 1.0 if spec.adaptive is None else spec.share("adaptive")
        if (adaptive < 1) != bool(len(plan["rounds"])):
            raise ParameterError(f"Plan.rounds has {len(plan['rounds'])} values, at adaptive = {adaptive:g}")
        return cls(
            run_id=plan["run_id"],
            sweep_id=plan["sweep_id"],
            classifier=plan["classifier"],
            shape=(counts[1], counts[0]),
            adaptive=adaptive,
            planned=Blocks.announced(counts[0] * counts[1], block_cells, plan["rounds"]),
            chunks=parameters.chunks,
            chunk_samples=parameters.chunk_samples,
        )

    def grown(self, plan: Mapping[str, Any]) -> Expected:
        """Return the outline that a later plan of this run gives: it may have more rounds.

        Raises
        ------
        ParameterError
            Where the blocks that are known are not among its own.
        """
        known = self.planned
        if np.array_equal(plan["rounds"], known.announce()):
            return self
        planned = Blocks.announced(known.cells, known.block_cells, plan["rounds"])
        if not planned.extends(known):
            raise ParameterError(f"Plan.rounds: {planned.count} blocks, which are not the {known.count} known and more")
        return replace(self, planned=planned)

    @property
    def cells(self) -> int:
        """Number of cells of the plane."""
        return self.planned.cells

    @property
    def blocks(self) -> int:
        """Number of blocks planned so far."""
        return self.planned.count

    def block(self, block: int) -> np.ndarray:
        """Return the cells of a block, (cells of the block,) uint32."""
        return self.planned.block(block)

    def check_head(self, values: Mapping[str, Any]) -> None:
        """Raise WireError where a message is not of this run or of no chunk in it."""
        seen = cdr.identity(values)
        if (seen.run_id, seen.sweep_id) != (self.run_id, self.sweep_id):
            raise cdr.WireError(
                f"run {seen.run_id!r}, sweep {seen.sweep_id!r}: this is run {self.run_id}, sweep {self.sweep_id}"
            )
        if seen.block >= self.blocks or seen.chunk >= self.chunks:
            raise cdr.WireError(
                f"block {seen.block}, chunk {seen.chunk}: there are {self.blocks} blocks of {self.chunks} chunks"
            )

    def check(self, name: str, data: bytes | memoryview) -> dict[str, Any]:
        """Return the fields of a stream message or verdicts, everything about it checked.

        Raises
        ------
        WireError
            Saying what does not fit the plan or itself.
        """
        values = cdr.unseal(name, data)
        self.check_head(values)
        block, chunk = values["block"], values["chunk"]
        if not np.array_equal(values["cells"], self.block(block)):
            raise cdr.WireError(f"{name}.cells: not the {len(self.block(block))} cells of block {block}")
        if name == "Verdicts":
            if values["classifier"] != self.classifier:
                raise cdr.WireError(f"Verdicts.classifier = {values['classifier']!r}: should be {self.classifier!r}")
            return values
        right = {"samples": self.chunk_samples, "first_sample": chunk * self.chunk_samples}
        for field, value in right.items():
            if values[field] != value:
                raise cdr.WireError(f"{name}.{field} = {values[field]}: should be {value} in chunk {chunk}")
        return values
