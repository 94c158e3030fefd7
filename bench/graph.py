"""What the graph costs beside the bare kernel: ``python -m bench.graph``.

Both compute the same map on the same cores in one run: the bare kernel in as many processes as there are simulators,
keeping nothing; the graph as `bow sweep` runs it, streaming, judging, recording and drawing everything.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import psutil

from bow_sim.kernel import Block
from bow_sweep.plan import Sweep


def compute(preset: str, number: int) -> float:
    """Compute one block of a preset, keeping nothing; return the CPU seconds."""
    sweep = Sweep.from_spec(preset)
    began = time.process_time()
    block = Block(sweep.parameters, sweep.lanes(sweep.block(number)))
    for _ in range(sweep.chunks):
        block.advance()
    return time.process_time() - began


def bare_kernel(preset: str, processes: int) -> dict[str, float]:
    """Return wall and CPU seconds of a map without any graph."""
    blocks = Sweep.from_spec(preset).blocks
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        list(pool.map(compute, [preset] * processes, range(processes)))  # imports and caches
        began = time.perf_counter()
        cpu = sum(pool.map(compute, [preset] * blocks, range(blocks)))
        return {"wall_s": time.perf_counter() - began, "cpu_s": cpu}


def graph(preset: str, processes: int, directory: Path) -> dict[str, object]:
    """Return wall seconds of a whole sweep, and CPU seconds and peak memory of each of its processes."""
    began = time.perf_counter()
    words = [preset, "--simulators", str(processes), "--out", str(directory)]
    sweep = subprocess.Popen(
        [sys.executable, "-m", "bow_sweep.cli", "sweep", *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    usage: dict[str, dict[str, float]] = {}
    family = psutil.Process(sweep.pid)
    while sweep.poll() is None:
        with contextlib.suppress(psutil.Error):
            for process in [family, *family.children()]:
                with contextlib.suppress(psutil.Error):
                    words = process.cmdline()
                    name = next((w.removeprefix("__node:=") for w in words if w.startswith("__node:=")), "bow sweep")
                    times, memory = process.cpu_times(), process.memory_info().rss / 1e6
                    peak = max(memory, usage.get(name, {}).get("peak_mb", 0.0))
                    usage[name] = {"cpu_s": times.user + times.system, "peak_mb": peak}
        time.sleep(0.1)
    wall = time.perf_counter() - began
    if sweep.returncode:
        raise SystemExit(f"bow sweep ended with status {sweep.returncode}")
    report = json.loads((directory / "report.json").read_text())
    return {"wall_s": wall, "sweep_wall_s": report["wall_seconds"], "processes": usage}


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.graph", description=__doc__)
    parser.add_argument("--preset", default="fig11d")
    parser.add_argument("--simulators", type=int, default=len(psutil.Process().cpu_affinity()))
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    chosen = parser.parse_args(arguments)
    bare = bare_kernel(chosen.preset, chosen.simulators)
    with tempfile.TemporaryDirectory() as folder:
        whole = graph(chosen.preset, chosen.simulators, Path(folder) / "run")
    ratio = float(whole["sweep_wall_s"]) / bare["wall_s"]  # type: ignore[arg-type]
    result = {"preset": chosen.preset, "bare_kernel": bare, "graph": whole, "sweep_wall_over_bare": ratio}
    if chosen.json:
        print(json.dumps(result, indent=2))
        return
    print(f"bare kernel, {chosen.simulators} processes   wall {bare['wall_s']:6.2f} s   CPU {bare['cpu_s']:6.2f} s")
    print(f"graph, start to end          wall {whole['wall_s']:6.2f} s")
    print(f"graph, plan to report        wall {whole['sweep_wall_s']:6.2f} s   {ratio:.1f} times the bare kernel")
    for name, used in sorted(whole["processes"].items()):  # type: ignore[attr-defined]
        print(f"  {name:28s} CPU {used['cpu_s']:6.2f} s   peak {used['peak_mb']:6.0f} MB")


if __name__ == "__main__":
    main()
