"""A graph that stays, and a station of another machine: it has its part in every run."""

import re
import signal
import subprocess
import time
from pathlib import Path

import pytest
from graph import PATIENCE_S, assert_same_map, bow, entries_of, run_sweep, stations_of, verified
from machines import FAR, NEAR, Machines

pytestmark = [pytest.mark.full, pytest.mark.usefixtures("ros_domain")]

LONG = ["fig11d", "--nx", "64", "--ny", "96", "--set", "block_cells=32"]


def test_a_station_of_another_machine_is_in_all_runs_of_a_standing_graph(
    two: Machines, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    alone = run_sweep(tmp_path / "alone", *LONG, "--own-graph")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    root, log = tmp_path / "lab", tmp_path / "lab.log"
    options = ["--simulators", "1", "--no-dashboard", "--network", "SUBNET"]
    line = re.search("join with: (.*)", two.run(NEAR, "bow", "up", *options, "--root", str(tmp_path / "root")))
    assert line
    words = f"exec env {line[1].replace('NAME', 'lab')} --network SUBNET --simulators 1 --out {root}"
    with open(log, "wb") as output:
        far = subprocess.Popen(two.command(FAR, "sh", "-c", words), stdout=output, stderr=output)
    try:
        deadline = time.monotonic() + PATIENCE_S
        while two.run(NEAR, "bow", "status", "--json").count('"lab/') < 3:
            assert far.poll() is None, log.read_text()
            assert time.monotonic() < deadline, log.read_text()
        for run in (tmp_path / "one", tmp_path / "two"):
            two.run(NEAR, "bow", "sweep", *LONG, "--no-dashboard", "--out", str(run))
            share = stations_of(run)["lab"]
            assert 5 <= share <= 187
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
