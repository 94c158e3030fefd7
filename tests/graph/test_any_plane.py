"""A plane of models and thresholds as a graph of processes: killed, resumed, verified, and the map of one process."""

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

SLIPS = [0.02, 0.05, 0.1, 0.13, 0.2, 0.25, 0.4, 0.5]
SETTINGS = ["x=model", "x.values=[stiff_cremer,raman,delta_cremer]", "y=classifier.slip", f"y.values={SLIPS}"]
SETTINGS += ["periods=50", "f_asym=3", "f_init_ratio=0.7"]
PLANE = ["fig11d", *(f"--set={line}" for line in SETTINGS)]
"""24 cells, each a block of its own."""


def test_killed_and_resumed_it_ends_verified_with_the_map_that_one_process_computes(tmp_path: Path) -> None:
    whole, run = run_sweep(tmp_path / "whole", *PLANE, "--no-dashboard"), tmp_path / "run"
    with halted(run, *PLANE) as sweep:
        sweep.wait_until(lambda: sweep.done_blocks() >= 4)
        sweep.children("coordinator")[0].kill()
        assert sweep.wait() == 1, sweep.text
    assert_gone_on_with(run, whole)
    account = verified(run)
    assert (account["cells"], account["chunks"]) == (24, 240)
    assert json.loads(bow("replay", str(run)).stdout)["ok"]
    planned = Sweep.from_spec("fig11d", SETTINGS)
    alone, found = map_arrays(MapFile.of(planned, compute(planned), "")), map_of(run)
    assert found["classifier.slip"].tolist() == SLIPS
    for name, values in found.items():
        if values.ndim >= 2:
            np.testing.assert_array_equal(values, alone[name], err_msg=name)
    assert len(np.unique(found["slips"][-1])) > 1
    shown = bow("inspect", str(run), "--at", "model=raman,classifier.slip=0.2", "--no-view")
    assert shown.returncode == 0, shown.stderr
    assert "model raman, classifier.slip 0.2" in shown.stdout
    assert "checked           yes" in shown.stdout
