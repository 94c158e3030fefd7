"""A sweep: which cells, in which blocks, with which parameters.

A *cell* is a point of a parameter plane, a *block* the cells that one simulator computes together, a *chunk* five
periods of a block. Command line, preset files, goals and bags describe a sweep in the same way: by "name=value"
settings over a preset, see :mod:`bow_sim.protocol.sweep_spec`. Here the settings that are not given get their defaults.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.kernel.fingerprint import fingerprint
from bow_sim.kernel.sources import source_hash
from bow_sim.physics.applicability import check_strings, notes_of_map
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.instruments import overridden
from bow_sim.physics.kinds import is_kind
from bow_sim.physics.parameters import Parameters, parse_settings
from bow_sim.protocol.blocks import Blocks
from bow_sim.protocol.limits import MAX_CHUNK_VALUES, check_size
from bow_sim.protocol.recording import DEFAULT, record_of, recorded_chunks
from bow_sim.protocol.repeats import NO_REPEATS, Repeats
from bow_sim.protocol.sweep_spec import Axis, axis_values, check_plane, in_full, kinds_of_cells, split
from bow_sweep.plan.adaptive import first_round, next_round, within_budget
from bow_sweep.plan.axes import AxisError, AxisSettings, axes, check_axes_of_models, check_two, made
from bow_sweep.plan.presets import load_preset
from bow_sweep.plan.remedies import study_instead, would_do

X_AXIS = Axis("f_asym", "log", 0.5, 20.0, 128)
Y_AXIS = Axis("f_init_ratio", "linear", 0.0, 2.0, 64)
"""The plane of the paper's Figs 10 and 11 (Appendix)."""

UNITS = {"z_0", "v_unit", "string_length"}
"""Parameters that have a common value also where they are an axis: without one, others could not be in SI units."""

BLOCKS, ADAPTIVE_BLOCKS = 16, 64
"""Least number of blocks, exhaustive and adaptive, where block_cells is not set: enough for several simulators, and for
the rounds of an adaptive sweep."""

LEAST_BLOCK, MOST_BLOCK = 64, 512
"""Range of block_cells where it is not set. The cost of a message hardly depends on its size, so blocks should be
large."""


def default_block_cells(cells: int, adaptive: float, chunk_samples: int) -> int:
    """Return the number of cells of a block where block_cells is not set: a multiple of eight, the lanes of the kernel.

    Parameters
    ----------
    cells
        Number of cells of the plane.
    adaptive
        Largest share of the cells to simulate.
    chunk_samples
        Samples of a chunk.
    """
    wanted = -(-cells // (ADAPTIVE_BLOCKS if adaptive < 1 else BLOCKS))
    most = min(MOST_BLOCK, max(1, MAX_CHUNK_VALUES // chunk_samples))
    return min(max(wanted, LEAST_BLOCK), most) // 8 * 8 or most


@dataclass(frozen=True)
class Sweep:
    """A sweep with all its settings. :meth:`from_spec` builds and checks it.

    Attributes
    ----------
    parameters
        What all cells share; the two swept parameters keep their defaults.
    x, y
        The axes of the plane.
    block_cells
        Largest number of cells of a block, :func:`default_block_cells` unless set.
    thresholds
        Of the verdicts.
    preset
        Name of the preset that the settings began from; "" for none.
    adaptive
        Largest share of the cells to simulate; 1 = all cells, planned at once.
    repeats
        How the cells are repeated.
    record
        Which streams are recorded, see :mod:`bow_sim.protocol.recording`.
    """

    parameters: Parameters
    x: Axis = X_AXIS
    y: Axis = Y_AXIS
    block_cells: int = MOST_BLOCK
    thresholds: Thresholds = field(default_factory=Thresholds)
    preset: str = ""
    adaptive: float = 1.0
    repeats: Repeats = NO_REPEATS
    record: str = DEFAULT

    @classmethod
    def from_spec(cls, preset: str = "", settings: Iterable[str] = ()) -> Sweep:
        """Return the sweep that a preset and "name=value" settings over it describe.

        Raises
        ------
        ParameterError
            For a sweep that cannot be computed; names the setting, its value and what would be right.
        """
        lines = list(settings)
        try:
            return cls._of(preset, lines)
        except AxisError as error:

            def works(more: list[str]) -> object:
                return cls._of(preset, [*lines, *more])

            axes_named = tuple(zip("xy", error.axes, strict=True))
            reason = study_instead(str(error), preset, lines, axes_named)
            raise ParameterError(f"{reason}{would_do(*error.axes, works)}") from None

    @classmethod
    def _of(cls, preset: str, lines: list[str]) -> Sweep:
        given, preset_settings = parse_settings(lines), load_preset(preset) if preset else {}
        spec = split({**overridden(preset_settings, given), **given})
        named = axes((X_AXIS, Y_AXIS), (preset_settings.items(), map(_pair, lines)))
        thresholds = Thresholds.from_mapping(spec.classifier)
        for axis in named:
            for name in filter(axis.gives, given):
                if name not in UNITS and not _before(lines, name, axis):
                    right = f"set {axis.key}.first, {axis.key}.last and {axis.key}.count"
                    raise ParameterError(f"{name} = {given[name]!r}: it is the {axis.key} axis of the map; {right}")
        swept = {name for name in spec.plain for axis in named if axis.gives(name)} - UNITS
        common = {name: value for name, value in spec.plain.items() if name not in swept}
        parameters = replace(spec, plain=common).parameters()
        try:
            check_two(*named)
            check_axes_of_models(parameters, *named)
            x, y = made(*named, parameters)
            check_plane(parameters, x, y)
            check_strings(parameters, x, y)
        except ParameterError as error:
            raise AxisError(str(error), named[0].name, named[1].name) from None
        adaptive, repeats = spec.share("adaptive", cls.adaptive), Repeats.of(spec)
        if repeats.count and (kind := next((axis for axis in named if is_kind(axis.name)), None)):
            raise ParameterError(
                f"repeats = {repeats.count}: cannot be beside {kind.key}.name = {kind.name!r}; make a map for each "
                f"value, as by bow study --over {kind.name}=..."
            )
        repeats.check(parameters, x, y)
        if spec.block_cells is None:
            block_cells = default_block_cells(repeats.cells(x.count * y.count), adaptive, parameters.chunk_samples)
        else:
            block_cells = spec.number("", "block_cells")
        check_size(x.count, y.count, block_cells, parameters, repeats.count)
        record = record_of(spec.record)
        return cls(parameters, x, y, block_cells, thresholds, preset, adaptive, repeats, record)

    def settings(self) -> tuple[str, ...]:
        """Return every setting as "name=value", sorted; :meth:`from_spec` makes the same sweep of them."""
        return self._settings

    @cached_property
    def _settings(self) -> tuple[str, ...]:
        own = {f"{key}.{name}": value for key, axis in self._axes for name, value in axis.settings().items()}
        own["block_cells"] = self.block_cells
        if self.adaptive < 1:
            own["adaptive"] = self.adaptive
        if self.record != DEFAULT:
            own["record"] = self.record
        own |= self.repeats.settings()
        units = {f"{name}={getattr(self.parameters, name)!r}" for name in UNITS if getattr(self.parameters, name)}
        swept = (self.x.name + "=", self.y.name + "=")
        lines = [f"{key}={value}" for key, value in own.items()]
        lines += [line for line in self.parameters.settings() if not line.startswith(swept) or line in units]
        lines += [f"classifier.{line}" for line in self.thresholds.settings()]
        return tuple(sorted(lines))

    @property
    def _axes(self) -> tuple[tuple[str, Axis], ...]:
        return (("x", self.x), ("y", self.y))

    @cached_property
    def sweep_id(self) -> str:
        """Hash of the settings (dtype included) and the kernel's source, 16 hexadecimal digits.

        The thresholds and what is recorded are left out: they do not change the waveforms, which can be classified
        again.
        """
        physics = [line for line in self.settings() if not line.startswith(("classifier.", "record="))]
        return hashlib.sha256(json.dumps([physics, source_hash()]).encode()).hexdigest()[:16]

    @cached_property
    def fingerprint(self) -> str:
        """What this machine computes for the sweep (:func:`bow_sim.kernel.fingerprint.fingerprint`)."""
        return fingerprint(self.parameters, self.x, self.y)

    @property
    def notes(self) -> tuple[str, ...]:
        """What is allowed in the settings, but perhaps not meant: a line for each."""
        return notes_of_map(self.parameters, self.x, self.y)

    @property
    def cells(self) -> int:
        """Number of cells to simulate, repeats included; their numbers are 0 ... cells - 1."""
        return self.repeats.cells(self.plane_cells)

    @property
    def plane_cells(self) -> int:
        """Number of cells of the plane; the index of a cell is iy * nx + ix."""
        return self.x.count * self.y.count

    @property
    def budget(self) -> int:
        """Largest number of cells to simulate."""
        return within_budget(self.adaptive, self.cells) if self.adaptive < 1 else self.cells

    @cached_property
    def first_blocks(self) -> Blocks:
        """The blocks that are planned at the start: all, or the first round of an adaptive sweep."""
        if self.adaptive == 1:
            return Blocks(self.cells, self.block_cells, kinds=self.kinds)
        first = first_round((self.y.count, self.x.count), self.budget)
        return Blocks(self.cells, self.block_cells, [first], self.kinds)

    @cached_property
    def kinds(self) -> NDArray[np.int64] | None:
        """The kind of every cell, (cells,): a block has cells of one kind. None where all are of one."""
        return kinds_of_cells(self.x, self.y, self.cells)

    def more_blocks(self, blocks: Blocks, transient_periods: np.ndarray) -> Blocks | None:
        """Return `blocks` and those of the next round; None where nothing more is to be simulated.

        Parameters
        ----------
        transient_periods
            (cells,) periods until the tests first passed, 0 = never, NaN = not done.
        """
        if not blocks.adaptive:
            return None
        shape = (self.y.count, self.x.count)
        cells = next_round(blocks.planned.reshape(shape), transient_periods.reshape(shape), self.budget)
        return blocks.grown(cells) if len(cells) else None

    @property
    def blocks(self) -> int:
        """Number of blocks planned at the start; the last may be smaller."""
        return self.first_blocks.count

    @property
    def chunks(self) -> int:
        """Number of chunks, and so of tests, of every block."""
        return self.parameters.chunks

    @property
    def recorded_chunks(self) -> range:
        """The chunks of every block whose streams are recorded."""
        return recorded_chunks(self.record, self.chunks)

    def block(self, block: int) -> np.ndarray:
        """Return the cells of a block planned at the start, (cells of the block,) uint32.

        Raises
        ------
        IndexError
            Where there is no such block.
        """
        return self.first_blocks.block(block)

    def lanes(self, cells: np.ndarray) -> dict[str, np.ndarray]:
        """Return what differs between `cells`, by name, (cells,) each.

        These are the two swept parameters; with repeats also the bow force and its ratio, all in the paper's units.
        """
        return self.repeats.vary(self.parameters, self.axis_values(cells), cells, self.plane_cells)

    def axis_values(self, cells: np.ndarray) -> dict[str, np.ndarray]:
        """Return the values of the two swept parameters at `cells`: {x.name: (cells,), y.name: (cells,)}."""
        return axis_values(self.x, self.y, cells)


def _before(lines: list[str], name: str, axis: AxisSettings) -> bool:
    """Return whether a setting comes before the axis that takes its place, as that of a preset file does."""
    order = [in_full(_pair(line)[0]) for line in lines]
    return f"{axis.key}.name" in order and order.index(name) < max(
        place for place, each in enumerate(order) if each == f"{axis.key}.name"
    )


def _pair(setting: str) -> tuple[str, str]:
    name, _, value = setting.partition("=")
    return name.strip(), value.strip()
