"""Checks map.npz, report.json and ledger.jsonl of a run directory against the plan and the verdicts in its bag."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bow_classifier.verdict.regimes import REGIMES, is_helmholtz
from bow_sim.atomic_files import read_arrays
from bow_sim.physics.applicability import notes_of_map
from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sim.protocol.states import BlockState
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sim.protocol.verdict_fields import PENDING
from bow_sweep.maps.held_fixed import common_in_si
from bow_sweep.maps.map_file import DERIVED, HISTORY, MAP, TESTS, MapFile, map_arrays, of_all_tests
from bow_sweep.maps.playability import playability
from bow_sweep.maps.reliability import Reliability
from bow_sweep.plan.adaptive import fill
from bow_sweep.run.directory import LEDGER, REPORT, findings

if TYPE_CHECKING:
    from bow_sweep.record.bag_contents import Survey

MOST_SHOWN = 200
"""Longest text of a value in a problem, characters."""

ALIKE = 1e-9
"""Relative difference up to which two measures are equal: versions of a library may add in different order."""

_TESTED = {*TESTS, *HISTORY, *DERIVED}
"""Arrays of the map that may have values for cells that are not done; these values are not checked."""

LIMIT = "limit_"
"""How the names of arrays of limits begin."""

_EVENTS = {"done": BlockState.DONE, "quarantined": BlockState.QUARANTINED, "reopened": 0}
_STATES = {0: "outstanding", BlockState.DONE: "done", BlockState.QUARANTINED: "quarantined"}


def transient_lengths(passed: np.ndarray, stated: np.ndarray) -> np.ndarray:
    """Return the transient lengths of cells that are done, (cells,) float32 periods, 0 = never.

    Parameters
    ----------
    passed
        (tests, cells) bool: whether the tests found Helmholtz motion.
    stated
        (tests, cells) float32: what the verdicts give as transient; NaN unless the gesture is Guettler's.
    """
    by_tests = np.where(passed.any(axis=0), (passed.argmax(axis=0) + 1) * CHUNK_PERIODS, 0).astype(np.float32)
    return np.where(np.isnan(stated[-1]), by_tests, stated[-1])


@dataclass(frozen=True)
class FileChecks:
    """Checks the files of a run directory against its bag; differences become problems of the survey.

    Attributes
    ----------
    directory
        Of the run. A missing file is no problem: the bag is the record.
    states
        States of the blocks in the last plan of the bag.
    done
        (cells,) bool: whether the block of a cell is done and all its chunks are in the bag; repeats come last.
    unseen
        (cells,) bool: whether the block of a cell is in a bag that is not here. Nothing that depends on it is compared.
    counts
        Numbers that :func:`bow_sweep.record.verify.verify` counted in the bag.
    """

    directory: Path
    survey: Survey
    expected: SweepOutline
    states: list[int]
    done: np.ndarray
    unseen: np.ndarray
    counts: Mapping[str, Any]

    def check(self) -> None:
        """Check every file."""
        ledger, arrays = self.directory / LEDGER, self.directory / MAP
        if ledger.is_file():
            self._ledger(ledger)
        if arrays.is_file():
            self._arrays(arrays, self._result)
        self.check_report()

    def check_report(self) -> None:
        """Check the report alone, which is written last."""
        report = self.directory / REPORT
        if report.is_file():
            self._report(report, self._result)

    def _problem(self, path: Path, what: str, block: int | None = None) -> None:
        self.survey.problem(what, file=path.name, **({} if block is None else {"block": block}))

    def _plan(self, *names: str) -> dict[str, Any]:
        """Return fields of the plan, by the names that ledger and report have for them."""
        spec = {name: self.survey.plan[f"spec.{name}"] for name in ("preset", "settings")}
        everything = {**self.survey.plan, **spec}
        return {name: everything[name] for name in ("run_id", "sweep_id", "preset", "settings", "fingerprint", *names)}

    # ---- the map

    @cached_property
    def _result(self) -> MapFile:
        """The map of the verdicts in the bag; cells that are not done have no transient length.

        It does not use :class:`~bow_sweep.maps.basin_map.Basin` as the coordinator does, so that it finds errors there.
        """
        expected, layers = self.expected, self.survey.layers()
        plan = self._plan()
        done, here = self.done, slice(expected.plane_cells)
        passed = is_helmholtz(layers["regime"])
        lengths, latest = transient_lengths(passed, layers["transient"]), layers["regime"][-1]
        length = np.where(done, lengths, np.float32(np.nan))[here].reshape(expected.shape)
        if expected.planned.adaptive:
            length = np.where(expected.planned.planned.reshape(expected.shape), length, fill(length))
        cube = (expected.chunks, *expected.shape)
        layers |= {"helmholtz": passed, "regimes": layers["regime"]}
        tests: dict[str, Any] = {name: layers[name][:, here].reshape(cube) for name in (*TESTS, *HISTORY)}
        return MapFile(
            **{name: plan[name] for name in ("run_id", "sweep_id", "preset")},
            settings=tuple(plan["settings"]),
            x_name=expected.x.name,
            y_name=expected.y.name,
            x=expected.x.values(),
            y=expected.y.values(),
            regime_names=tuple(REGIMES),
            test_periods=np.arange(1, expected.chunks + 1) * CHUNK_PERIODS,
            transient_periods=length,
            regime=np.where(done, latest, np.uint8(PENDING))[here].reshape(expected.shape),
            simulated=done.reshape(expected.shape) if expected.planned.adaptive else None,
            reliability=Reliability.of(expected.shape, latest, lengths, done),
            **of_all_tests(tests),
        )

    def _arrays(self, path: Path, result: MapFile) -> None:
        """Check every array of map.npz; those of `_TESTED` only where the cells are done."""
        try:
            given = read_arrays(path)
        except (OSError, ValueError) as error:
            self._problem(path, f"cannot be read: {error}")
            return
        old = not any(name.startswith(LIMIT) for name in given)
        arrays = map_arrays(result)
        known = np.size(given.get("regime_names", ()))
        arrays["regime_names"] = arrays["regime_names"][:known]  # an older run knows the first of them only
        for name, right in arrays.items():
            if name not in given:
                if name not in HISTORY and not (old and name.startswith(LIMIT)):  # older maps do not have them
                    self._problem(path, f"holds no {name}")
                continue
            found = given[name]
            if (found.dtype, found.shape) != (right.dtype, right.shape):
                what = f"{name} is {found.dtype} {found.shape}, should be {right.dtype} {right.shape}"
                self._problem(path, what)
                continue
            # a limit is a sum of powers, which another version of NumPy may round otherwise
            differs = ~np.isclose(right, found, rtol=ALIKE, atol=0) if name.startswith(LIMIT) else right != found
            if right.dtype.kind == "f":
                differs &= ~(np.isnan(right) & np.isnan(found))
            if right.ndim < 2:
                if differs.any():
                    self._problem(path, f"{name} differs from the plan")
                continue
            differs = differs.reshape(-1, self.expected.plane_cells)
            differs[:, self._unknown()] = False
            if name in _TESTED:
                differs[:, ~self.done[: self.expected.plane_cells]] = False
            if differs.any():
                cell = int(np.flatnonzero(differs.any(axis=0))[0])
                what = f"{name} differs from the verdicts in {int(differs.sum())} places, first at cell {cell}"
                blocks = (n for n in range(self.expected.blocks) if cell in self.expected.block(n))
                self._problem(path, what, next(blocks, None))

    def _unknown(self) -> np.ndarray:
        """Return of which cells of the plane something is not here, (cells of the plane,) bool: themselves, a repeat.

        Predicted cells follow from all others.
        """
        unknown: np.ndarray = np.any(self.unseen.reshape(-1, self.expected.plane_cells), axis=0)
        planned = self.expected.planned
        if planned.adaptive and unknown.any():
            unknown |= ~planned.planned
        return unknown

    # ---- the report

    def _report(self, path: Path, result: MapFile) -> None:
        """Check what report.json has of plan, cells and map; times and machine are not in the bag."""
        try:
            given = dict(json.loads(path.read_bytes()))
        except (ValueError, TypeError, RecursionError) as error:
            self._problem(path, f"cannot be read: {error}")
            return
        planned, counts = self.expected.planned, self.counts
        shared = common_in_si(vars(self.expected.parameters), (self.expected.x.name, self.expected.y.name))
        names = {"planned": "cells_planned", "done": "cells", "quarantined": "cells_quarantined"}
        cells = {name: counts[counted] for name, counted in names.items()}
        cells["done"] += counts["cells_unseen"]
        cells["outstanding"] = cells["planned"] - cells["done"] - cells["quarantined"]
        unseen = counts["cells_unseen"] * self.expected.chunks * self.expected.chunk_samples
        right = {
            **self._plan("classifier"),
            **({"si": shared} if shared else {}),
            "cells": cells,
            "cells_predicted": counts["cells_predicted"],
            "samples": counts["samples"] + unseen,
            "rounds": len(planned.rounds),
            **({} if unseen else self._findings(result)),
            "quarantined_blocks": sorted(map(str, counts["quarantined_blocks"])),
        }
        if "notes" in given:  # older runs have none
            right["notes"] = list(notes_of_map(self.expected.parameters, self.expected.x, self.expected.y))
        if isinstance(given.get("quarantined_blocks"), dict):  # with reasons, which are not in the bag
            given["quarantined_blocks"] = sorted(given["quarantined_blocks"])
        if isinstance(given.get("regimes"), dict) and "regimes" in right:  # an older run knows the first of them only
            right["regimes"] = {n: count for n, count in right["regimes"].items() if count or n in given["regimes"]}
        for name, value in json.loads(json.dumps(right)).items():
            if name not in given:
                self._problem(path, f"holds no {name}")
            elif not _equal(given[name], value):
                self._problem(path, f"{name} is {_short(given[name])}, in the bag it is {_short(value)}")

    def _findings(self, result: MapFile) -> dict[str, Any]:
        """Return what the report has of the map."""
        adaptive = self.expected.planned.adaptive
        return {
            **findings(
                result.transient_periods,
                result.regime.ravel()[self.done[: self.expected.plane_cells]],
                self.expected.parameters.gesture,
                self.expected.repeats,
                result.reliability,
            ),
            "playability": playability(result.transient_periods, None if adaptive else result.regime),
        }

    # ---- the ledger

    def _ledger(self, path: Path) -> None:
        """Check that ledger.jsonl begins with the plan in the bag and has the same blocks done and quarantined."""
        states: dict[int, int] = {}
        for number, line in enumerate(path.read_bytes().split(b"\n")[:-1], 1):  # the last may be incomplete
            try:
                entry = json.loads(line)
                event, block = str(entry.get("event")), entry.get("block")
            except (ValueError, AttributeError, RecursionError):
                self._problem(path, f"line {number} is no entry")
                continue
            if (event == "planned") != (number == 1):
                self._problem(path, "does not begin with the plan, or has another one later")
            if event == "planned":
                for name, value in self._plan().items():
                    if entry.get(name) != value:
                        self._problem(path, f"{name} is {_short(entry.get(name))}, in the bag it is {_short(value)}")
            if isinstance(block, int):
                states[block] = _EVENTS.get(event, states.get(block, 0))
        for block in range(self.expected.blocks):
            if states.get(block, 0) != self.states[block]:
                state, planned = _STATES[states.get(block, 0)], _STATES.get(self.states[block], "unknown")
                self._problem(path, f"is {state} in the ledger, {planned} in the plan of the bag", block)


def _equal(one: Any, other: Any) -> bool:
    """Return whether two values from JSON are equal, numbers up to `ALIKE`."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(_equal(one[name], other[name]) for name in one)
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=ALIKE)
    return type(one) is type(other) and bool(one == other)


def _short(value: Any) -> str:
    """Return a value as text, shortened to `MOST_SHOWN`."""
    text = json.dumps(value)
    return text if len(text) <= MOST_SHOWN else text[:MOST_SHOWN] + "..."
