"""How long the kernel takes for a cell-step: ``python -m bench.kernel``.

A cell-step is one sample of one cell, everything included: gesture, reflections, friction, slip intervals, and the
bridge force as float32 in the order in which it is sent. One thread; the least of many chunks, since other work on
the machine only ever adds.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence

import numpy as np

from bow_sim.identity import fingerprint
from bow_sim.kernel import Block
from bow_sim.model import Parameters

LANES = 128

CASES = {
    "delta/Cremer": ({"model": "delta_cremer"}, "f_asym", LANES),
    "stiff/Cremer": ({"model": "stiff_cremer"}, "f_asym", LANES),
    "delta/Cremer, float32": ({"model": "delta_cremer", "dtype": "float32"}, "f_asym", LANES),
    "stiff/Cremer, float32": ({"model": "stiff_cremer", "dtype": "float32"}, "f_asym", LANES),
    "Raman": ({"model": "raman"}, "f_asym", LANES),
    "rounded corner": ({"model": "rounded_corner"}, "f_asym", LANES),
    "stiff/Cremer, stiffness differs": ({"model": "stiff_cremer"}, "stiffness_b", LANES),
    "stiff/Cremer, bow position differs": ({"model": "stiff_cremer"}, "bow_bridge", LANES),
    "stiff/Cremer, one cell": ({"model": "stiff_cremer"}, "f_asym", 1),
}
"""What is measured: parameters, the one that differs between cells, and how many cells."""

TRIAL = {"delta/Cremer": 9.4, "stiff/Cremer": 16.0}
"""ns per cell-step of the trial implementation."""


def lanes_of(name: str, cells: int) -> np.ndarray:
    """Values of the parameter that differs, shape (cells,)."""
    if name == "bow_bridge":
        return np.resize(np.arange(5.0, 45.0), cells)
    first, last = {"f_asym": (0.5, 20.0), "stiffness_b": (1e-6, 3e-4)}[name]
    return np.geomspace(first, last, cells)


def measure(settings: dict[str, str], name: str, cells: int, blocks: int) -> float:
    """Least time of a chunk, ns per cell-step."""
    p = Parameters.from_mapping(settings)
    lanes = {name: lanes_of(name, cells)}
    Block(p, lanes).advance()
    best = float("inf")
    for _ in range(blocks):
        block = Block(p, lanes)
        for _ in range(p.chunks):
            started = time.perf_counter()
            block.advance()
            best = min(best, time.perf_counter() - started)
    return best / (cells * p.chunk_samples) * 1e9


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.kernel", description=__doc__)
    parser.add_argument("--blocks", type=int, default=20, help="blocks of 100 periods for each case (default: 20)")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    chosen = parser.parse_args(arguments)
    results = {}
    for case, (settings, name, cells) in CASES.items():
        results[case] = measure(settings, name, cells, chosen.blocks)
        if not chosen.json:
            trial = f"   (trial implementation {TRIAL[case]})" if case in TRIAL else ""
            print(f"{case:36s}{cells:4d} cells {results[case]:7.2f} ns{trial}", flush=True)
    if chosen.json:
        json.dump({"kernel": fingerprint(), "ns_per_cell_step": results}, sys.stdout, indent=2)
        print()


if __name__ == "__main__":
    main()
