"""CPU time of every process for one chunk, with 1, 2, 4 and 8 stations: ``python -m bench.stations``.

Real sweeps of real processes: a station has one simulator, a recorder and a classifier, all on this machine. Each
number of stations computes a small and a larger map; what the larger one takes more, for each of its further chunks, is
the cost of a chunk, without start and end. Two cores are enough for this: CPU time tells, wall time does not.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench.graph import BYTES_A_CELL, PRESET, size_settings
from bench.processes import Watch
from bow_sweep.plan.sweep import Sweep

STATIONS = (1, 2, 4, 8)
QUICK = (1, 2)
MAPS = ((128, 64), (128, 192))
"""Of 16 and 48 blocks: two for each of eight stations at least."""

QUICK_MAPS = ((32, 16), (64, 32))
ROLES = ("simulator", "classifier", "recorder", "coordinator", "dashboard", "bow sweep")
"""Roles of processes; the last is the supervisor."""


def cpu_of(stations: int, plane: tuple[int, int], folder: Path) -> dict[str, float]:
    """Run a sweep; return role -> CPU seconds of all its processes.

    Raises
    ------
    RuntimeError
        Where it ends otherwise than well.
    """
    words = [PRESET, "--nx", str(plane[0]), "--ny", str(plane[1]), "--out", str(folder / "run"), "--own-graph"]
    words += ["--simulators", str(stations), "--stations", str(stations)]
    output = folder / "sweep.out"
    with open(output, "wb") as file:
        sweep = subprocess.Popen(
            [sys.executable, "-m", "bow_sweep", "sweep", *words], stdout=file, stderr=subprocess.STDOUT
        )
    watch = Watch(sweep.pid, "bow sweep")
    try:
        status = sweep.wait()
    finally:
        used = watch.stop()
    if status:
        raise RuntimeError(f"bow sweep ended with status {status}:\n{output.read_text(errors='replace')}")
    shutil.rmtree(folder / "run")
    found: dict[str, float] = defaultdict(float)
    for name, one in used.items():
        found[next((role for role in ROLES if name.startswith(role)), "others")] += one["cpu_s"]
    return dict(found)


def measure(stations: int, maps: Sequence[tuple[int, int]] = MAPS, folder: Path | None = None) -> dict[str, Any]:
    """Measure one number of stations: role -> ms of CPU a chunk of a block of up to 512 cells.

    Raises
    ------
    RuntimeError
        Where a sweep does not end well, or there is no room for its bag.
    """
    small, large = maps
    sweeps = [Sweep.from_spec(PRESET, size_settings(*plane)) for plane in maps]
    chunks = [sweep.blocks * sweep.chunks for sweep in sweeps]
    print(f"stations: {stations}, {large[0]} x {large[1]} cells", file=sys.stderr, flush=True)
    with tempfile.TemporaryDirectory(dir=folder) as made:
        if shutil.disk_usage(made).free < large[0] * large[1] * BYTES_A_CELL:
            raise RuntimeError(f"{made} has no room for a bag of {large[0]} x {large[1]} cells: see --dir")
        before, after = (cpu_of(stations, plane, Path(made)) for plane in maps)
    each = {role: 1e3 * (after.get(role, 0.0) - before.get(role, 0.0)) / (chunks[1] - chunks[0]) for role in ROLES}
    return {
        "stations": stations,
        "small": small,
        "large": large,
        "chunks": chunks,
        "cpu_s": [before, after],
        "chunk_ms": each,
        "all_ms": sum(each.values()),
    }


def measure_all(quick: bool = False, folder: Path | None = None) -> list[dict[str, Any]]:
    """Measure few stations and many."""
    return [measure(count, QUICK_MAPS if quick else MAPS, folder) for count in (QUICK if quick else STATIONS)]


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="python -m bench.stations", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--stations", type=int, nargs="+", default=list(STATIONS))
    parser.add_argument("--dir", type=Path, help="where runs are recorded, and removed")
    chosen = parser.parse_args(arguments)
    print(json.dumps([measure(count, folder=chosen.dir) for count in chosen.stations], indent=2))


if __name__ == "__main__":
    main()
