"""A run of two stations is killed whole; the bag of one is elsewhere; it is collected, and the run is finished."""

import json
import shutil
from pathlib import Path

import pytest
from graph import bow, halted, verified

from bow_sweep.record.bag import station_bags
from bow_sweep.run.ledger_file import done_at, read_leniently

pytestmark = [pytest.mark.full, pytest.mark.usefixtures("ros_domain")]

SWEEP = ["fig11d", "--nx", "32", "--ny", "32", "--set", "block_cells=32", "--no-dashboard", "--own-graph"]


def test_a_run_that_is_killed_whole_is_resumed_when_its_bags_are_collected(tmp_path: Path) -> None:
    run, there = tmp_path / "run", tmp_path / "there"
    with halted(run, *SWEEP, "--simulators", "2", "--stations", "2") as sweep:
        sweep.wait_until(lambda: set(done_at(read_leniently(run).entries).values()) == {"station_1", "station_2"})
        sweep.stop()
    before = done_at(read_leniently(run).entries)
    (there / "bag").mkdir(parents=True)
    shutil.move(run / "bag" / "station_2", there / "bag" / "station_2")
    refused = bow("sweep", "--resume", str(run), "--own-graph")
    assert refused.returncode == 2
    first = min(block for block, station in before.items() if station == "station_2")
    assert f"station_2: blocks {first}" in refused.stderr
    assert f"bow collect {run}" in refused.stderr
    collected = bow("collect", str(run), str(there))
    assert collected.returncode == 0, collected.stderr
    resumed = bow("sweep", "--resume", str(run), "--own-graph", "--no-dashboard", "--simulators", "1")
    assert resumed.returncode == 0, resumed.stderr
    assert set(station_bags(run)) == {"", "station_1", "station_2"}
    report = verified(run)
    assert (report["cells"], report["unseen"]) == (1024, {})
    assert report["verdicts_equal"] == report["chunks_planned"]
    after = done_at(read_leniently(run).entries)
    assert before.items() <= after.items(), "what was on the disk of the stations counts from there"
    again = bow("replay", str(run))
    assert json.loads(again.stdout)["equal"] == report["chunks_planned"], again.stderr
