"""Verdicts with a long memory go through the whole graph, into the bag and out of it again."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from graph import bow, run_sweep, verified
from wolves import string_of_1983

from bow_sweep.maps.in_process import compute
from bow_sweep.maps.map_file import read_map_npz
from bow_sweep.plan.sweep import Sweep

pytestmark = [pytest.mark.full, pytest.mark.usefixtures("ros_domain")]


def replayed(run: Path) -> dict:
    """Return what `bow replay` says; its verdicts must be the recorded ones."""
    said: dict = json.loads(bow("replay", str(run)).stdout)
    assert said["ok"], said
    assert said["equal"] == said["chunks"]
    return said


def test_the_wolf_of_1983_is_found_in_a_sweep_and_verified_and_replayed(tmp_path: Path) -> None:
    swept = {"f_asym", "f_init_ratio"}
    settings = [line for line in string_of_1983(0.02, 30).settings() if line.partition("=")[0] not in swept]
    settings += ["x.first=1.6", "x.last=4.6", "x.count=8", "y.first=0.9", "y.last=1.1", "y.count=2", "block_cells=4"]
    plane = [word for setting in settings for word in ("--set", setting)]
    run = run_sweep(tmp_path / "run", *plane, "--simulators", "2")
    assert verified(run)["verdicts_equal"] == 4 * 80
    found = read_map_npz(run / "map.npz")
    wolves = found.regime == found.regime_names.index("wolf")
    assert np.count_nonzero(wolves) >= 4
    assert found.beat is not None
    assert ((found.beat[-1] > 9) & (found.beat[-1] < 20))[wolves].all()
    assert np.isnan(found.beat[-1][~wolves]).all()
    assert not (found.regimes[:29] == found.regime_names.index("wolf")).any()
    report = json.loads((run / "report.json").read_text())
    assert report["regimes"]["wolf"] == replayed(run)["regimes"]["wolf"] == np.count_nonzero(wolves)
    alone = compute(Sweep.from_spec("", settings))
    assert alone.layers["beat"].tobytes() == found.beat.reshape(80, 16).tobytes()
    cell = int(np.flatnonzero(wolves.ravel())[0])
    shown = bow("inspect", str(run), "--cell", str(cell), "--no-view", "--save", str(tmp_path / "cells.rrd")).stdout
    assert f"beat {found.beat[-1].ravel()[cell]:.1f} periods" in shown


def test_guettlers_transient_is_that_of_the_map_of_the_report_and_of_replay(tmp_path: Path) -> None:
    settings = ["gesture=guettler", "model=raman", "periods=40", "x.name=acceleration", "x.first=0.02", "x.last=2"]
    settings += ["x.count=12", "y.name=f_asym", "y.first=0.5", "y.last=8", "y.count=6", "block_cells=18"]
    plane = [word for setting in settings for word in ("--set", setting)]
    run = run_sweep(tmp_path / "run", *plane, "--simulators", "2")
    verified(run)
    found = read_map_npz(run / "map.npz")
    lengths = found.transient_periods
    assert found.transient is not None
    np.testing.assert_array_equal(found.transient[-1], lengths)
    assert np.any(lengths % 5 > 0)
    assert 0 < np.mean(lengths > 0) < 1
    report = json.loads((run / "report.json").read_text())
    assert report["perfect_fraction"] == np.mean((lengths > 0) & (lengths < 1))
    assert report["helmholtz_fraction"] == replayed(run)["helmholtz_fraction"] == np.mean(lengths > 0)
    alone = compute(Sweep.from_spec("", settings))
    np.testing.assert_array_equal(alone.transient_periods, lengths.ravel())
