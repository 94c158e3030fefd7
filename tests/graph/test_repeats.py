"""A sweep with repeats as a graph of processes: killed, resumed, verified, and the map of a computation without it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from graph import assert_gone_on_with, bow, halted, map_of, run_sweep, verified

from bow_sweep.maps.in_process import compute
from bow_sweep.maps.map_file import MapFile, map_arrays
from bow_sweep.plan.sweep import Sweep

pytestmark = [pytest.mark.full, pytest.mark.usefixtures("ros_domain")]

SETTINGS = ["x.count=12", "y.count=6", "x.first=2", "x.last=14", "periods=50", "block_cells=12"]
SETTINGS += ["repeats=3", "jitter=0.05", "seed=11"]
REPEATED = ["fig11d", *(f"--set={line}" for line in SETTINGS)]
"""72 cells and 216 repeats in 24 blocks."""


def test_killed_and_resumed_it_ends_verified_with_the_map_that_one_process_computes(tmp_path: Path) -> None:
    whole, run = run_sweep(tmp_path / "whole", *REPEATED), tmp_path / "run"
    with halted(run, *REPEATED, chunks=85) as sweep:
        sweep.wait_until(lambda: sweep.done_blocks() >= 8)  # the cells themselves, and some repeats
        sweep.children("coordinator")[0].kill()
        assert sweep.wait() == 1, sweep.text
    assert_gone_on_with(run, whole)
    account = verified(run)
    assert (account["cells"], account["chunks"]) == (288, 240)
    again = json.loads(bow("replay", str(run)).stdout)
    assert again["ok"]
    planned = Sweep.from_spec("fig11d", SETTINGS)
    alone = MapFile.of(planned, compute(planned), "")
    assert alone.reliability is not None
    assert 0 < np.nanmean(alone.reliability.reliability) < 1
    for name, values in map_of(run).items():
        if values.ndim >= 2:
            np.testing.assert_array_equal(values, map_arrays(alone)[name], err_msg=name)
    report = json.loads((run / "report.json").read_text())
    assert report["repeats"] == again["repeats"]
    assert report["cells"] == {"planned": 288, "done": 288, "quarantined": 0, "outstanding": 0}
    assert (run / "map.png").is_file()
    shown = bow("inspect", str(run), "--cell", "40", "--repeat", "0", "--repeat", "3", "--no-view")
    assert shown.returncode == 0, shown.stderr
    assert "cell 256, repeat 3" in shown.stdout
    assert "parting" in shown.stdout
