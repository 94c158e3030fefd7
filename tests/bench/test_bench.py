"""The benchmarks run, and compare like with like; how long anything takes is not tested."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from bench import classifier, coordinator, graph, kernel, machine, memory, peak, report, scalar, stations, stk
from bench.processes import Watch, family_of, memory_of, name_of
from bow_sim.physics.parameters import Parameters

CASES = ("delta/Cremer, float64", "stiff/Cremer, float64")


@pytest.mark.parametrize(
    ("model", "dtype"), [("delta_cremer", "float64"), ("stiff_cremer", "float64"), ("delta_cremer", "float32")]
)
def test_the_plain_loop_does_the_same_work_as_the_kernel(model: str, dtype: str) -> None:
    p = Parameters(model=model, dtype=dtype, periods=20, f_init_ratio=1.5)
    scalar.check(p, {"f_asym": np.geomspace(0.5, 20, 5)})


def test_a_plain_loop_that_differed_would_be_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    p = Parameters(model="delta_cremer", periods=5)
    monkeypatch.setattr(scalar, "Block", lambda parameters, lanes: kernel.Block(parameters.replace(v_mid=0.21), lanes))
    with pytest.raises(ArithmeticError, match="differ"):
        scalar.check(p, {"f_asym": np.array([5.5])})


def test_the_count_of_operations_is_that_of_the_taps_and_of_a_step() -> None:
    # PHYSICS.md: 1 tap and a tail at the bridge, 1 or 30 at the nut, 10 and 10 of torsion
    assert peak.count(Parameters(model="delta_cremer")) == (9 + 22 + 2, 17 + 22 + 2, 1)
    assert peak.count(Parameters(model="stiff_cremer")) == (9 + 51 + 2, 17 + 51 + 2, 1)


def test_kernel_and_peaks_give_figures_for_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peak, "CHAINS", (4,))
    monkeypatch.setattr(peak, "TIMES", 100)
    allowed = os.sched_getaffinity(0)
    cases = {name: kernel.measure(kernel.CASES[name]._replace(cells=8), 1) for name in CASES}
    peaks = peak.measure(cases, 1, ["float64"])
    assert os.sched_getaffinity(0) == allowed
    assert all(case["ns"] > 0 and case["plain_ns"] > 0 for case in cases.values())
    assert all(one["of_fma_peak"] > 0 and one["of_bound"] > 0 for one in peaks["kernels"].values())
    assert peaks["kernels"].keys() == set(CASES)
    shares = [row.value for row in report.rows({"peak": peaks}) if row.section == "kernel against the peak"]
    assert shares == [f"share of the arithmetic bound {one['of_bound']:.0%}" for one in peaks["kernels"].values()]


def test_each_kernel_stands_beside_an_earlier_one_that_was_measured_in_turns() -> None:
    earlier = report.read(report.BASELINE)
    assert earlier["cases"].keys() <= kernel.CASES.keys()
    cases = {name: {"cells": 128, "ns": 1.0} for name in kernel.CASES}
    for row, name in zip(report.rows({"kernel": cases}), cases, strict=True):
        assert ("d42a378 " in row.beside) == (name in earlier["cases"])
        if name in earlier["cases"]:
            then, later = earlier["cases"][name]
            assert f"d42a378 {then:.2f} ns, {earlier['later']} {later / then:.2f} of it" in row.beside


def test_the_classifier_gives_figures_for_the_table() -> None:
    one = classifier.measure(10, repeats=1, cells=16)
    assert one["ns"] > 0 and one["first_chunk_ns"] > 0
    assert classifier.FIRST.keys() == classifier.CASES.keys()


def test_stk_is_left_out_with_a_message_where_it_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CXX", "false")
    assert "libstk-dev" in stk.measure()["skipped"]
    monkeypatch.delenv("CXX")
    monkeypatch.setenv("PATH", "/nowhere")
    assert "g++" in stk.measure()["skipped"]


def test_processes_are_found_and_named_whoever_started_them() -> None:
    script = "import subprocess, sys; subprocess.run(['sleep', '20'], check=False)"
    with subprocess.Popen([sys.executable, "-c", script, "__node:=simulator_2"]) as process:
        watch = Watch(process.pid, "")
        try:
            while len(family := family_of(process.pid)) < 2 or name_of(family[1]):  # before it is `sleep`
                time.sleep(0.01)
            assert name_of(process.pid) == "simulator_2"
            assert 0 < memory_of(process.pid)["pss"] <= memory_of(process.pid)["rss"]
        finally:
            for pid in reversed(family_of(process.pid)):
                os.kill(pid, 9)
            watch.stop()
    assert name_of(process.pid) == ""


@pytest.mark.usefixtures("ros_domain")
def test_a_map_through_a_standing_graph_is_measured_process_by_process(tmp_path: Path) -> None:
    kept = graph.standing(["x.count=4", "y.count=2", "periods=20"], 1, 1, tmp_path)
    assert kept.keys() == {"all", "verdicts"}
    assert kept["verdicts"]["over_bare"] > 0
    one = kept["all"]
    assert one["processes"].keys() == {"coordinator", "recorder", "classifier", "dashboard", "simulator_1"}
    assert 0 < one["blocks_s"] < one["wall_s"]
    assert one["over_bare"] == one["blocks_s"] / one["bare_kernel"]["wall_s"] == one["all_over_bare"][0]
    assert not list((tmp_path / "runs").iterdir())


@pytest.mark.usefixtures("ros_domain")
def test_a_sweep_is_measured_stage_by_stage_and_process_by_process(tmp_path: Path) -> None:
    one = graph.graph(4, 2, 1, tmp_path / "run", ["--periods", "2000"])  # all of them live for a while
    stages = list(one["stages_s"].values())
    assert stages == sorted(stages)
    assert {"bow sweep", "coordinator", "recorder", "classifier", "dashboard", "simulator_1"} <= one["processes"].keys()
    assert one["peak_pss_mb"] <= one["peak_rss_mb"]


def test_growth_counts_from_the_second_quarter_of_the_maps_to_the_last() -> None:
    rising = [100.0 + 4 * number for number in range(20)]
    assert memory.growth(rising)["growth_mb"] == pytest.approx(40.0)
    sawtooth = [100.0, 150.0] + [200.0, 220.0, 210.0] * 6
    assert memory.growth(sawtooth)["growth_mb"] == 0.0
    assert memory.growth([100.0])["growth_mb"] == 0.0


def test_a_result_becomes_one_table_and_one_page_that_name_the_machine(tmp_path: Path) -> None:
    used = {"cpu_s": 1.0, "peak_rss_mb": 100.0, "peak_pss_mb": 50.0}
    stages = dict.fromkeys(
        ("plan", "first_block_sent", "first_verdict", "last_block_done", "results_written", "end"), 1.0
    )
    result = {
        "machine": machine.describe(),
        "seconds": 60.0,
        "kernel": {CASES[0]: {"cells": 128, "ns": 4.0, "plain_ns": 22.0, "ratio": 5.5}},
        "stk": {"skipped": "libstk-dev is not here"},
        "classifier": {"stiff/Cremer, 100 periods": {"ns": 3.0, "first_chunk_ns": 4.0}},
        "graph": [
            {"width": 4, "height": 2, "simulators": 2, "skipped": "no room"},
            {
                "width": 4, "height": 2, "simulators": 1,
                "bare_kernel": {"wall_s": 1.0, "cpu_s": 1.0},
                "graph": {
                    "wall_s": 1.0, "plan_to_last_block_s": 1.0, "cells_per_s": 8.0, "cpu_s": 1.0, "stages_s": stages,
                    "peak_rss_mb": 1.0, "peak_pss_mb": 1.0, "processes": {"recorder": used},
                },
                "standing": {
                    "wall_s": 1.0, "blocks_s": 1.0, "cpu_s": 4.0, "processes": {"recorder": 4.0},
                    "bare_kernel": {"wall_s": 1.0, "cpu_s": 1.0}, "over_bare": 3.5, "all_over_bare": [3.4, 3.5, 3.6],
                },
                "verdicts_only": {
                    "wall_s": 1.0, "blocks_s": 1.0, "cpu_s": 2.0,
                    "bare_kernel": {"wall_s": 1.0, "cpu_s": 1.0}, "over_bare": 2.5, "all_over_bare": [2.5],
                },
                "over_bare": {"blocks": 1.0, "cpu": 1.0},
            },
        ],
        "memory": {"failed": "no answer"},
    }  # fmt: skip
    result = json.loads(json.dumps(result))
    shown = io.StringIO()
    report.table(result, Console(file=shown, width=160))
    assert shown.getvalue().count("┏") == 1
    page = tmp_path / "benchmarks.md"
    report.write_page(result, page)
    text = page.read_text()
    then, later = report.read(report.BASELINE)["cases"][report.KERNEL_OF_PRESET]
    for words in (
        "22.0 ns: 5.5 times; d42a378 ",
        "libstk-dev is not here",
        "no room",
        "3.00 ns a cell-sample | in the first chunk 4.00 ns; 0.53 of the time of d42a378",
        "| recorder | CPU 1.00 s |",
        "3.00 s beyond the bare",
        f"{3.5 * later / then:.2f} times that of d42a378",
        f"{2.5 * later / then:.2f} times that of d42a378 (goal: at most 1.5)",
        "FAILED",
    ):
        assert words in text
    assert result["machine"]["cpu"] in text
    assert result["machine"]["cpu"].split()[0] in shown.getvalue()


@pytest.mark.full
@pytest.mark.usefixtures("ros_domain")
def test_a_coordinator_with_simulators_that_compute_nothing_finishes_its_sweep(tmp_path: Path) -> None:
    one = coordinator.measure(3, (32, 16), tmp_path)
    assert (one["blocks"], one["simulators"]) == (8, 3)
    assert one["chunks"] > 7 * 20, "each block has all of its chunks answered"
    assert one["cpu_ms_a_chunk"] > 0 and one["rss_mb"] > 0
    assert [row.section for row in report.rows({"coordinator": [one]})] == ["coordinator"]


@pytest.mark.full
@pytest.mark.usefixtures("ros_domain")
def test_the_cost_of_a_chunk_is_told_for_every_role_of_two_stations(tmp_path: Path) -> None:
    one = stations.measure(2, ((16, 8), (32, 16)), tmp_path)
    assert one["chunks"] == [2 * 20, 8 * 20]
    assert set(one["chunk_ms"]) == set(stations.ROLES)
    for used in one["cpu_s"]:
        assert all(used[role] > 0 for role in stations.ROLES), "the processes of both stations are found"
    (row,) = report.rows({"stations": [one]})
    assert (row.section, row.what) == ("stations", "2 stations of one simulator")
