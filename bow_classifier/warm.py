"""Compile and cache the three tests: ``python -m bow_classifier.warm``."""

from __future__ import annotations

import time

import numpy as np

from bow_sim.model import CHUNK_PERIODS

from .judge import BlockJudge, Geometry
from .slips import Intervals
from .thresholds import Thresholds


def warm() -> None:
    """Compile the tests (some 10 s), or load them from the cache (0.3 s), so that the first chunk need not wait."""
    geometry = Geometry(period=139, bow_bridge=15, samples=CHUNK_PERIODS * 139)
    none = np.zeros(0, np.uint32)
    sticking = Intervals(np.zeros(1, np.uint8), np.zeros(2, np.uint32), none, none, np.zeros(0))
    BlockJudge(geometry, Thresholds(), 1).judge(np.zeros((1, geometry.samples), np.float32), sticking)


def main() -> None:
    """Compile and say how long it took."""
    started = time.perf_counter()
    warm()
    print(f"  classifier: {time.perf_counter() - started:.2f} s")


if __name__ == "__main__":
    main()
