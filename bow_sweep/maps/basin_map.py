"""The growing map: every verdict of a sweep, kept per cell and test."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from bow_classifier.verdict.regimes import REGIMES, is_helmholtz
from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sim.protocol.verdict_fields import PENDING, VERDICT_FIELDS


class Basin:
    """Verdicts over the plane of a sweep.

    Parameters
    ----------
    nx, ny, tests
        Cells along x and y, and tests of each cell.

    Attributes
    ----------
    layers
        Name -> (tests, ny * nx), the fields of :data:`bow_sim.protocol.verdict_fields.VERDICT_FIELDS`.
    """

    def __init__(self, nx: int, ny: int, tests: int) -> None:
        self.nx, self.ny, self.tests = nx, ny, tests
        shape = (tests, ny * nx)
        self.layers: dict[str, np.ndarray] = {name: field.array(shape) for name, field in VERDICT_FIELDS.items()}
        self.tested = np.zeros(ny * nx, np.uint16)
        self.transient_periods = np.full(ny * nx, np.nan, np.float32)

    def take(self, test: int, cells: np.ndarray, verdict: Mapping[str, Any]) -> None:
        """Take in one test (0-based) of some cells; the same verdict twice changes nothing.

        `transient_periods` becomes the periods until the tests first passed, 0 while they never have (section III.B).
        """
        for name, layer in self.layers.items():
            layer[test, cells] = verdict[name]
        regime = self.layers["regime"][:, cells]
        self.tested[cells] = np.count_nonzero(regime != PENDING, axis=0)
        passed = is_helmholtz(regime)
        self.transient_periods[cells] = np.where(passed.any(axis=0), (passed.argmax(axis=0) + 1) * CHUNK_PERIODS, 0)

    def latest(self, name: str) -> np.ndarray:
        """Return a layer at the latest test of every cell, shape (ny * nx,)."""
        layer = self.layers[name]
        return layer[np.maximum(self.tested.astype(int), 1) - 1, np.arange(layer.shape[1])]

    def regime_counts(self) -> np.ndarray:
        """Return how many cells are in each of `REGIMES` at their latest test."""
        return np.bincount(self.latest("regime"), minlength=PENDING + 1)[: len(REGIMES)]

    def helmholtz_fraction(self) -> float:
        """Return the fraction of all cells whose tests ever passed."""
        return float(np.mean(np.nan_to_num(self.transient_periods) > 0))
