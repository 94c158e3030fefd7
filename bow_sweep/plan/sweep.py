"""A sweep as a plan: which cells, in which blocks, with which parameters.

A *sweep* is a plan of *cells* (points of a parameter plane); a *block* is the cells that one simulator runs together; a
*chunk* is five periods of a block. A sweep has one written form, "name=value" settings over a preset, which command
line, preset files, goals and bags share: the names of :class:`bow_sim.physics.parameters.Parameters`, ``x.*`` and
``y.*`` for the axes, ``block_cells``, ``adaptive``, and ``classifier.*`` for the thresholds of the verdicts.
"""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.kernel.fingerprint import source_hash
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import SWEEPABLE, TYPES, Parameters, parse_settings
from bow_sim.protocol.blocks import Blocks
from bow_sim.protocol.limits import MAX_CELLS, MAX_CHUNK_VALUES, check_size
from bow_sim.protocol.sweep_spec import axis_values, split
from bow_sweep.plan.adaptive import first_round, next_round, within_budget

MAX_PRESET_BYTES, MAX_PRESET_BRACKETS, MAX_PRESET_KEYS = 1 << 16, 200, 1000
"""In a preset file at most; its names can multiply by aliases."""


@dataclass(frozen=True)
class Axis:
    """One axis of the map: a parameter and the values it takes.

    Attributes
    ----------
    name
        A numeric field of :class:`bow_sim.physics.parameters.Parameters`.
    scale
        "log" or "linear".
    first, last
        Both included, in the parameter's unit.
    count
        Number of values.
    """

    name: str
    scale: str
    first: float
    last: float
    count: int

    def values(self) -> np.ndarray:
        """Return the values along the axis, shape (count,), both ends exact."""
        return axis_values(self.scale, self.first, self.last, self.count)

    def check(self, key: str) -> None:
        """Raise ParameterError, naming the key below `key`, where the axis makes no sense."""
        if self.name not in SWEEPABLE:
            raise ParameterError(f"{key}.name = {self.name!r}: cannot be swept; one of {', '.join(sorted(SWEEPABLE))}")
        if self.scale not in ("log", "linear"):
            raise ParameterError(f"{key}.scale = {self.scale!r}: should be 'log' or 'linear'")
        if not 1 <= self.count <= MAX_CELLS:
            raise ParameterError(f"{key}.count = {self.count}: should be 1 ... {MAX_CELLS}")
        for name in ("first", "last"):
            value = getattr(self, name)
            if not np.isfinite(value):
                raise ParameterError(f"{key}.{name} = {value}: should be a finite number")
            if self.scale == "log" and value <= 0:
                raise ParameterError(f"{key}.{name} = {value}: should be above 0 on a logarithmic axis")
        if self.count > 1 and self.first == self.last:
            raise ParameterError(f"{key}.last = {self.last}: {self.count} values need it to differ from {key}.first")
        if TYPES[self.name] is int and (self.values() % 1).any():
            raise ParameterError(
                f"{key}.count = {self.count}: {self.name} takes whole numbers, and {self.first:g} ... {self.last:g} "
                f"in so many {self.scale} steps are not; for instance {key}.scale=linear and one step each"
            )


AXIS_FIELDS = frozenset(part.name for part in fields(Axis))

X_AXIS = Axis("f_asym", "log", 0.5, 20.0, 128)
Y_AXIS = Axis("f_init_ratio", "linear", 0.0, 2.0, 64)
"""The plane of the paper's Figs 10 and 11 (Appendix)."""


BLOCKS, ADAPTIVE_BLOCKS = 16, 64
"""Of a sweep at least, where its blocks are not set: enough for a pool, and for the rounds of an adaptive sweep."""

LEAST_BLOCK, MOST_BLOCK = 64, 512
"""Cells of a block that is not set. A message costs much the same whatever is in it, so blocks should be large."""


def default_block_cells(cells: int, adaptive: float, chunk_samples: int) -> int:
    """Return how many cells a block has where nobody says: a multiple of eight, the lanes of the kernel."""
    wanted = -(-cells // (ADAPTIVE_BLOCKS if adaptive < 1 else BLOCKS))
    most = min(MOST_BLOCK, max(1, MAX_CHUNK_VALUES // chunk_samples))
    return min(max(wanted, LEAST_BLOCK), most) // 8 * 8 or most


@dataclass(frozen=True)
class Sweep:
    """A resolved sweep. Build it with :meth:`from_spec`; what cannot be computed is refused there.

    `adaptive` is the share of the cells to simulate at most; 1 = all of them, planned at once. `block_cells` is
    :func:`default_block_cells` unless set.
    """

    parameters: Parameters
    x: Axis = X_AXIS
    y: Axis = Y_AXIS
    block_cells: int = MOST_BLOCK
    thresholds: Thresholds = field(default_factory=Thresholds)
    preset: str = ""
    adaptive: float = 1.0

    @classmethod
    def from_spec(cls, preset: str = "", settings: Iterable[str] = ()) -> Sweep:
        """Return the sweep that a preset and "name=value" settings over it describe.

        Raises
        ------
        ParameterError
            Naming the key, its value and what would be right.
        """
        given = parse_settings(settings)
        spec = split({**(_flatten(load_preset(preset)) if preset else {}), **given})
        x, y = _axis("x", X_AXIS, spec.x), _axis("y", Y_AXIS, spec.y)
        if x.name == y.name:
            raise ParameterError(f"y.name = {y.name!r}: both axes are this parameter; they should differ")
        if x.count * y.count > MAX_CELLS:
            raise ParameterError(f"x.count * y.count = {x.count * y.count} cells: should be at most {MAX_CELLS}")
        thresholds = Thresholds.from_mapping(spec.classifier)
        for axis, key in ((x, "x"), (y, "y")):
            if axis.name in given:
                right = f"it is the {key} axis of the map; set {key}.first, {key}.last and {key}.count"
                raise ParameterError(f"{axis.name} = {given[axis.name]!r}: {right}")
        common = {name: value for name, value in spec.plain.items() if name not in (x.name, y.name)}
        parameters = replace(spec, plain=common).parameters()
        for x_end, y_end in itertools.product(("first", "last"), repeat=2):  # what is right at the corners is within
            try:
                parameters.replace(**{x.name: getattr(x, x_end), y.name: getattr(y, y_end)})
            except ParameterError as error:
                raise ParameterError(f"at x.{x_end} and y.{y_end}: {error}") from None
        adaptive = cls.adaptive if spec.adaptive is None else spec.share("adaptive")
        if spec.block_cells is None:
            block_cells = default_block_cells(x.count * y.count, adaptive, parameters.chunk_samples)
        else:
            block_cells = _integer("block_cells", spec.block_cells)
        check_size(x.count, y.count, block_cells, parameters)
        return cls(parameters, x, y, block_cells, thresholds, preset, adaptive)

    def settings(self) -> tuple[str, ...]:
        """Return every setting as sorted "name=value" strings: :meth:`from_spec` gives the same sweep from them."""
        own = {f"{key}.{part.name}": getattr(axis, part.name) for key, axis in self._axes for part in fields(Axis)}
        own["block_cells"] = self.block_cells
        if self.adaptive < 1:
            own["adaptive"] = self.adaptive
        swept = (self.x.name + "=", self.y.name + "=")
        lines = [f"{key}={value}" for key, value in own.items()]
        lines += [line for line in self.parameters.settings() if not line.startswith(swept)]
        lines += [f"classifier.{line}" for line in self.thresholds.settings()]
        return tuple(sorted(lines))

    @property
    def _axes(self) -> tuple[tuple[str, Axis], ...]:
        return (("x", self.x), ("y", self.y))

    @cached_property
    def sweep_id(self) -> str:
        """Hash of the sorted parameters (dtype among them) and the kernel's source, 16 hexadecimal digits.

        The thresholds are not part of it: the same waveforms can be judged again.
        """
        physics = [line for line in self.settings() if not line.startswith("classifier.")]
        return hashlib.sha256(json.dumps([physics, source_hash()]).encode()).hexdigest()[:16]

    @property
    def cells(self) -> int:
        """Number of cells; the index of a cell is iy * nx + ix."""
        return self.x.count * self.y.count

    @property
    def budget(self) -> int:
        """Number of cells to simulate at most."""
        return within_budget(self.adaptive, self.cells) if self.adaptive < 1 else self.cells

    @cached_property
    def first_blocks(self) -> Blocks:
        """The blocks that are planned at the beginning: all, or those of an adaptive sweep's first round."""
        if self.adaptive == 1:
            return Blocks(self.cells, self.block_cells)
        return Blocks(self.cells, self.block_cells, [first_round((self.y.count, self.x.count), self.budget)])

    def more_blocks(self, blocks: Blocks, transient_periods: np.ndarray) -> Blocks | None:
        """Return `blocks` and those of another round, or None where nothing more is to be simulated.

        Parameters
        ----------
        transient_periods
            (cells,) periods until the tests first passed, 0 = never, NaN = not done; see
            :mod:`bow_sweep.plan.adaptive`.
        """
        if not blocks.adaptive:
            return None
        shape = (self.y.count, self.x.count)
        cells = next_round(blocks.planned.reshape(shape), transient_periods.reshape(shape), self.budget)
        return blocks.grown(cells) if len(cells) else None

    @property
    def blocks(self) -> int:
        """Number of blocks at the beginning; the last may be smaller."""
        return self.first_blocks.count

    @property
    def chunks(self) -> int:
        """Number of chunks, and so of tests, of every block."""
        return self.parameters.chunks

    def block(self, block: int) -> np.ndarray:
        """Return the cells of a block that is planned at the beginning, shape (cells of the block,), uint32.

        Raises
        ------
        IndexError
            Where the sweep has no such block.
        """
        return self.first_blocks.block(block)

    def lanes(self, cells: np.ndarray) -> dict[str, np.ndarray]:
        """Return the values of the two swept parameters at `cells`: {x.name: (cells,), y.name: (cells,)}."""
        iy, ix = np.divmod(cells.astype(np.int64), self.x.count)
        return {self.x.name: self.x.values()[ix], self.y.name: self.y.values()[iy]}


def _integer(key: str, value: Any) -> int:
    try:
        number = int(str(value))
    except ValueError:
        raise ParameterError(f"{key} = {value!r}: should be a whole number") from None
    return number


def _axis(key: str, default: Axis, given: Mapping[str, Any]) -> Axis:
    unknown = set(given) - AXIS_FIELDS
    if unknown:
        known = ", ".join(f"{key}.{name}" for name in sorted(AXIS_FIELDS))
        raise ParameterError(f"{key}.{min(unknown)}: no such setting; the axis has {known}")
    values = {name: given.get(name, getattr(default, name)) for name in AXIS_FIELDS}
    values["count"] = _integer(f"{key}.count", values["count"])
    for name in ("first", "last"):
        try:
            values[name] = float(values[name])
        except (TypeError, ValueError):
            raise ParameterError(f"{key}.{name} = {values[name]!r}: should be a number") from None
    axis = Axis(**values)
    axis.check(key)
    return axis


def _flatten(mapping: Mapping[str, Any]) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    todo = [("", mapping)]
    for prefix, group in todo:
        for key, value in group.items():
            if isinstance(value, Mapping):
                todo.append((f"{prefix}{key}.", value))
            else:
                flat[f"{prefix}{key}"] = value
        if len(flat) + len(todo) > MAX_PRESET_KEYS:
            raise ParameterError(f"a preset with more than {MAX_PRESET_KEYS} names: should have each once")
    return flat


def preset_directory() -> Path:
    """Return where the presets are: config/ of the source tree, or share/bow/config of the prefix we live in.

    Raises
    ------
    FileNotFoundError
        Where neither is above this module.
    """
    for above in Path(__file__).resolve().parents:
        for candidate in (above / "config", above / "share" / "bow" / "config"):
            if (candidate / "presets").is_dir():
                return candidate
    raise FileNotFoundError(f"no config/presets or share/bow/config/presets in any folder above {__file__}")


def presets() -> dict[str, str]:
    """Return {name: title} of the presets there are, sorted."""
    titles = {}
    for name, path in _preset_files().items():
        try:
            titles[name] = str(_read_preset(path).get("title", ""))
        except ParameterError as error:
            titles[name] = str(error)  # the others can be used all the same
    return titles


def _preset_files() -> dict[str, Path]:
    return {path.stem: path for path in sorted((preset_directory() / "presets").glob("*.yaml"))}


def _read_preset(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > MAX_PRESET_BYTES:
            raise ValueError(f"has more than {MAX_PRESET_BYTES} bytes")
        text = path.read_text(encoding="utf-8")
        if text.count("[") + text.count("{") > MAX_PRESET_BRACKETS:  # PyYAML takes the square of their depth
            raise ValueError(f"has more than {MAX_PRESET_BRACKETS} brackets")
        content = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, OSError, RecursionError) as error:
        raise ParameterError(f"{path}: cannot be read: {' '.join(str(error).split())}") from None
    if not isinstance(content, dict):
        raise ParameterError(f"{path}: should hold names and values")
    return content


def load_preset(name: str) -> dict[str, Any]:
    """Return the settings of a named preset, without its title.

    Raises
    ------
    ParameterError
        Where there is no such preset or its file is not a mapping.
    """
    files = _preset_files()
    if name not in files:  # a name from a list, never a path: it may come over the network
        raise ParameterError(f"preset {name!r}: no such preset; one of {', '.join(files)}")
    content = _read_preset(files[name])
    return {key: value for key, value in content.items() if key != "title"}
