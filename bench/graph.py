"""What the graph costs beside the bare kernel: ``python -m bench.graph``.

Both compute the same map on the same cores in one run: the bare kernel in as many processes as there are simulators,
keeping nothing; the graph as `bow sweep` runs it, streaming, judging, recording and drawing everything.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import resource
import secrets
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import psutil
from mcap.reader import make_reader

from bench.processes import Watch
from bench.standing import Client, standing_graph
from bow_sim.kernel.block import Block
from bow_sweep.plan.sweep import Sweep
from bow_sweep.run.directory import read_ledger

PRESET = "fig11d"
WIDTH, HEIGHT = 128, 64
"""The map of the paper."""

STANDING_MAPS = 7
"""Maps of the paper's size through a standing graph, of which the median is kept."""

QUICK = (64, 32)
LARGE = 16
BYTES_A_CELL = 70_000
"""A bag holds 56 kB of bridge force for each cell of 100 periods, and little else."""


def cores() -> int:
    """Return how many cores this process may use."""
    return len(psutil.Process().cpu_affinity())


def size_settings(width: int, height: int) -> tuple[str, str]:
    return f"x.count={width}", f"y.count={height}"


def compute(settings: Sequence[str], number: int) -> float:
    """Compute one block of a sweep, keeping nothing; return the CPU seconds."""
    sweep = Sweep.from_spec(PRESET, settings)
    began = time.process_time()
    block = Block(sweep.parameters, sweep.lanes(sweep.block(number)))
    for _ in range(sweep.chunks):
        block.advance()
    return time.process_time() - began


@contextlib.contextmanager
def bare_kernel(settings: Sequence[str], processes: int) -> Iterator[Callable[[], dict[str, float]]]:
    """Keep processes that compute a map without any graph whenever asked, and give wall and CPU seconds."""
    blocks = Sweep.from_spec(PRESET, settings).blocks
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:

        def run() -> dict[str, float]:
            began = time.perf_counter()
            cpu = sum(pool.map(compute, [settings] * blocks, range(blocks)))
            return {"wall_s": time.perf_counter() - began, "cpu_s": cpu}

        list(pool.map(compute, [settings] * processes, [0] * processes))  # imports and caches
        yield run


def first_verdict(bag: Path) -> float:
    """Return when the recorder took in the first verdict, seconds since 1970."""
    found = []
    for path in bag.glob("*.mcap"):
        with open(path, "rb") as file:
            reader = make_reader(file)
            summary = reader.get_summary()
            topics = [channel.topic for channel in (summary.channels if summary else {}).values()]
            wanted = [topic for topic in topics if topic.endswith("/verdicts")]
            found += [message.log_time / 1e9 for _, _, message in list_first(reader.iter_messages(wanted))]
    return min(found)


def list_first(items: Any) -> list[Any]:
    """Return the first item, if there is one, as a list."""
    return [item for item, _ in zip(items, range(1), strict=False)]


def times(ledger: Iterable[Mapping[str, Any]]) -> dict[str, list[float]]:
    """Return when blocks were sent and done, seconds since 1970."""
    return {name: [entry["at"] for entry in ledger if entry["event"] == name] for name in ("dispatched", "done")}


def milestones(run: Path, began: float, end: float) -> dict[str, float]:
    """Return how long after its start a sweep reached each stage, seconds: from its ledger, bag and files."""
    ledger = read_ledger(run)
    at = times(ledger)
    files = [run / name for name in ("report.json", "map.npz", "map.png", "dashboard.rrd")]
    stages = {
        "plan": ledger[0]["at"],
        "first_block_sent": min(at["dispatched"]),
        "first_verdict": first_verdict(run / "bag"),
        "last_block_done": max(at["done"]),
        "results_written": max(path.stat().st_mtime for path in files if path.exists()),
        "end": end,
    }
    return {name: when - began for name, when in stages.items()}


def graph(width: int, height: int, simulators: int, run: Path, more: Sequence[str] = ()) -> dict[str, Any]:
    """Run a whole sweep; return its stages, and what each of its processes used.

    Raises
    ------
    RuntimeError
        Where it ends otherwise than well.
    """
    words = [PRESET, "--nx", str(width), "--ny", str(height), "--simulators", str(simulators), "--out", str(run), *more]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    began = time.time()
    with open(run.with_suffix(".out"), "wb") as output:
        sweep = subprocess.Popen(
            [sys.executable, "-m", "bow_sweep", "sweep", "--own-graph", *words], stdout=output, stderr=subprocess.STDOUT
        )
    watch = Watch(sweep.pid, "bow sweep")
    try:
        status = sweep.wait()
    finally:
        end = time.time()
        processes = watch.stop()
    if status:
        raise RuntimeError(f"bow sweep ended with status {status}:\n{run.with_suffix('.out').read_text()}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    stages = milestones(run, began, end)
    cells, blocks_s = width * height, stages["last_block_done"] - stages["first_block_sent"]
    return {
        "wall_s": stages["end"],
        "plan_to_last_block_s": stages["last_block_done"] - stages["plan"],
        "blocks_s": blocks_s,
        "cells_per_s": cells / blocks_s,
        "cells_per_s_whole": cells / stages["end"],
        "cpu_s": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "stages_s": stages,
        "peak_rss_mb": watch.peak_rss_mb,
        "peak_pss_mb": watch.peak_pss_mb,
        "processes": processes,
        "watching_cpu_s": watch.cpu_s,
    }


def cpu_of(processes: Mapping[str, subprocess.Popen[bytes]]) -> dict[str, float]:
    """Return the CPU seconds that each process has used."""
    return {name: sum(psutil.Process(process.pid).cpu_times()[:2]) for name, process in processes.items()}


def middle_of(runs: Iterable[dict[str, Any]], key: str) -> dict[str, Any]:
    """Return the run with the median of a figure, the lesser of two."""
    ordered = sorted(runs, key=lambda run: run[key])
    return ordered[(len(ordered) - 1) // 2]


RECORDS = ("all", "verdicts")
"""What the maps of a standing graph record, in turn."""


def standing(settings: Sequence[str], simulators: int, maps: int, folder: Path) -> dict[str, dict[str, Any]]:
    """Run maps through a graph that stands, each right after the bare kernel; return one, that of the median ratio.

    `blocks_s` is from the first block sent to the last one done, `over_bare` its ratio to the bare kernel's wall time
    just before: other guests of the machine slow both. The first map is left out. The CPU time is that from a goal to
    its result, of each process, results and picture written.

    Returns
    -------
    dict
        For each of `RECORDS`: its map.
    """
    namespace = f"/bow/bench_{secrets.token_hex(4)}"
    runs: dict[str, list[dict[str, Any]]] = {record: [] for record in RECORDS}
    with (
        bare_kernel(settings, simulators) as bare,
        standing_graph(namespace, folder, simulators) as processes,
        contextlib.closing(Client(namespace)) as client,
    ):
        for number in range(len(RECORDS) * (maps + 1)):
            record = RECORDS[number % len(RECORDS)]
            alone = bare()
            before = cpu_of(processes)
            began = time.perf_counter()
            result = client.sweep(PRESET, [*settings, f"record={record}"])
            wall = time.perf_counter() - began
            cpu = {name: seconds - before[name] for name, seconds in cpu_of(processes).items()}
            at = times(read_ledger(Path(result.directory)))
            blocks_s = max(at["done"]) - min(at["dispatched"])
            one: dict[str, Any] = {"wall_s": wall, "blocks_s": blocks_s, "cpu_s": sum(cpu.values()), "processes": cpu}
            runs[record].append(one | {"bare_kernel": alone, "over_bare": blocks_s / alone["wall_s"]})
            shutil.rmtree(result.directory)
    return {
        record: middle_of(some[1:], "over_bare") | {"all_over_bare": sorted(run["over_bare"] for run in some[1:])}
        for record, some in runs.items()
    }


def measure(width: int, height: int, simulators: int, repeats: int, folder: Path | None = None) -> dict[str, Any]:
    """Measure a map by bare kernel and graph; of several sweeps the one with the median wall time is kept."""
    cells = width * height
    result: dict[str, Any] = {"preset": PRESET, "width": width, "height": height, "simulators": simulators}
    with tempfile.TemporaryDirectory(dir=folder) as made:
        free = shutil.disk_usage(made).free
        if free < cells * BYTES_A_CELL:
            return result | {"skipped": f"{made} has {free / 1e9:.0f} GB, not {cells * BYTES_A_CELL / 1e9:.0f}"}
        print(f"graph: {width} x {height} cells, {simulators} simulators", file=sys.stderr, flush=True)
        with bare_kernel(size_settings(width, height), simulators) as bare:
            result["bare_kernel"] = min((bare() for _ in range(repeats)), key=lambda run: run["wall_s"])
        runs = []
        for number in range(repeats):
            run = Path(made) / f"run{number}"
            runs.append(graph(width, height, simulators, run))
            shutil.rmtree(run)
        kept = standing(size_settings(width, height), simulators, STANDING_MAPS if repeats > 1 else 2, Path(made))
    middle = middle_of(runs, "wall_s")
    result["graph"], result["standing"] = middle, kept["all"]
    result["verdicts_only"] = kept["verdicts"]
    result["all_walls_s"] = sorted(one["wall_s"] for one in runs)
    alone = result["bare_kernel"]
    result["over_bare"] = {
        "blocks": middle["blocks_s"] / alone["wall_s"],
        "wall": middle["wall_s"] / alone["wall_s"],
        "cpu": middle["cpu_s"] / alone["cpu_s"],
    }
    return result


def measure_all(quick: bool = False, large: bool = False, folder: Path | None = None) -> list[dict[str, Any]]:
    """Measure the map at 1 simulator and at one a core, then with 4 and, where asked, 16 times the cells."""
    width, height = QUICK if quick else (WIDTH, HEIGHT)
    pools = sorted({1, min(2, cores()), cores()})
    plans = [(1, simulators, 1 if quick else 3) for simulators in pools]
    plans += [] if quick else [(2, cores(), 1)]
    plans += [(4, cores(), 1)] if large else []
    return [
        measure(factor * width, factor * height, simulators, repeats, folder) for factor, simulators, repeats in plans
    ]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--quick", action="store_true", help="only a map of 64 x 32, once")
    parser.add_argument("--large", action="store_true", help="16 times the cells too: minutes, and a bag of 8 GB")
    parser.add_argument("--dir", type=Path, help="where runs are recorded, and removed (default: the folder for such)")


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.graph", description=__doc__)
    add_arguments(parser)
    chosen = parser.parse_args(arguments)
    print(json.dumps(measure_all(chosen.quick, chosen.large, chosen.dir), indent=2))


if __name__ == "__main__":
    main()
