"""The rooms of the packages, and which room may import which: written down here and nowhere else."""

from __future__ import annotations

from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("bow_sim", "bow_classifier", "bow_sweep", "bow")

_TABLE = """
bow_sim.atomic_files:
bow_sim.config_files:
bow_sim.simd:
bow_sim.physics: bow_sim.simd
bow_sim.kernel: bow_sim.simd bow_sim.physics
bow_sim.protocol: bow_sim.physics
bow_sim.graph: bow_sim.config_files bow_sim.protocol
bow_sim.figures: bow_sim.atomic_files bow_sim.physics bow_sim.kernel
bow_sim: bow_sim.physics bow_sim.kernel bow_sim.protocol bow_sim.graph
bow_classifier.verdict: bow_sim.simd bow_sim.physics
bow_classifier.features: bow_sim.simd bow_classifier.verdict
bow_classifier.measured: bow_sim.physics bow_sim.protocol bow_classifier.verdict bow_classifier.features
bow_classifier: bow_sim.simd bow_sim.physics bow_sim.kernel bow_sim.protocol bow_sim.graph bow_sim
    bow_classifier.verdict bow_classifier.features bow_classifier.measured
bow_sweep.plan: bow_sim.atomic_files bow_sim.config_files bow_sim.physics bow_sim.kernel bow_sim.protocol
    bow_classifier.verdict
bow_sweep.maps: bow_sim.atomic_files bow_sim.physics bow_sim.kernel bow_sim.protocol bow_classifier.verdict
    bow_classifier.features bow_classifier bow_sweep.plan
bow_sweep.run: bow_sim.atomic_files bow_sim.physics bow_sim.kernel bow_sim.protocol bow_classifier.verdict
    bow_sweep.plan bow_sweep.maps
bow_sweep.record: bow_sim.atomic_files bow_sim.physics bow_sim.protocol bow_sim.graph bow_classifier.verdict
    bow_classifier bow_sweep.plan bow_sweep.maps bow_sweep.run
bow_sweep.figures: bow_sim.physics bow_sim.protocol bow_sim.figures bow_sweep.maps
bow_sweep.cell: bow_sim.atomic_files bow_sim.physics bow_sim.kernel bow_sim.protocol bow_sim.figures bow_sim
    bow_classifier.verdict bow_classifier.measured bow_sweep.plan bow_sweep.maps bow_sweep.record bow_sweep.figures
bow_sweep.edges: bow_sim.atomic_files bow_sim.physics bow_sim.kernel bow_sim.protocol bow_sim.figures
    bow_classifier.verdict bow_sweep.plan bow_sweep.maps bow_sweep.figures
bow_sweep.view: bow_sim.physics bow_sim.kernel bow_sim.protocol bow_sim.graph bow_classifier.verdict bow_sweep.maps
    bow_sweep.run bow_sweep.figures bow_sweep.cell
bow_sweep.explore: bow_sim.atomic_files bow_sim.physics bow_sim.kernel bow_sim.protocol bow_sweep.maps
    bow_sweep.figures bow_sweep.cell
bow_sweep.coordinator: bow_sim.physics bow_sim.kernel bow_sim.protocol bow_sim.graph bow_sim bow_classifier.verdict
    bow_sweep.plan bow_sweep.maps bow_sweep.run bow_sweep.record bow_sweep.figures bow_sweep.cell
bow_sweep.processes: bow_sim.physics bow_sim.kernel bow_sim.protocol bow_sim.graph bow_classifier.verdict
    bow_classifier bow_sweep.plan bow_sweep.run bow_sweep.record bow_sweep.view
bow_sweep.standing: bow_sim.atomic_files bow_sim.protocol bow_sim.graph bow_sweep.plan bow_sweep.run
    bow_sweep.processes
bow_sweep.paper: bow_sim.physics bow_sim.kernel bow_sim.figures bow_classifier.verdict bow_sweep.maps
bow_sweep.beyond: bow_sim.atomic_files bow_sim.physics bow_sim.kernel bow_sim.figures bow_classifier.verdict
    bow_sweep.plan bow_sweep.maps bow_sweep.edges
bow_sweep.study: bow_sim.atomic_files bow_sim.config_files bow_sim.physics bow_sim.protocol bow_sim.figures
    bow_sweep.plan bow_sweep.maps bow_sweep.run bow_sweep.figures
bow: bow_sim.atomic_files bow_sim.physics bow_sim.protocol bow_sim.graph bow_sim.figures bow_classifier.verdict
    bow_classifier.measured bow_classifier bow_sweep.plan bow_sweep.maps bow_sweep.run bow_sweep.figures
    bow_sweep.cell bow_sweep.processes bow_sweep.standing bow_sweep.study
bow_sweep.cli: bow_sim.atomic_files bow_sim.physics bow_sim.kernel bow_sim.protocol bow_sim.graph bow_sim.figures
    bow_classifier.verdict bow_sweep.plan bow_sweep.maps bow_sweep.run bow_sweep.record bow_sweep.figures
    bow_sweep.cell bow_sweep.edges bow_sweep.view bow_sweep.explore bow_sweep.coordinator bow_sweep.processes
    bow_sweep.standing bow_sweep.paper bow_sweep.beyond bow_sweep.study bow
bow_sweep: bow_sim.graph bow_sweep.plan bow_sweep.maps bow_sweep.record bow_sweep.cell bow_sweep.processes
    bow_sweep.cli
"""

ARROWS: dict[str, frozenset[str]] = {
    line.partition(":")[0]: frozenset(line.partition(":")[2].split())
    for line in _TABLE.replace("\n    ", " ").strip().splitlines()
}
"""Room -> rooms that it may import. A package's own name stands for the modules at its root."""


@cache
def modules() -> dict[str, Path]:
    """Return every module of the packages, by dotted name, with its file."""
    found = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def room_of(module: str) -> str:
    """Return the room of a module: itself where it is one, else its folder."""
    parts = module.split(".")
    return next(name for end in (3, 2, 1) if (name := ".".join(parts[:end])) in ARROWS)
