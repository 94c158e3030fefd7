"""The maps of `python -m studies.terrain`: those of Fig 11, their grids shifted, and judged by other thresholds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from bow_classifier.block_classifier import BlockClassifier, Geometry
from bow_classifier.verdict.thresholds import DEFAULT_PRESET, THRESHOLD_PRESETS, Thresholds
from bow_sim.kernel.block import Block
from bow_sim.kernel.sources import program
from bow_sweep.maps.basin_map import Basin
from bow_sweep.maps.in_process import intervals_of
from bow_sweep.maps.map_file import MapFile
from bow_sweep.paper.maps import LAYOUT
from bow_sweep.plan.sweep import Sweep

DATA = Path(__file__).resolve().parent.parent / "tests" / "data" / "fig11.npz"

MOVED = {
    "1 - correlation": lambda by: replace(Thresholds(), correlation=1 - (1 - Thresholds().correlation) * by),
    "slip": lambda by: replace(Thresholds(), slip=Thresholds().slip * by),
    "corner": lambda by: replace(Thresholds(), corner=Thresholds().corner * by),
}
"""Thresholds of the verdict, each as a function of what it is multiplied by. Correlation has no room upwards, as a
tenth more than 0.95 is beyond 1: what is moved is its distance from 1."""

JITTER = ((0.5, 0.5), (0.25, 0.75), (0.75, 0.25))
"""Shifts of the grid along x and y, in cells."""


def judged(sweep: Sweep, thresholds: Sequence[Thresholds]) -> list[Basin]:
    """Compute a map once and judge it by several sets of thresholds."""
    p = sweep.parameters
    basins = [Basin(sweep.x.count, sweep.y.count, sweep.chunks) for _ in thresholds]
    for number in range(sweep.blocks):
        cells = sweep.block(number)
        lanes = sweep.lanes(cells)
        block = Block(p, lanes)
        speed, position = lanes.get("v_b", p.v_b), lanes.get("bow_bridge", p.bow_bridge)
        classifiers = [BlockClassifier(Geometry.of(p), each, len(cells), speed, position) for each in thresholds]
        for test in range(p.chunks):
            chunk = block.advance()
            intervals = intervals_of(chunk)
            for classifier, basin in zip(classifiers, basins, strict=True):
                basin.take(test, cells, classifier.classify(chunk.bridge_force, intervals)._asdict())
    return basins


def plan(letter: str, nx: int, ny: int, shift: tuple[float, float] = (0.0, 0.0)) -> Sweep:
    """The sweep of a map, its grid shifted by some cells."""
    sweep = Sweep.from_spec(f"fig11{letter}", [f"x.count={nx}", f"y.count={ny}"])
    x, y = sweep.x, sweep.y
    ratio, step = (x.last / x.first) ** (shift[0] / (nx - 1)), shift[1] * (y.last - y.first) / (ny - 1)
    x = replace(x, first=x.first * ratio, last=x.last * ratio)
    return replace(sweep, x=x, y=replace(y, first=y.first + step, last=y.last + step)) if any(shift) else sweep


def compute(nx: int, ny: int) -> dict[str, dict[str, MapFile]]:
    """All maps: variant -> letter -> map; the variants are "default", thresholds moved, and shifts."""
    moved = {f"{name} × {by:g}": make(by) for name, make in MOVED.items() for by in (0.9, 1.1)}
    moved |= {f"preset {name}": each for name, each in THRESHOLD_PRESETS.items() if name != DEFAULT_PRESET}
    found: dict[str, dict[str, MapFile]] = {}
    for letter in LAYOUT:
        sweep = plan(letter, nx, ny)
        basins = judged(sweep, [Thresholds(), *moved.values()])
        for name, basin in zip(["default", *moved], basins, strict=True):
            found.setdefault(name, {})[letter] = MapFile.of(sweep, basin, "terrain")
        for shift in JITTER:
            sweep = plan(letter, nx, ny, shift)
            (basin,) = judged(sweep, [Thresholds()])
            found.setdefault(f"grid shifted by {shift[0]:g}, {shift[1]:g} cells", {})[letter] = MapFile.of(
                sweep, basin, "terrain"
            )
        print(f"fig11{letter}", flush=True)
    return found


def write_data() -> None:
    """Write the six maps as tests read them: small, with the recipe and the kernel that made them."""
    arrays = {}
    for letter in LAYOUT:
        (basin,) = judged(plan(letter, 128, 64), [Thresholds()])
        arrays[f"{letter}_transient_periods"] = basin.transient_periods.reshape(64, 128).astype(np.uint8)
        arrays[f"{letter}_regime"] = basin.latest("regime").reshape(64, 128)
    recipe = "python -m studies.terrain --data: presets fig11a ... fig11f, 128 x 64 cells, default thresholds"
    DATA.parent.mkdir(exist_ok=True)
    origin = {"recipe": recipe, "fingerprint": program(), "classifier": Thresholds().hash}
    arrays |= {name: np.array(text) for name, text in origin.items()}
    np.savez_compressed(DATA, allow_pickle=False, **arrays)
