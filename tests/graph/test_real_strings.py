"""A string, a bow and a body in SI units go through the whole graph, into the bag and out of it again."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import numpy as np
import pytest
from graph import bow, halted, map_of, orphans, run_sweep, sweeping, verified

from bow_sweep.cell.motion import motion
from bow_sweep.cell.run_cells import RunCells
from bow_sweep.maps.in_process import compute
from bow_sweep.maps.map_file import MapFile, read_map_npz
from bow_sweep.plan.sweep import Sweep

pytestmark = [pytest.mark.full, pytest.mark.usefixtures("ros_domain")]

PLANE = [
    *("--set", "string=cello_g_b", "--set", "v_unit=0.1", "--set", "hair=hair_soft", "--set", "friction=thermal"),
    *("--set", "body_modes=100/20/k0.01, 196/30/k0.02", "--set", "bridge=rigid", "--set", "periods=20"),
    *("--set", "x.name=beta", "--set", "x.first=0.04", "--set", "x.last=0.2", "--set", "x.scale=log"),
    *("--set", "y.name=force", "--set", "y.first=0.2", "--set", "y.last=3", "--set", "y.scale=log"),
    *("--nx", "6", "--ny", "4", "--simulators", "2", "--set", "block_cells=8"),
]


def test_a_plane_in_newton_is_recorded_judged_verified_and_computed_again(tmp_path: Path) -> None:
    run = run_sweep(tmp_path / "run", *PLANE)
    verified(run)
    plane = read_map_npz(run / "map.npz")
    assert (plane.x_name, plane.y_name) == ("beta", "force")
    assert plane.x == pytest.approx(np.geomspace(0.04, 0.2, 6))
    assert plane.values["friction"] == "thermal"
    assert "z_0=1.117" in json.loads((run / "report.json").read_text())["settings"]
    with RunCells(run) as cells:
        cell = cells.nearest({"beta": 0.1, "force": 1.0})
        recorded, computed = cells.record(cell, "bag"), cells.record(cell, "computed")
    assert recorded.checked and computed.checked
    assert recorded.bridge_force.tobytes() == computed.bridge_force.tobytes()
    assert recorded.parameters.beta == pytest.approx(plane.x[cell % 6])
    assert motion(recorded).same


MODE = [
    *("string=violin_a", "v_unit=0.1", "hair=hair_soft", "friction=thermal", "rosin=rosin_soft", "periods=60"),
    *("body=signature", "bridge=rigid", "block_cells=8", "x.count=16", "y.count=16"),
    *("x.name=body_3_ratio", "x.first=0.8", "x.last=1.25", "x.scale=linear"),
    *("y.name=force", "y.first=0.1", "y.last=2", "y.scale=log"),
]


def test_a_map_over_a_mode_that_was_killed_and_interrupted_is_gone_on_with_and_is_that_of_one_process(
    tmp_path: Path,
) -> None:
    own = Sweep.from_spec("", MODE)
    basin = compute(own)  # first, so that what a run waits for need not be compiled
    run = tmp_path / "run"
    arguments = [word for setting in MODE for word in ("--set", setting)]
    with halted(run, *arguments, "--simulators", "1", "--no-dashboard", chunks=30) as sweep:
        sweep.wait_until(lambda: sweep.done_blocks() >= 2)
        sweep.kill("simulator")  # the only one: nothing is computed until it is started again
        sweep.wait_until(lambda: "killed by SIGKILL" in sweep.text)
        sweep.process.send_signal(signal.SIGINT)
        assert sweep.wait() == 130, sweep.text
        assert 2 <= sweep.done_blocks() < 32
    assert orphans(run) == []
    with sweeping(run, "--resume", str(run), "--no-dashboard") as sweep:
        assert sweep.wait() == 0, sweep.text
    verified(run)
    again = bow("replay", str(run))
    assert again.returncode == 0, again.stderr
    report = json.loads((run / "report.json").read_text())
    assert report["attempts"] > 32
    assert report["notes"] == []
    assert report["settings"] == list(own.settings())
    alone = MapFile.of(own, basin, report["run_id"])
    plane = read_map_npz(run / "map.npz")
    assert plane.x_name == "body_3_ratio"
    for name in ("transient_periods", "regime", "correlation", "slips", "corners", "helmholtz"):
        np.testing.assert_array_equal(getattr(plane, name), getattr(alone, name), err_msg=name)
    assert len(np.unique(map_of(run)["regime"])) > 1


def test_a_plane_of_notes_begins_near_the_maximum_and_shows_its_limits(tmp_path: Path) -> None:
    plane = ["--set", "x.count=4", "--ny", "3", "--set", "periods=10", "--simulators", "2", "--set", "block_cells=8"]
    run = run_sweep(tmp_path / "run", "playability", *plane)
    verified(run)
    with np.load(run / "map.npz") as file:
        assert file["semitone"].tolist() == [0, 8, 16, 24]
        most, least = file["limit_schelleng_max_y"], file["limit_schelleng_min_y"]
    assert most == pytest.approx(np.full(4, 0.8023), rel=1e-3)
    assert (least < most).all() and np.ptp(least) > 0
    assert (run / "map.png").stat().st_size > 10_000
    report = json.loads((run / "report.json").read_text())
    assert report["si"]["speed"] == {"value": 0.1, "unit": "m/s"}
    assert "f_0" not in report["si"]  # each note has its own
    with RunCells(run) as cells:
        cell = cells.nearest({"semitone": 8, "force": 0.1})
        recorded, computed = cells.record(cell, "bag"), cells.record(cell, "computed")
    assert recorded.parameters.sample_rate == pytest.approx(139 * 196 * 2 ** (8 / 12))
    assert recorded.bridge_force.tobytes() == computed.bridge_force.tobytes()
    assert motion(recorded).same
