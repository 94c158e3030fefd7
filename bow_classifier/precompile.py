"""Compile the classifier and cache the code: ``python -m bow_classifier.precompile``."""

from __future__ import annotations

import time

import numpy as np

from bow_classifier.block_classifier import BlockClassifier, Geometry
from bow_classifier.features.slips import Intervals
from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.physics.parameters import CHUNK_PERIODS


def precompile() -> None:
    """Compile the classifier (some 12 s), or load it from the cache (0.3 s), so that the first chunk need not wait."""
    geometry = Geometry(period=139, bow_bridge=15, samples=CHUNK_PERIODS * 139)
    none = np.zeros(0, np.uint32)
    sticking = Intervals(np.zeros(1, np.uint8), np.zeros(2, np.uint32), none, none, np.zeros(0))
    BlockClassifier(geometry, Thresholds(), 1).classify(np.zeros((1, geometry.samples), np.float32), sticking)


def main() -> None:
    """Compile, and print how long it took."""
    started = time.perf_counter()
    precompile()
    print(f"  classifier: {time.perf_counter() - started:.2f} s")


if __name__ == "__main__":
    main()
