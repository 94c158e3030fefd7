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

    Attributes
    ----------
    layers
        Name -> (tests, ny * nx), one for each of :data:`bow_sim.protocol.verdict_fields.VERDICT_FIELDS`.
    tested
        (ny * nx,) uint16, number of tests of each cell.
    transient_periods
        (ny * nx,) float32, periods until the tests first passed (section III.B), or, where the verdicts have one,
        Guettler's transient (PHYSICS.md section 14); 0 = not yet, NaN = no test.
    """

    def __init__(self, nx: int, ny: int, tests: int) -> None:
        self.nx, self.ny, self.tests = nx, ny, tests
        shape = (tests, ny * nx)
        self.layers: dict[str, np.ndarray] = {name: field.array(shape) for name, field in VERDICT_FIELDS.items()}
        self.tested = np.zeros(ny * nx, np.uint16)
        self.transient_periods = np.full(ny * nx, np.nan, np.float32)

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
        """Return a layer at the latest test of every cell, (ny * nx,)."""
        layer = self.layers[name]
        return layer[np.maximum(self.tested.astype(int), 1) - 1, np.arange(layer.shape[1])]

    def regime_counts(self) -> np.ndarray:
        """Return how many cells are in each of `REGIMES` at their latest test, (regimes,)."""
        return np.bincount(self.latest("regime"), minlength=PENDING + 1)[: len(REGIMES)]

    def helmholtz_fraction(self) -> float:
        """Return the share of all cells in which the tests have passed once."""
        return float(np.mean(np.nan_to_num(self.transient_periods) > 0))
