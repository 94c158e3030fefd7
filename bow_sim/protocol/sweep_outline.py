"""The outline of a sweep, from the settings that its plan announces: axes, blocks, chunks, samples.

Classifier, recorder and dashboard build it from a Plan message; `bow verify` and `bow replay` from a recorded one. It
decides which messages belong to the sweep. All sizes are checked here, before anybody allocates memory for them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics.cells import paper_lanes
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import Parameters
from bow_sim.protocol import cdr
from bow_sim.protocol.blocks import Blocks
from bow_sim.protocol.limits import check_size
from bow_sim.protocol.measured import is_measured
from bow_sim.protocol.recording import DEFAULT, judged_at_source, record_of, recorded_chunks
from bow_sim.protocol.repeats import NO_REPEATS, Repeats
from bow_sim.protocol.sweep_spec import Axis, axis_values, check_plane, kinds_of_cells, split

_IDENTIFIER = re.compile("[0-9a-f]{16}")


@dataclass(frozen=True, eq=False, kw_only=True)
class SweepOutline:
    """The outline of one run of a sweep. Does not change; :meth:`grown` gives one with more rounds.

    Attributes
    ----------
    run_id, sweep_id
        16 hexadecimal digits each.
    classifier
        Hash of the thresholds: verdicts with another one do not belong to this run.
    preset, settings
        As announced; `settings` are complete.
    parameters
        What all cells share; the two swept parameters keep their defaults.
    x, y
        The axes of the map.
    threshold_settings
        Thresholds of the verdicts, by name, as text.
    planned
        The blocks planned so far.
    adaptive
        Largest share of the cells that may be simulated; 1 = all cells, planned at once.
    repeats
        How the cells are repeated.
    record
        Which streams are recorded, see :mod:`bow_sim.protocol.recording`.
    """

    run_id: str
    sweep_id: str
    classifier: str
    preset: str
    settings: tuple[str, ...]
    parameters: Parameters
    x: Axis
    y: Axis
    threshold_settings: Mapping[str, object]
    planned: Blocks
    adaptive: float
    repeats: Repeats = NO_REPEATS
    record: str = DEFAULT

    @classmethod
    def of(cls, plan: Mapping[str, Any]) -> SweepOutline:
        """Return the outline of the run that a decoded Plan describes.

        Raises
        ------
        ParameterError
            Where it is not a plan that can be run. The identifiers are checked too, because they name directories.
        """
        for name in ("run_id", "sweep_id"):
            if not _IDENTIFIER.fullmatch(plan[name]):
                raise ParameterError(f"{name} = {plan[name]!r}: should be 16 hexadecimal digits")
        settings, rounds = tuple(plan["spec.settings"]), plan["rounds"]
        spec = split(settings)
        parameters = spec.parameters()
        counts = spec.number("x", "count"), spec.number("y", "count")
        block_cells = spec.number("", "block_cells")
        repeats = Repeats.of(spec)
        check_size(*counts, block_cells, parameters, repeats.count)
        x, y = Axis.of("x", spec.x), Axis.of("y", spec.y)
        check_plane(parameters, x, y)
        repeats.check(parameters, x, y)
        adaptive, cells = spec.share("adaptive", 1.0), repeats.cells(x.count * y.count)
        if (adaptive < 1) != bool(len(rounds)):
            raise ParameterError(f"Plan.rounds has {len(rounds)} values, at adaptive = {adaptive:g}")
        return cls(
            run_id=plan["run_id"],
            sweep_id=plan["sweep_id"],
            classifier=plan["classifier"],
            preset=plan["spec.preset"],
            settings=settings,
            parameters=parameters,
            x=x,
            y=y,
            threshold_settings=spec.classifier,
            planned=Blocks.announced(cells, block_cells, rounds, kinds_of_cells(x, y, cells)),
            adaptive=adaptive,
            repeats=repeats,
            record=record_of(spec.record),
        )

    def grown(self, rounds: NDArray[np.integer]) -> SweepOutline:
        """Return the outline that a later plan of this run gives, from its ``Plan.rounds``.

        Raises
        ------
        ParameterError
            Where the blocks that are known are not among those of the plan.
        """
        known = self.planned
        if np.array_equal(rounds, known.announce()):
            return self
        planned = Blocks.announced(known.cells, known.block_cells, rounds, known.kinds)
        if not planned.extends(known):
            raise ParameterError(f"Plan.rounds: its {planned.count} blocks do not contain the {known.count} known ones")
        return replace(self, planned=planned)

    def followed(self, plan: Mapping[str, Any]) -> SweepOutline:
        """Return the outline that a later plan of this run gives: with more rounds, or the length of what was measured.

        Raises
        ------
        ParameterError
            As :meth:`grown`, or where the plan of a measured string cannot be.
        """
        if is_measured(plan) and tuple(plan["spec.settings"]) != self.settings:
            return SweepOutline.of(plan)
        return self.grown(plan["rounds"])

    @property
    def shape(self) -> tuple[int, int]:
        """Cells along y and x."""
        return self.y.count, self.x.count

    @property
    def cells(self) -> int:
        """Number of cells to simulate, repeats included; their numbers are 0 ... cells - 1."""
        return self.planned.cells

    @property
    def plane_cells(self) -> int:
        """Number of cells of the plane; the index of a cell is iy * nx + ix."""
        return self.x.count * self.y.count

    @property
    def blocks(self) -> int:
        """Number of blocks planned so far."""
        return self.planned.count

    @property
    def chunks(self) -> int:
        """Number of chunks, and so of tests, of every block."""
        return self.parameters.chunks

    @property
    def recorded_chunks(self) -> range:
        """The chunks of every block whose streams are recorded."""
        return recorded_chunks(self.record, self.chunks)

    @property
    def judged_at_source(self) -> bool:
        """Whether the simulators judge the chunks, and not the classifier."""
        return judged_at_source(self.record)

    @property
    def chunk_samples(self) -> int:
        """Samples of every chunk."""
        return self.parameters.chunk_samples

    def block(self, block: int) -> NDArray[np.uint32]:
        """Return the cells of a block, (cells of the block,).

        Raises
        ------
        IndexError
            Where there is no such block.
        """
        return self.planned.block(block)

    def values(self, name: str, cells: NDArray[np.integer]) -> NDArray[np.float64]:
        """Return the value of a numeric parameter, in the paper's units, at some cells, (cells,)."""
        lanes = paper_lanes(self.parameters, self.lanes(cells))
        if name in lanes:
            return np.asarray(lanes[name], np.float64)
        return np.full(len(cells), getattr(self.parameters, name), np.float64)

    def lanes(self, cells: NDArray[np.integer]) -> dict[str, NDArray[np.float64]]:
        """Return what differs between some cells, by name, (cells,) each: axes, and deviations of repeats."""
        values = axis_values(self.x, self.y, cells)
        return self.repeats.vary(self.parameters, values, cells, self.plane_cells)

    def identity_objection(self, values: Mapping[str, Any]) -> str:
        """Return why the identity of a message does not belong to this sweep; "" where it does.

        Parameters
        ----------
        values
            The fields of its identity, as :func:`bow_sim.protocol.cdr.decode_head` gives them.
        """
        run_id, sweep_id, block, chunk = (values[field] for field in ("run_id", "sweep_id", "block", "chunk"))
        if run_id != self.run_id or sweep_id != self.sweep_id:
            return (
                f"it is of run {run_id!r}, sweep {sweep_id!r}; "
                f"should be of run {self.run_id!r}, sweep {self.sweep_id!r}"
            )
        if block >= self.blocks or chunk >= self.chunks:
            return f"block {block}, chunk {chunk}: the sweep has {self.blocks} blocks of {self.chunks} chunks"
        return ""

    def objection(self, name: str, values: Mapping[str, Any]) -> str:
        """Return why a message does not belong to this sweep; "" where it does.

        Parameters
        ----------
        name
            "BridgeForce", "StickSlip" or "Verdicts".
        values
            Its fields, from :func:`bow_sim.protocol.cdr.unseal`.
        """
        if reason := self.identity_objection(values):
            return reason
        block, chunk = values["block"], values["chunk"]
        cells = self.block(block)
        if values["cells"].tobytes() != cells.tobytes():  # both uint32
            return f"its cells are not the {len(cells)} cells of block {block}, {cells[0]} ... {cells[-1]}"
        if name == "Verdicts":
            right = self.classifier
            return (
                "" if values["classifier"] == right else f"classifier = {values['classifier']!r}: should be {right!r}"
            )
        samples = self.chunk_samples
        if (values["samples"], values["first_sample"]) != (samples, chunk * samples):
            return (
                f"{values['samples']} samples from sample {values['first_sample']} on, "
                f"should be {samples} from sample {chunk * samples} on in chunk {chunk}"
            )
        return ""

    def unseal(self, name: str, data: cdr.Buffer) -> dict[str, Any]:
        """Return the fields of a message of this sweep, checksum and contents checked.

        Raises
        ------
        WireError
            Where the message is damaged or does not belong to this sweep; says why.
        """
        values = cdr.unseal(name, data)
        if reason := self.objection(name, values):
            raise cdr.WireError(f"{name}: {reason}")
        return values
