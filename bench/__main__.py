"""Kernel, peaks, peers, classifier, graph and memory in one run: ``make bench``, or ``python -m bench``.

Progress goes to stderr; to stdout go one table and then one JSON, or with --json the JSON into a file. It takes about
four minutes on two cores; --large adds two, --quick takes one. Leave the machine alone meanwhile. Exit status 1 where a
part failed.

  python -m bench --json bench.json --page      measure, keep the JSON, write docs/benchmarks.md
  python -m bench --only coordinator            the coordinator with 1 to 1024 simulators that compute nothing
  python -m bench --only stations               CPU of every process with 1, 2, 4 and 8 stations
  python -m bench --from bench.json --page      write docs/benchmarks.md from an earlier run
  python tests/stress/kills.py --kills 200             the long storm of kills: not a part of this
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from bench import classifier, coordinator, graph, kernel, machine, memory, peak, report, stations, stk

PARTS = ("kernel", "peak", "stk", "classifier", "graph", "memory")
ON_REQUEST = ("coordinator", "stations")
"""Parts that are measured only where they are asked for: they take minutes."""
WIDE = 160


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """Measure the parts that were chosen, one after the other."""
    result: dict[str, Any] = {"machine": machine.describe()}
    repeats = 3 if chosen.quick else kernel.REPEATS
    maps = 5 if chosen.quick else memory.MAPS
    todo: dict[str, Callable[[], Any]] = {
        "kernel": lambda: kernel.measure_all(repeats),
        "peak": lambda: peak.measure(result.get("kernel", {}), repeats),
        "stk": lambda: stk.measure(repeats=repeats),
        "classifier": lambda: classifier.measure_all(repeats),
        "graph": lambda: graph.measure_all(chosen.quick, chosen.large, chosen.dir),
        "memory": lambda: memory.measure(maps, folder=chosen.dir),
        "coordinator": lambda: coordinator.measure_all(chosen.quick, chosen.dir),
        "stations": lambda: stations.measure_all(chosen.quick, chosen.dir),
    }
    began = time.monotonic()
    for name in (*PARTS, *ON_REQUEST):
        if name in chosen.only:
            print(f"bench: {name}, {time.monotonic() - began:.0f} s so far", file=sys.stderr, flush=True)
            try:
                result[name] = todo[name]()
            except (RuntimeError, ArithmeticError) as error:  # the others' figures are worth keeping
                result[name] = {"failed": str(error)}
    result["seconds"] = time.monotonic() - began
    return result


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m bench", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    graph.add_arguments(parser)
    every = (*PARTS, *ON_REQUEST)
    what = f"{', '.join(every)} (default: all but the last two)"
    parser.add_argument("--only", nargs="+", choices=every, default=PARTS, metavar="PART", help=what)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the JSON here instead of to stdout")
    parser.add_argument("--page", action="store_true", help="write docs/benchmarks.md")
    parser.add_argument("--from", type=Path, metavar="FILE", dest="source", help="measure nothing: read this JSON")
    chosen = parser.parse_args(arguments)
    result = report.read(chosen.source) if chosen.source else measure(chosen)
    console = Console()
    report.table(result, console if console.is_terminal else Console(width=WIDE))
    text = json.dumps(result, indent=2)
    if chosen.json:
        chosen.json.write_text(text + "\n", encoding="utf-8")
    else:
        print(text)
    if chosen.page:
        report.write_page(result)
    return int(any("failed" in result[name] for name in (*PARTS, *ON_REQUEST) if name in result))


if __name__ == "__main__":
    sys.exit(main())
