"""A graph that stays, and a station of another machine: it has its part in every run."""

import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from graph import PATIENCE_S, assert_same_map, bow, entries_of, gated, run_sweep, stations_of, until, verified
from machines import FAR, NEAR, Machines

pytestmark = [pytest.mark.full, pytest.mark.usefixtures("ros_domain")]

LONG = ["fig11d", "--nx", "64", "--ny", "96", "--set", "block_cells=32"]
"""192 blocks of 20 chunks."""

SHARE = 5
"""Blocks that the simulator of each machine has done before the run goes on."""


def test_a_station_of_another_machine_is_in_all_runs_of_a_standing_graph(
    two: Machines, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    alone = run_sweep(tmp_path / "alone", *LONG, "--own-graph")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    root, log, gate = tmp_path / "lab", tmp_path / "lab.log", tmp_path / "gate"
    program = [sys.executable, "-m", "gated_simulator"]
    options = ["--simulators", "1", "--no-dashboard", "--network", "SUBNET", "--root", str(tmp_path / "root")]
    with gated(gate), open(log, "wb") as output:
        line = re.search("join with: (.*) bow (station NAME .*)", two.run(NEAR, *program, "up", *options))
        assert line
        station = f"{' '.join(program)} {line[2].replace('NAME', 'lab')} --network SUBNET --simulators 1 --out {root}"
        words = f"exec env {line[1]} {station}"
        far = subprocess.Popen(two.command(FAR, "sh", "-c", words), stdout=output, stderr=output)

    def lab_is_heard() -> bool:
        assert far.poll() is None, log.read_text()
        status = subprocess.run(two.command(NEAR, "bow", "status", "--json"), stdout=subprocess.PIPE, check=False)
        return status.stdout.count(b'"lab/') >= 3

    try:
        until(lab_is_heard, "the station is not heard")
        for run in (tmp_path / "one", tmp_path / "two"):
            gate.write_text(str(20 * SHARE + 10))
            sweep = subprocess.Popen(two.command(NEAR, "bow", "sweep", *LONG, "--no-dashboard", "--out", str(run)))
            for name in ("", "lab"):
                until(lambda: sweep.poll() is not None or stations_of(run)[name] >= SHARE, "a block")  # noqa: B023
            gate.unlink()
            assert sweep.wait(PATIENCE_S) == 0
            share = stations_of(run)["lab"]
            assert SHARE <= share <= 192 - SHARE
            assert {name: len(blocks) for name, blocks in verified(run)["unseen"].items()} == {"lab": share}
            assert_same_map(alone, run)
            collected = bow("collect", str(run), str(root / entries_of(run)[0]["run_id"]))
            assert collected.returncode == 0, collected.stderr
            report = verified(run)
            assert report["unseen"] == {}
            assert report["verdicts_equal"] == report["chunks_planned"]
        two.run(NEAR, "bow", "down")
        assert far.wait(PATIENCE_S) == 0, log.read_text()
        assert "the graph has ended" in log.read_text()
    finally:
        two.run(NEAR, "bow", "down")
        far.send_signal(signal.SIGINT)
        far.wait(PATIENCE_S)
