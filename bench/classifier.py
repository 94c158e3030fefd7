"""How long the classifier takes for a cell-sample: ``python -m bench.classifier``.

A cell-sample is one sample of the bridge force of one cell, everything included: the three tests, long periods, ripples
and the verdict; in a run of 150 periods or more also what a wolf is known by. The chunks are those of a block of figure
11(d), computed before. One core; of every chunk the least CPU time of all repeats.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bench.kernel import pinned
from bow_classifier.features.slips import Intervals
from bow_classifier.task import classifier_of
from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.kernel.block import Block
from bow_sim.physics.parameters import Parameters

CELLS = 512
REPEATS = 20
CASES = {"stiff/Cremer, 100 periods": 100, "stiff/Cremer, 200 periods, wolves looked for": 200}
FIRST = {
    "stiff/Cremer, 100 periods": "0.53 of the time of d42a378 with AVX-512, 0.61 with AVX2, in turns on a busy machine",
    "stiff/Cremer, 200 periods, wolves looked for": "d42a378 did not look for wolves",
}
"""What stands beside a figure: how it compares with the first version that was measured."""

Chunks = list[tuple[NDArray[np.float32], Intervals]]


def plane(cells: int) -> dict[str, NDArray[np.float64]]:
    """Return the cells of a block, all over the plane of figure 11(d)."""
    force, ratio = np.meshgrid(np.geomspace(0.5, 20, cells // 16), np.linspace(0, 2, 16))
    return {"f_asym": force.ravel(), "f_init_ratio": ratio.ravel()}


def chunks_of(p: Parameters, lanes: dict[str, NDArray[np.float64]]) -> Chunks:
    """Simulate a block; return its chunks as the classifier takes them."""
    block, chunks = Block(p, lanes), []
    for _ in range(p.chunks):
        chunk = block.advance()
        intervals = Intervals(chunk.slipping, chunk.offsets, chunk.onset, chunk.duration, chunk.slip)
        chunks.append((chunk.bridge_force.copy(), intervals.prepared()))
    return chunks


def measure(periods: int, repeats: int = REPEATS, cells: int = CELLS) -> dict[str, float]:
    """Return ns a cell-sample, over a whole run and in its first chunk."""
    p = Parameters(model="stiff_cremer", periods=periods)
    lanes = plane(cells)
    chunks = chunks_of(p, lanes)
    each = {name: np.full(cells, float(getattr(p, name))) for name in ("v_b", "bow_bridge", "acceleration")}
    best = np.full(p.chunks, np.inf)
    for _ in range(repeats):
        classifier = classifier_of(p, Thresholds(), each)
        for number, chunk in enumerate(chunks):
            began = time.thread_time()
            classifier.classify(*chunk)
            best[number] = min(best[number], time.thread_time() - began)
    samples = cells * p.chunk_samples
    return {"ns": float(best.mean()) / samples * 1e9, "first_chunk_ns": float(best[0]) / samples * 1e9}


def measure_all(repeats: int = REPEATS) -> dict[str, dict[str, float]]:
    """Measure all cases on one core; say on stderr how far it is."""
    results = {}
    with pinned():
        for name, periods in CASES.items():
            results[name] = measure(periods, repeats)
            print(f"classifier: {name}: {results[name]['ns']:.2f} ns", file=sys.stderr, flush=True)
    return results


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.classifier", description=__doc__)
    parser.add_argument("--repeats", type=int, default=REPEATS, help="runs of the same chunks")
    print(json.dumps(measure_all(parser.parse_args(arguments).repeats), indent=2))


if __name__ == "__main__":
    main()
