"""The growing map of a sweep: every verdict, by cell and test."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from bow_classifier.verdict.regimes import REGIMES, is_helmholtz
from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sim.protocol.verdict_fields import PENDING, VERDICT_FIELDS


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
    tested
        (cells,) uint16, number of tests of each cell.
    transient_periods
        (cells,) float32, periods until the tests first passed (section III.B), or, where the verdicts have one,
        Guettler's transient (PHYSICS.md section 14); 0 = not yet, NaN = no test.
    """

    def __init__(self, nx: int, ny: int, tests: int, repeats: int = 0) -> None:
        self.nx, self.ny, self.tests = nx, ny, tests
        shape = (tests, (1 + repeats) * ny * nx)
        self.layers: dict[str, np.ndarray] = {name: field.array(shape) for name, field in VERDICT_FIELDS.items()}
        self.tested = np.zeros(shape[1], np.uint16)
        self.transient_periods = np.full(shape[1], np.nan, np.float32)

    def take(self, test: int, cells: np.ndarray, verdict: Mapping[str, Any]) -> None:
        """Store the verdicts of one test of some cells; the same verdicts a second time change nothing.

        Parameters
        ----------
        test
            Number of the test, from 0.
        cells
            (n,) cell indices.
        verdict
            Field -> (n,) values.
        """
        for name, layer in self.layers.items():
            layer[test, cells] = verdict[name]
        regime = self.layers["regime"][:, cells]
        self.tested[cells] = np.count_nonzero(regime != PENDING, axis=0)
        self.transient_periods[cells] = transient_lengths(regime, self.layers["transient"][:, cells])

    def latest(self, name: str) -> np.ndarray:
        """Return a layer at the latest test of every cell, (cells,)."""
        layer = self.layers[name]
        return layer[np.maximum(self.tested.astype(int), 1) - 1, np.arange(layer.shape[1])]

    def of_plane(self, values: np.ndarray) -> np.ndarray:
        """Return the values of the cells of the plane, (..., ny, nx), from those of all cells, (..., cells)."""
        return values[..., : self.ny * self.nx].reshape(*values.shape[:-1], self.ny, self.nx)

    def regime_counts(self) -> np.ndarray:
        """Return how many cells are in each of `REGIMES` at their latest test, (regimes,)."""
        return np.bincount(self.latest("regime"), minlength=PENDING + 1)[: len(REGIMES)]

    def helmholtz_fraction(self) -> float:
        """Return the share of the plane in which the tests have passed once."""
        return float(np.mean(np.nan_to_num(self.of_plane(self.transient_periods)) > 0))
