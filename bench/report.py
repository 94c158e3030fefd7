"""What was measured, as rows of one table for people: on a terminal, or as Markdown in docs/benchmarks.md."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console
from rich.table import Table

from bench.classifier import FIRST
from bench.machine import line
from tools.doc_page import put

BASELINE = Path(__file__).parent / "baseline.json"
"""Figures of an earlier state of the program, and where they were measured."""
PAGE = Path(__file__).resolve().parent.parent / "docs" / "benchmarks.md"
HEAD = """# Benchmarks

What a cell-step costs, how far that is from what the machine could do, what others take for the like, and what the
graph adds. `make bench ARGS="--json bench.json --page"` measures and writes this page.
"""
MEANING = {
    "kernel": "A cell-step is one sample of one cell, everything included. One core; the plain loop is one cell at a "
    "time, by Numba, of the same physics and with the same results to the last bit. An earlier state of the kernel "
    "stands beside it: what share of its time a later one took where both were measured in turns, on the quiet machine "
    "that bench/baseline.json names.",
    "peak of one core": "Chains of one operation on eight lanes, in registers. Kernel and plain loop never fuse a "
    "multiplication with an addition, so that every machine rounds alike.",
    "kernel against the peak": "Bound: if all multiplications, additions and roots of a cell-step overlapped, and "
    "nothing else cost anything.",
    "other software": "STK's is another model (no torsion, no stiffness, no hysteresis, but body filters): a "
    "yardstick, not a peer.",
    "classifier": "A cell-sample is one sample of one cell, all tests and the verdict included. CPU time of one core, "
    "over the chunks of a block of figure 11(d).",
    "graph": "`bow sweep fig11d` as a user starts it, dashboard file and all, against the bare kernel in as many "
    "processes, which keeps nothing. RSS counts shared pages in each process, PSS shares them out. A standing "
    "graph has its nodes started before, and gets one goal after the other, the bare kernel a map of its own before "
    "each; given is the map with the median ratio. Every second one records its verdicts only.",
    "memory": "Maps in a row through one graph that is kept, as `ros2 run bow ...` starts it; resident memory of each "
    "process.",
}
"""What a section's figures mean."""


EARLIER = "d42a378"
"""A commit whose figures are shown beside those of now."""


class Earlier(NamedTuple):
    """The graph of `EARLIER` with two simulators, on two cores of an AMD EPYC (family 25, model 17).

    Attributes
    ----------
    wall_s, cpu_s
        Of `bow sweep fig11d`.
    cpu
        The CPU time over that of the bare kernel.
    standing
        Wall time from the first block sent to the last one done over that of the bare kernel; the graph stands.
    """

    wall_s: float
    cpu_s: float
    cpu: float
    standing: float


GRAPH_EARLIER = {
    (128, 64): Earlier(3.79, 5.84, 8.1, 2.89),
    (256, 128): Earlier(9.18, 16.18, 6.1, 3.94),
    (512, 256): Earlier(33.55, 59.72, 5.5, 4.09),
}
"""Of maps with so many columns and rows."""

KERNEL_OF_PRESET = "stiff/Cremer, float64"
"""The case of the kernel that the preset is computed by."""

GOALS = {(128, 64): 2.3, (256, 128): 2.8, (512, 256): 2.8}
"""Of maps with so many columns and rows: first block sent to last done, over the bare kernel of `EARLIER`, at most."""

VERDICTS_GOAL = 1.5
"""The same where only verdicts are recorded."""

CHUNK_CELLS = 512
"""Costs a chunk are for so many cells: 1.42 MB of bridge force."""

TESTS = 20
"""Chunks of a block of the preset that is measured."""


class Row(NamedTuple):
    """A line of the table."""

    section: str
    what: str
    value: str
    beside: str = ""


def rows(result: Mapping[str, Any]) -> list[Row]:
    """Return a whole result, or as much as there is of one, as rows."""
    parts: dict[str, Callable[[Any], Iterator[Row]]]
    parts = {"kernel": _kernel, "peak": _peak, "stk": _stk}
    parts |= {"classifier": _classifier, "graph": _graph, "memory": _memory}
    parts |= {"coordinator": _coordinator, "stations": _stations}
    found: list[Row] = []
    for name, make in parts.items():
        part = result.get(name, {})
        found += [Row(name, name, "FAILED", part["failed"])] if "failed" in part else make(part) if part else []
    return found


def _kernel(cases: Mapping[str, Mapping[str, float]]) -> Iterator[Row]:
    earlier = read(BASELINE)
    for name, case in cases.items():
        beside = f"plain loop {case['plain_ns']:.1f} ns: {case['ratio']:.1f} times" if "plain_ns" in case else ""
        beside = f"{case['over_plain']:.2f} times delta/Cremer without it" if "over_plain" in case else beside
        if name in earlier["cases"]:
            then, later = earlier["cases"][name]
            beside += "; " if beside else ""
            beside += f"{earlier['commit']} {then:.2f} ns, {earlier['later']} {later / then:.2f} of it"
        cells = "" if case["cells"] == 128 else f", {case['cells']:.0f} cell"
        yield Row("kernel", name.removesuffix(", one cell") + cells, f"{case['ns']:.2f} ns a cell-step", beside)


def _peak(peak: Mapping[str, Any]) -> Iterator[Row]:
    for dtype, rates in peak["operations_per_ns"].items():
        for name, rate in rates.items():
            yield Row("peak of one core", f"{name}, {dtype}", f"{rate:.1f} a ns")
    for name, one in peak["kernels"].items():
        counts = f"{one['multiply']} multiplications, {one['add']} additions, {one['sqrt']} root"
        peaks = f"{one['of_fma_peak']:.0%} of fused peak, {one['of_sqrt_peak']:.0%} of sqrt peak"
        share = f"share of the arithmetic bound {one['of_bound']:.0%}"
        yield Row("kernel against the peak", name, share, f"bound {one['bound_ns']:.2f} ns: {counts}; {peaks}")


def _stk(stk: Mapping[str, Any]) -> Iterator[Row]:
    if "skipped" in stk:
        yield Row("other software", "STK Bowed, float64", "left out", stk["skipped"])
    else:
        yield Row("other software", "STK Bowed, float64", f"{stk['ns_per_tick']:.1f} ns a tick", stk["flags"])


def _classifier(cases: Mapping[str, Mapping[str, float]]) -> Iterator[Row]:
    for name, case in cases.items():
        beside = f"in the first chunk {case['first_chunk_ns']:.2f} ns; {FIRST[name]}"
        yield Row("classifier", name, f"{case['ns']:.2f} ns a cell-sample", beside)


def _graph(maps: list[dict[str, Any]]) -> Iterator[Row]:
    for one in maps:
        name = f"{one['width']} x {one['height']} cells, {one['simulators']} simulator{'s'[: one['simulators'] > 1]}"
        if "skipped" in one:
            yield Row("graph", name, "left out", one["skipped"])
            continue
        bare, graph, over = one["bare_kernel"], one["graph"], one["over_bare"]
        stages = graph["stages_s"]
        spans = {
            f"{a.replace('_', ' ')} to {b.replace('_', ' ')}": stages[b] - stages[a]
            for a, b in itertools.pairwise(stages)
        }
        phases = ", ".join([f"start to plan {stages['plan']:.2f} s", *(f"{k} {v:.2f} s" for k, v in spans.items())])
        yield Row("graph", name, f"{graph['wall_s']:.2f} s", f"bare kernel {bare['wall_s']:.2f} s")
        yield Row("graph", "  plan to last block done", f"{graph['plan_to_last_block_s']:.2f} s", phases)
        rate = f"first block sent to last done, {over['blocks']:.1f} times the bare kernel's wall time"
        yield Row("graph", "  throughput", f"{graph['cells_per_s']:,.0f} cells/s", rate)
        size = (one["width"], one["height"])
        earlier = GRAPH_EARLIER.get(size) if one["simulators"] == 2 else None
        beside = f"bare kernel {bare['cpu_s']:.2f} s: {over['cpu']:.1f} times"
        if earlier:
            beside += (
                f"; at {EARLIER} {earlier.cpu:.1f} times ({earlier.wall_s:.2f} s of wall, {earlier.cpu_s:.2f} of CPU)"
            )
        yield Row("graph", "  CPU", f"{graph['cpu_s']:.2f} s", beside)
        yield Row("graph", "  peak of all, RSS/PSS", f"{graph['peak_rss_mb']:.0f}/{graph['peak_pss_mb']:.0f} MB")
        kept = one["standing"]
        beside = _over_bare(kept, GOALS.get(size))
        if earlier:
            beside += f"; at {EARLIER} {earlier.standing:.2f} times the kernel of then"
        yield Row("graph", "  standing graph: first block sent to last done", f"{kept['blocks_s']:.2f} s", beside)
        beyond = f"{kept['cpu_s'] - kept['bare_kernel']['cpu_s']:.2f} s beyond the bare kernel: "
        beside = beyond + ", ".join(f"{name} {cpu:.2f}" for name, cpu in kept["processes"].items())
        yield Row("graph", "  standing graph: CPU", f"{kept['cpu_s']:.2f} s", beside)
        chunks = one["width"] * one["height"] * TESTS / CHUNK_CELLS
        beside = ", ".join(f"{name} {1e3 * cpu / chunks:.2f}" for name, cpu in kept["processes"].items())
        yield Row("graph", "  standing graph: CPU a chunk", f"{1e3 * kept['cpu_s'] / chunks:.2f} ms", f"ms: {beside}")
        if "verdicts_only" in one:
            kept = one["verdicts_only"]
            beside = f"{_over_bare(kept, VERDICTS_GOAL)}; CPU {kept['cpu_s']:.2f} s"
            yield Row("graph", "  standing graph, verdicts only: the same", f"{kept['blocks_s']:.2f} s", beside)
        for process, use in graph["processes"].items():
            memory = f"peak RSS/PSS {use['peak_rss_mb']:.0f}/{use['peak_pss_mb']:.0f} MB"
            yield Row("graph", f"    {process}", f"CPU {use['cpu_s']:.2f} s", memory)


def _over_bare(kept: Mapping[str, Any], goal: float | None) -> str:
    """Return the ratios of a standing graph to the bare kernel, and to that of the earlier commit, in words.

    The earlier kernel is not here: its time follows from the ratio of both, measured in turns on another day.
    """
    earlier, spread = read(BASELINE), kept["all_over_bare"]
    then, later = earlier["cases"][KERNEL_OF_PRESET]
    asked = f" (goal: at most {goal:g})" if goal else ""
    return (
        f"{kept['over_bare']:.2f} times the bare kernel's {kept['bare_kernel']['wall_s']:.2f} s just before, the "
        f"median of {spread[0]:.2f} ... {spread[-1]:.2f}; {kept['over_bare'] * later / then:.2f} times that of "
        f"{earlier['commit']}{asked}, if the kernel is that of {earlier['later']}; goal to result "
        f"{kept['wall_s']:.2f} s"
    )


def _coordinator(pools: list[dict[str, Any]]) -> Iterator[Row]:
    for one in pools:
        name = f"{one['simulators']} simulator{'s'[: one['simulators'] > 1]} that compute nothing"
        value = f"CPU {one['cpu_ms_a_chunk']:.2f} ms a chunk"
        beside = (
            f"{one['chunks_per_s']:,.0f} chunks/s, {one['blocks_per_s']:.0f} blocks/s, {one['busy']:.0%} of a core; "
        )
        beside += f"{one['chunk_ms']:.2f} ms in the second half without heartbeats, "
        beside += f"those {one['idle_cpu']:.0%} of a core; {one['once_s']:.1f} s once; "
        yield Row("coordinator", name, value, f"{beside}{one['rss_mb']:.0f} MB")


def _stations(numbers: list[dict[str, Any]]) -> Iterator[Row]:
    for one in numbers:
        name = f"{one['stations']} station{'s'[: one['stations'] > 1]} of one simulator"
        beside = ", ".join(f"{role} {ms:.2f}" for role, ms in one["chunk_ms"].items())
        yield Row("stations", name, f"CPU {one['all_ms']:.2f} ms a chunk", f"ms: {beside}")


def _memory(memory: Mapping[str, Any]) -> Iterator[Row]:
    size = f"{memory['maps']} maps of {memory['width']} x {memory['height']}"
    yield Row("memory", size, "flat" if memory["flat"] else "NOT flat", f"{sum(memory['wall_s']):.0f} s")
    for name, one in memory["growth"].items():
        ends = f"after the first {one['first_mb']:.0f} MB, at most {one['early_mb']:.0f} MB in the second quarter"
        yield Row("memory", f"  {name}", f"{one['growth_mb']:+.1f} MB", f"{ends}, {one['late_mb']:.0f} MB in the last")


def table(result: Mapping[str, Any], console: Console) -> None:
    """Print the one table."""
    grid = Table(title=line(result["machine"]), title_justify="left", show_lines=False)
    for name, ratio in (("", 2), ("measured", 3), ("", 3), ("beside it", 7)):
        grid.add_column(name, ratio=ratio, overflow="fold")
    for section, part in itertools.groupby(rows(result), key=lambda row: row.section):
        for number, row in enumerate(part):
            grid.add_row("" if number else section, row.what, row.value, row.beside)
        grid.add_section()
    console.print(grid)


def markdown(result: Mapping[str, Any]) -> str:
    """Return the page: the machine, then a table for each section."""
    machine = result["machine"]
    versions = ", ".join(f"{name} {version}" for name, version in machine["versions"].items())
    parts = [
        f"Measured by `make bench` in one run of {result['seconds'] / 60:.1f} minutes on: {line(machine)}.",
        f"Kernel: `{machine['kernel']}`; {versions}.",
    ]
    for section, part in itertools.groupby(rows(result), key=lambda row: row.section):
        lines = [f"## {section.capitalize()}", "", MEANING.get(section, ""), "", "| | | |", "|---|---|---|"]
        for row in part:
            what = row.what.strip() if row.what.startswith(" ") else f"**{row.what}**"
            lines.append(f"| {what} | {row.value} | {row.beside} |")
        parts.append("\n".join(lines))
    return "\n\n".join(parts)


def write_page(result: Mapping[str, Any], path: Path = PAGE) -> None:
    """Write the page; text around its marks stays."""
    if not path.exists():
        path.write_text(HEAD, encoding="utf-8")
    put(markdown(result), path, "bench/report.py")


def read(path: Path) -> dict[str, Any]:
    """Read a result from a file of JSON."""
    result: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return result
