"""How long the kernel takes for a cell-step, and a plain scalar loop for the same: ``python -m bench.kernel``.

A cell-step is one sample of one cell, everything included: gesture, reflections, friction, slip intervals, and the
bridge force as float32 in the order in which it is sent. One core; of every chunk (of the plain loop: every cell) the
least time of all repeats, since other work on the machine only ever adds. The two take turns, and before they are timed
their results are compared to the last bit.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
import time
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.scalar import PlainLoop, check
from bow_sim.kernel.block import Block
from bow_sim.kernel.sources import program
from bow_sim.physics.body import STOPPANI
from bow_sim.physics.parameters import DTYPES, Parameters

LANES = 128
REPEATS = 20


class Case(NamedTuple):
    """What is measured: parameters, the one that differs between cells, how many cells, and whether beside a peer."""

    settings: dict[str, str]
    differs: str = "f_asym"
    cells: int = LANES
    plain: bool = True


STIFF = {"model": "stiff_cremer"}
SI = {"model": "delta_cremer", "string": "violin_g", "v_unit": "0.1"}
TWENTY_MODES = ", ".join(STOPPANI.split(", ")[:20])
TWENTY_POINTS = ", ".join(f"{i * i / 400!r}/{0.3 + 0.5 / (1 + i * i / 40)!r}" for i in range(20))

PLAIN = "delta/Cremer, float64"
"""What the cases of a violin are compared with: the same string without any of it."""

CASES = {
    f"{title}, {dtype}": Case({"model": model, "dtype": dtype})
    for title, model in (("delta/Cremer", "delta_cremer"), ("stiff/Cremer", "stiff_cremer"), ("Raman", "raman"))
    for dtype in DTYPES
} | {
    "rounded corner": Case({"model": "rounded_corner"}),
    "stiff/Cremer, stiffness differs": Case(STIFF, "stiffness_b", plain=False),
    "stiff/Cremer, bow position differs": Case(STIFF, "bow_bridge", plain=False),
    "stiff/Cremer, one cell": Case(STIFF, cells=1),
    "delta/Cremer, hair": Case(SI | {"hair": "hair_soft"}, plain=False),
    "delta/Cremer, Coulomb": Case(SI | {"friction": "coulomb"}, plain=False),
    "delta/Cremer, curve of 20 points": Case(SI | {"friction": "curve", "friction_curve": TWENTY_POINTS}, plain=False),
    "delta/Cremer, thermal": Case(SI | {"friction": "thermal"}, plain=False),
    "delta/Cremer, 4 modes": Case(SI | {"body": "signature"}, plain=False),
    "delta/Cremer, 20 modes": Case(SI | {"body_modes": TWENTY_MODES}, plain=False),
    "delta/Cremer, 20 modes, one differs": Case(SI | {"body_modes": TWENTY_MODES}, "body_8_ratio", plain=False),
    "delta/Cremer, 76 modes": Case(SI | {"body": "stoppani"}, plain=False),
}


@contextlib.contextmanager
def pinned() -> Iterator[int]:
    """Keep this process on one core, the last it may use; yields its number."""
    allowed = os.sched_getaffinity(0)
    core = max(allowed)
    os.sched_setaffinity(0, {core})
    try:
        yield core
    finally:
        os.sched_setaffinity(0, allowed)


def lanes_of(name: str, cells: int) -> NDArray[Any]:
    """Values of the parameter that differs, shape (cells,)."""
    if name == "bow_bridge":
        return np.resize(np.arange(5.0, 45.0), cells)
    first, last = {"f_asym": (0.5, 20.0), "stiffness_b": (1e-6, 3e-4), "body_8_ratio": (0.8, 1.25)}[name]
    return np.geomspace(first, last, cells)


def least_chunks(p: Parameters, lanes: dict[str, NDArray[Any]], best: NDArray[np.float64]) -> None:
    """Simulate a block; keep the time of every chunk that was less than ever, seconds."""
    block = Block(p, lanes)
    for number in range(p.chunks):
        began = time.perf_counter()
        block.advance()
        best[number] = min(best[number], time.perf_counter() - began)


def least_cells(plain: PlainLoop, best: NDArray[np.float64]) -> None:
    """Simulate cells by the plain loop; keep the time of every cell that was less than ever, seconds."""
    for cell in range(plain.cells):
        began = time.perf_counter()
        plain.simulate(cell)
        best[cell] = min(best[cell], time.perf_counter() - began)


def measure(case: Case, repeats: int) -> dict[str, float]:
    """Return ns a cell-step of the kernel, and of the plain loop where the case has one."""
    p = Parameters.from_mapping(case.settings)
    lanes = {case.differs: lanes_of(case.differs, case.cells)}
    Block(p, lanes).advance()
    plain = PlainLoop(p, lanes) if case.plain else None
    if plain is not None:
        check(p, {name: values[:: max(1, case.cells // 8)] for name, values in lanes.items()})
    chunks, cells = np.full(p.chunks, np.inf), np.full(case.cells, np.inf)
    for _ in range(repeats):
        least_chunks(p, lanes, chunks)
        if plain is not None:
            least_cells(plain, cells)
    steps = case.cells * p.samples
    result = {"cells": case.cells, "ns": float(chunks.sum()) / steps * 1e9}
    if plain is not None:
        result["plain_ns"] = float(cells.sum()) / steps * 1e9
        result["ratio"] = result["plain_ns"] / result["ns"]
    return result


def measure_all(repeats: int = REPEATS, cases: Sequence[str] = tuple(CASES)) -> dict[str, dict[str, float]]:
    """Measure cases one after the other on one core; say on stderr how far it is."""
    results = {}
    with pinned():
        for name in cases:
            results[name] = measure(CASES[name], repeats)
            if "string" in CASES[name].settings and PLAIN in results:
                results[name]["over_plain"] = results[name]["ns"] / results[PLAIN]["ns"]
            print(f"kernel: {name}: {results[name]['ns']:.2f} ns", file=sys.stderr, flush=True)
    return results


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.kernel", description=__doc__)
    parser.add_argument("--repeats", type=int, default=REPEATS, help="blocks of 100 periods for each case")
    chosen = parser.parse_args(arguments)
    print(json.dumps({"kernel": program(), "cases": measure_all(chosen.repeats)}, indent=2))


if __name__ == "__main__":
    main()
