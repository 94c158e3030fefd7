"""Whether memory stays flat: twenty maps in a row through one graph that is kept: ``python -m bench.memory``.

The nodes are started one by one, as `ros2 run bow ...` starts them, and get one goal after the other. After each map
the memory of every process is read; growth is that from the second quarter of the maps to the last.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import secrets
import shutil
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench.graph import PRESET, QUICK, cores, size_settings
from bench.processes import memory_of
from bench.standing import Client, standing_graph

MAPS = 20
ALLOWED_MB = 6.0
"""Growth over half of the maps that still counts as flat; the streams of a map of 64 x 32 are 114 MB."""


def growth(rss: Sequence[float]) -> dict[str, float]:
    """Return MB after the first map, the greatest of the second and of the last quarter of maps, and their difference.

    By the second quarter all is filled that is kept for later maps; the greatest counts, as memory goes up and down.
    """
    quarter = max(1, len(rss) // 4)
    early, late = max(rss[-3 * quarter : -2 * quarter] or rss), max(rss[-quarter:])
    return {"first_mb": rss[0], "early_mb": early, "late_mb": late, "growth_mb": late - early}


def measure(maps: int = MAPS, size: tuple[int, int] = QUICK, folder: Path | None = None) -> dict[str, Any]:
    """Run maps in a row; return the memory of each process after each, and whether it stayed flat."""
    namespace = f"/bow/bench_{secrets.token_hex(4)}"
    history: dict[str, list[float]] = {}
    anonymous: dict[str, list[float]] = {}
    walls = []
    made = Path(tempfile.mkdtemp(prefix="bow-memory-", dir=folder))  # left where it is if something goes wrong
    with standing_graph(namespace, made, cores()) as processes, contextlib.closing(Client(namespace)) as client:
        for number in range(maps):
            began = time.perf_counter()
            try:
                result = client.sweep(PRESET, size_settings(*size))
            except (TimeoutError, RuntimeError) as error:
                raise RuntimeError(f"map {number + 1}: {error}; logs are in {made}") from None
            walls.append(time.perf_counter() - began)
            shutil.rmtree(result.directory, ignore_errors=True)
            for name, process in processes.items():
                memory = memory_of(process.pid)
                history.setdefault(name, []).append(memory["rss"])
                anonymous.setdefault(name, []).append(memory["anonymous"])
            sizes = ", ".join(f"{name} {rss[-1]:.0f}" for name, rss in history.items())
            print(f"memory: map {number + 1} of {maps}, {walls[-1]:.1f} s: {sizes} MB", file=sys.stderr, flush=True)
    shutil.rmtree(made, ignore_errors=True)
    grown = {name: growth(rss) for name, rss in history.items()}
    return {
        "maps": maps,
        "width": size[0],
        "height": size[1],
        "wall_s": walls,
        "flat": all(one["growth_mb"] <= ALLOWED_MB for one in grown.values()),
        "allowed_mb": ALLOWED_MB,
        "growth": grown,
        "rss_mb": history,
        "anonymous_mb": anonymous,
    }


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.memory", description=__doc__)
    parser.add_argument("--maps", type=int, default=MAPS)
    parser.add_argument("--size", type=int, nargs=2, default=QUICK, metavar=("NX", "NY"))
    parser.add_argument("--dir", type=Path, help="where runs are recorded, and removed")
    chosen = parser.parse_args(arguments)
    result = measure(chosen.maps, tuple(chosen.size), chosen.dir)
    print(json.dumps(result, indent=2))
    return 0 if result["flat"] else 1


if __name__ == "__main__":
    sys.exit(main())
