"""The cells of a run: chosen by the values of their parameters, read from the bag or computed again."""

from __future__ import annotations

import json
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bow_sim.physics.errors import ParameterError
from bow_sim.physics.kinds import number_of
from bow_sim.physics.parameters import FIELDS
from bow_sim.protocol.verdict_fields import PENDING, VERDICT_FIELDS
from bow_sweep.cell.cell_record import CellRecord, CellTests
from bow_sweep.cell.parameters import parameters_of, place
from bow_sweep.cell.waveform import CellError, Waveform
from bow_sweep.maps.map_file import MAP, MapFile, MapFileError, read_map_npz
from bow_sweep.plan.sweep import Sweep

if TYPE_CHECKING:
    from bow_sweep.cell.from_bag import BagCells

Progress = Callable[[float, float], None]

SOURCES = ("auto", "bag", "computed")
"""Where a waveform may come from; "auto" is the bag, and where that does not have the cell, the kernel."""

KEPT = 64
"""Records kept in memory: 56 kB each for a run of 100 periods."""

BAG = "bag"
"""Name of the bag's folder in a run directory."""


class RunCells:
    """The cells of a run. Bag and map stay open, and what was read of them is kept: a second cell takes milliseconds.

    Parameters
    ----------
    run_directory
        Of the run: with ``map.npz``, ``bag/`` or both. Without a bag all cells are computed again; without a map the
        recorded verdicts make one.
    progress
        Called with (done, total) while the index of the bag is read; that takes long only for a bag that was not
        closed, of which everything is read.

    Raises
    ------
    CellError
        Where there is neither, or one of them cannot be read, or they are of different runs.
    """

    def __init__(self, run_directory: str | Path, progress: Progress | None = None) -> None:
        self.directory = Path(run_directory)
        self.bag = _open_bag(self.directory, progress)
        self.map = self._map()
        self._kept: OrderedDict[tuple[int, str], CellRecord] = OrderedDict()
        self._sweep: Sweep | None = None
        self._blocks_checked: dict[int, list[int]] = {}

    def close(self) -> None:
        """Close the bag."""
        if self.bag is not None:
            self.bag.close()

    def __enter__(self) -> RunCells:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # ---- map and plane

    def _map(self) -> MapFile:
        path = self.directory / MAP
        if not path.exists():
            if self.bag is None:
                what = "is no directory" if not self.directory.is_dir() else f"has neither {MAP} nor {BAG}/"
                raise CellError(f"{self.directory}: {what}; should be the directory of a run of `bow sweep`")
            outline = self.bag.outline
            sweep = replace(_sweep(outline.settings, self.directory), preset=outline.preset)
            return MapFile.of(sweep, self.bag.basin(), outline.run_id)
        try:
            found = read_map_npz(path)
        except MapFileError as error:
            raise CellError(str(error)) from None
        if self.bag is not None and found.run_id != self.bag.outline.run_id:
            runs = f"{MAP} is of run {found.run_id}, {BAG}/ of run {self.bag.outline.run_id}"
            raise CellError(f"{self.directory}: {runs}; one of them was copied here")
        return found

    @property
    def sweep(self) -> Sweep:
        """The sweep with all its settings.

        Raises
        ------
        CellError
            Where the settings of the map are not kept, or cannot be simulated by this version of bow.
        """
        if self._sweep is None:
            if not self.map.settings:
                raise CellError(f"{self.directory / MAP}: holds no settings, so its cells cannot be computed again")
            self._sweep = _sweep(self.map.settings, self.directory)
        return self._sweep

    @property
    def cells(self) -> int:
        """Number of cells of the map."""
        ny, nx = self.map.shape
        return nx * ny

    @property
    def repeats(self) -> int:
        """How often each cell was repeated; repeat R of a cell has the number R * cells + cell."""
        return int(self.map.values.get("repeats", 0))

    def nearest(self, values: Mapping[str, float]) -> int:
        """Return the cell whose parameters are nearest to some values, in steps of the axes.

        Parameters
        ----------
        values
            Name of each axis of the map -> value. An axis with one value may be left out.

        Raises
        ------
        CellError
            For a name that is no axis, a missing axis, or a value beyond the map; says what would be right.
        """
        axes = self.map.axes
        names = [axis.name for axis in axes]
        if unknown := [name for name in values if name not in names]:
            raise CellError(f"{unknown[0]}: {self._why_no_axis(unknown[0])}; the axes of this map are {_and(names)}")
        index = []
        for axis in axes:
            if axis.name not in values:
                if axis.count > 1:
                    raise CellError(f"{axis.name}: is not given; a cell needs {_and(names)}")
                index.append(0)
                continue
            try:
                value = number_of(axis.name, values[axis.name])
            except ParameterError as error:
                raise CellError(str(error)) from None
            index.append(place(axis.name, value, axis.values, axis.scale))
        return index[1] * axes[0].count + index[0]

    def _why_no_axis(self, name: str) -> str:
        if name in self.map.values and name in FIELDS:
            return f"is {self.map.values[name]} in all cells of this run"
        return "is the same in all cells of this run" if name in FIELDS else "is not a parameter"

    # ---- records

    def record(self, cell: int, source: str = "auto") -> CellRecord:
        """Return what is known of a cell, with its whole waveform.

        What `checked` says depends on where the samples come from:

        - From the bag: the checksum of every message that the samples come from was computed again and holds. A cell
          that is damaged in the bag is refused, or with "auto" computed.
        - Computed, and the bag has the cell: every bit of the bridge force and every slip was compared with the
          recorded ones, whose checksums hold.
        - Computed, and the bag has only the checksums of its chunks (verdicts state them; streams are damaged or
          gone): a checksum covers all cells of a block, so the whole block was computed again, and its checksums
          compared.
        - Computed, and there is nothing to compare with: None. `why` says whether the kernel is the run's.

        A waveform of another kernel than the run's is called equal only where it was compared, and `why` names both.

        Parameters
        ----------
        cell
            Index in the map, iy * nx + ix, or the number of a repeat, see :attr:`repeats`.
        source
            One of `SOURCES`.

        Raises
        ------
        CellError
            For a cell that the map does not have; with "bag", one that is not whole and undamaged in the bag; with
            "auto", one that the run has given up.
        """
        if source not in SOURCES:
            raise CellError(f"source {source!r}: should be one of {', '.join(SOURCES)}")
        if not 0 <= cell < self.cells * (1 + self.repeats):
            repeated = f", and {self.repeats} repeats of each" if self.repeats else ""
            raise CellError(f"cell {cell}: there is none; this map has cells 0 ... {self.cells - 1}{repeated}")
        key = (int(cell), source)
        if key not in self._kept:
            self._kept[key] = self._record(int(cell), source)
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        self._kept.move_to_end(key)
        return self._kept[key]

    def _record(self, cell: int, source: str) -> CellRecord:
        reason = ""
        if source != "computed":
            try:
                return self._complete(cell, self._from_bag(cell), "bag", True, self._checksums_hold())
            except CellError as error:
                if source == "bag":
                    raise
                if self.bag is not None and self.bag.given_up(cell):
                    what = "its block was given up, because simulators died of it"
                    raise CellError(f"cell {cell}: {what}; ask for it computed to try it here") from None
                reason = f"{error}; computed again: "
        wave, checked, why = self._computed(cell)
        return self._complete(cell, wave, "computed", checked, reason + why)

    def _from_bag(self, cell: int) -> Waveform:
        if self.bag is None:
            raise CellError(f"{self.directory}: has no {BAG}/")
        return self.bag.waveform(cell)

    def _checksums_hold(self) -> str:
        assert self.bag is not None
        return f"read from the bag; the checksums of its {2 * self.bag.outline.chunks} messages hold"

    def _computed(self, cell: int) -> tuple[Waveform, bool | None, str]:
        """Return a cell computed again, whether it is the recorded one, and why."""
        from bow_sweep.cell.computed import chunk_checksums, compute

        wave = compute(self.sweep, cell)
        kernel = self._kernel()
        if self.bag is None:
            return wave, None, f"there is no bag to hold it against; {kernel}"
        block = self.bag.block_of(cell)
        if block is None:
            return wave, None, f"it is predicted in the map; {kernel}"
        try:
            recorded = self.bag.waveform(cell)
        except CellError:
            states = [self.bag.checksum(block, chunk) for chunk in range(self.bag.outline.chunks)]
            known = [chunk for chunk, checksum in enumerate(states) if checksum is not None]
            if not known:
                return wave, None, f"the bag has nothing of it to hold it against; {kernel}"
            if block not in self._blocks_checked:
                self._blocks_checked[block] = chunk_checksums(self.sweep, block, self.bag.outline.block(block))
            made = self._blocks_checked[block]
            wrong = [chunk for chunk in known if made[chunk] != states[chunk]]
            if wrong:
                return wave, False, f"the recorded checksum of chunk {wrong[0]} of block {block} differs; {kernel}"
            if len(known) < len(states):
                return wave, None, f"the checksums of {len(known)} of {len(states)} chunks hold; {kernel}"
            return wave, True, f"the recorded checksums of all {len(states)} chunks of block {block} hold; {kernel}"
        first = wave.differs_from(recorded)
        if first is not None:
            return wave, False, f"differs from the bag from sample {first} on; {kernel}"
        return wave, True, f"equal to the bag in every bit; {kernel}"

    def _kernel(self) -> str:
        """Return in words whether the kernel here is the one that computed the run."""
        from bow_sim.kernel.fingerprint import difference

        there, here = self._fingerprint(), self.sweep.fingerprint
        if there == here:
            return "the kernel is the run's"
        if there:
            return f"the run's kernel is another one, by {difference(there, here)}: {there}, here is {here}"
        if self.map.sweep_id == self.sweep.sweep_id:
            return "the kernel has the sources of the run's, whose compilers and processor are not known"
        return "the kernel has other sources than the run's"

    def _fingerprint(self) -> str:
        """Return the fingerprint of the kernel that computed the run; "" where no file states it."""
        if self.bag is not None:
            return self.bag.fingerprint
        for name in ("report.json", "ledger.jsonl"):
            try:
                with open(self.directory / name, encoding="utf-8") as file:
                    entry = json.load(file) if name.endswith(".json") else json.loads(file.readline())
                if entry["run_id"] == self.map.run_id:
                    return str(entry["fingerprint"])
            except (OSError, ValueError, KeyError, TypeError):
                continue
        return ""

    def _complete(self, cell: int, wave: Waveform, source: str, checked: bool | None, why: str) -> CellRecord:
        repeat, place = divmod(cell, self.cells)
        iy, ix = divmod(place, self.map.shape[1])
        tests, transient = self._tests(iy, ix), float(self.map.transient_periods[iy, ix])
        if repeat:
            tests = self._tests_of_repeat(cell, tests)
            transient = tests.transient_periods
        if source == "computed" and (tests.regime == PENDING).all():
            from bow_sweep.cell.computed import judged

            tests, transient = judged(self.sweep, cell)
            why += "; the run has no verdicts on it, those shown are made here"
        return CellRecord(
            bridge_force=wave.bridge_force,
            slipping_first=wave.slipping_first,
            onsets=wave.onsets,
            durations=wave.durations,
            slips=wave.slips,
            run_id=self.map.run_id,
            cell=cell,
            repeat=repeat,
            x_name=self.map.x_name,
            y_name=self.map.y_name,
            x=float(self.map.x[ix]),
            y=float(self.map.y[iy]),
            parameters=parameters_of(self.sweep, cell),
            tests=tests,
            transient_periods=transient,
            source=source,
            checked=checked,
            why=why,
        )

    def _tests_of_repeat(self, cell: int, of_cell: CellTests) -> CellTests:
        """Return the recorded tests of a repeat, which the map does not have; all pending without a bag."""
        if self.bag is not None:
            return CellTests.of(self.bag.verdicts(cell))
        tests = (len(of_cell.periods),)
        return CellTests.of({name: field.array(tests) for name, field in VERDICT_FIELDS.items()})

    def _tests(self, iy: int, ix: int) -> CellTests:
        found = self.map
        tests = len(found.test_periods)
        regime = np.full(tests, PENDING, np.uint8)
        confidence = np.full(tests, np.nan, np.float32)
        rare = {
            name: np.full(tests, np.nan, np.float32) if layer is None else layer[:, iy, ix].copy()
            for name, layer in (("beat", found.beat), ("transient", found.transient))
        }
        if found.regimes is not None and found.confidence is not None:
            regime, confidence = found.regimes[:, iy, ix].copy(), found.confidence[:, iy, ix].copy()
        elif tests:
            regime[-1] = found.regime[iy, ix]
        layers = {
            name: getattr(found, name)[:, iy, ix].copy() for name in ("correlation", "period", "slips", "corners")
        }
        return CellTests(
            periods=np.asarray(found.test_periods),
            regime=regime,
            confidence=confidence,
            helmholtz=found.helmholtz[:, iy, ix].copy(),
            **rare,
            regime_names=found.regime_names,
            **layers,
        )


def _open_bag(directory: Path, progress: Progress | None) -> BagCells | None:
    """Return the bag of a run; None where there is none."""
    from bow_sweep.cell.from_bag import BagCells, has_bag

    for folder in (directory / BAG, directory):
        if has_bag(folder):
            return BagCells(folder, progress)
    return None


def _sweep(settings: tuple[str, ...], directory: Path) -> Sweep:
    try:
        return Sweep.from_spec("", settings)
    except ParameterError as error:
        raise CellError(f"{directory}: its settings cannot be simulated by this version of bow: {error}") from None


def _and(names: list[str]) -> str:
    return " and ".join(names)
