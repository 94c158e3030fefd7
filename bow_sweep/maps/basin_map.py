"""The growing map of a sweep: every verdict, by cell and test."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from bow_classifier.verdict.regimes import REGIMES, is_helmholtz
from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sim.protocol.verdict_fields import PENDING, VERDICT_FIELDS

SPARSE = 8
"""Cells that are looked at for each cell with a new verdict, at most: to look at one out of order costs so much."""


def transient_lengths(regime: np.ndarray, transient: np.ndarray) -> np.ndarray:
    """Return the transient lengths of cells, (cells,) float32 periods; 0 = never.

    Parameters
    ----------
    regime
        (tests, cells) codes.
    transient
        (tests, cells) of the verdicts: for the gesture guettler the transient known at each test, which is longer than
        0 once there is one; the latest counts. NaN for other gestures: then the first test that passed.
    """
    passed = is_helmholtz(regime)
    by_tests = np.where(passed.any(axis=0), (passed.argmax(axis=0) + 1) * CHUNK_PERIODS, 0).astype(np.float32)
    known = ~np.isnan(transient)
    if not known.any():
        return by_tests
    latest = len(known) - 1 - known[::-1].argmax(axis=0)
    return np.where(known.any(axis=0), transient[latest, np.arange(transient.shape[1])], by_tests)


def place(cells: np.ndarray) -> np.ndarray | slice:
    """Return the index of some cells: a slice where each follows the one before, as in most blocks."""
    at = np.asarray(cells, np.intp)
    if len(at) and at[-1] - at[0] == len(at) - 1 and (at[1:] > at[:-1]).all():
        return slice(int(at[0]), int(at[-1]) + 1)
    return at


def _together(places: list[np.ndarray | slice]) -> np.ndarray | slice:
    """Return an index of all cells of some places: a slice where it has few others, which NumPy handles faster."""
    ends = [(at.start, at.stop - 1) if isinstance(at, slice) else (at.min(), at.max()) for at in places]
    first, last = min(lowest for lowest, _ in ends), max(highest for _, highest in ends)
    count = sum(at.stop - at.start if isinstance(at, slice) else len(at) for at in places)
    if last - first < SPARSE * count:
        return slice(int(first), int(last) + 1)
    return np.unique(np.concatenate([np.arange(at.start, at.stop) if isinstance(at, slice) else at for at in places]))


class Basin:
    """The verdicts over the plane of a sweep.

    Parameters
    ----------
    nx, ny, tests
        Number of cells along x and y, and of tests of each cell.
    repeats
        How often each cell is repeated beside itself. Arrays have cells = (1 + repeats) * ny * nx values, those of the
        plane first.

    Attributes
    ----------
    layers
        Name -> (tests, cells), one for each of :data:`bow_sim.protocol.verdict_fields.VERDICT_FIELDS`.
    """

    def __init__(self, nx: int, ny: int, tests: int, repeats: int = 0) -> None:
        self.nx, self.ny, self.tests = nx, ny, tests
        shape = (tests, (1 + repeats) * ny * nx)
        self.layers: dict[str, np.ndarray] = {name: field.array(shape) for name, field in VERDICT_FIELDS.items()}
        self._pending = bytes([PENDING]) * shape[1]
        self._tested = np.zeros(shape[1], np.uint16)
        self._transient_periods = np.full(shape[1], np.nan, np.float32)
        self._first_passed = np.full(shape[1], tests, np.int32)  # test; `tests` = none yet
        self._latest_stated = np.full(shape[1], -1, np.int32)  # the latest test whose verdict has a transient
        self._new: dict[int, list[np.ndarray | slice]] = {}  # test -> cells that have no part in the above yet

    @property
    def tested(self) -> np.ndarray:
        """Number of tests of each cell, (cells,) uint16."""
        self._derive_new()
        return self._tested

    @property
    def transient_periods(self) -> np.ndarray:
        """Periods until the tests first passed (section III.B), (cells,) float32; 0 = not yet, NaN = no test.

        Where the verdicts have one, Guettler's transient (PHYSICS.md section 14).
        """
        self._derive_new()
        return self._transient_periods

    def take(self, test: int, cells: np.ndarray | slice, verdict: Mapping[str, Any]) -> None:
        """Store the verdicts of one test of some cells; the same verdicts a second time change nothing.

        What follows from them is derived when it is read, from all new verdicts of a test together: a map is read a few
        times in a second, and verdicts come a thousand times. The time does not depend on the number of tests, unless
        one of the cells has verdicts of this test already.

        Parameters
        ----------
        test
            Number of the test, from 0.
        cells
            (n,) cell indices, or their :func:`place`.
        verdict
            Field -> (n,) values.
        """
        at = cells if isinstance(cells, slice) else place(cells)
        before = self.layers["regime"][test, at].tobytes()  # bytes are compared and searched faster than arrays
        for name, layer in self.layers.items():
            layer[test, at] = verdict[name]
        if before != self._pending[: len(before)]:  # what this test gave before may have to be taken back
            self._derive_new()
            self._derive(at)
        elif before:
            regime = self.layers["regime"][test, at]
            self._tested[at] += regime != PENDING if PENDING in regime.tobytes() else np.uint16(1)
            self._new.setdefault(test, []).append(at)

    def _derive_new(self) -> None:
        """Derive what follows from new verdicts, test by test."""
        if not self._new:
            return
        new, self._new = self._new, {}
        for test, places in new.items():
            at = _together(places)
            regime, stated = self.layers["regime"][test, at], ~np.isnan(self.layers["transient"][test, at])
            passed = np.where(is_helmholtz(regime), np.int32(test), np.int32(self.tests))
            self._first_passed[at] = np.minimum(self._first_passed[at], passed)
            if stated.any():
                self._latest_stated[at] = np.maximum(self._latest_stated[at], np.where(stated, test, -1))
        at = _together([one for places in new.values() for one in places])
        first, none = self._first_passed[at], np.where(self._tested[at] > 0, np.float32(0), np.float32(np.nan))
        self._transient_periods[at] = np.where(first < self.tests, (first + 1) * CHUNK_PERIODS, none)
        latest = self._latest_stated[at]
        if latest.max(initial=-1) >= 0:
            known = np.arange(self._tested.size)[at][latest >= 0]
            self._transient_periods[known] = self.layers["transient"][self._latest_stated[known], known]

    def _derive(self, at: np.ndarray | slice) -> None:
        """Derive what is kept of some cells from all of their tests, which takes as long as there are tests."""
        regime, transient = self.layers["regime"][:, at], self.layers["transient"][:, at]
        passed, stated = is_helmholtz(regime), ~np.isnan(transient)
        self._tested[at] = np.count_nonzero(regime != PENDING, axis=0)
        self._first_passed[at] = np.where(passed.any(axis=0), passed.argmax(axis=0), self.tests)
        latest = len(stated) - 1 - stated[::-1].argmax(axis=0)
        self._latest_stated[at] = np.where(stated.any(axis=0), latest, -1)
        self._transient_periods[at] = transient_lengths(regime, transient)

    def latest(self, name: str) -> np.ndarray:
        """Return a layer at the latest test of every cell, (cells,)."""
        return self.latest_of((name,))[name]

    def latest_of(self, names: Iterable[str]) -> dict[str, np.ndarray]:
        """Return layers at the latest test of every cell: name -> (cells,)."""
        at = (np.maximum(self.tested, 1) - np.intp(1)) * self.tested.size + np.arange(self.tested.size)
        return {name: self.layers[name].reshape(-1).take(at) for name in names}

    def of_plane(self, values: np.ndarray) -> np.ndarray:
        """Return the values of the cells of the plane, (..., ny, nx), from those of all cells, (..., cells)."""
        return values[..., : self.ny * self.nx].reshape(*values.shape[:-1], self.ny, self.nx)

    def regime_counts(self) -> np.ndarray:
        """Return how many cells are in each of `REGIMES` at their latest test, (regimes,)."""
        return np.bincount(self.latest("regime"), minlength=PENDING + 1)[: len(REGIMES)]

    def helmholtz_fraction(self) -> float:
        """Return the share of the plane in which the tests have passed once."""
        return float(np.mean(np.nan_to_num(self.of_plane(self.transient_periods)) > 0))
