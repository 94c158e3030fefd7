"""Replay = live: a bag gives the same verdicts through the same core."""

import subprocess
import sys

import numpy as np
import pytest
import recording

from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.physics.errors import ParameterError
from bow_sweep.record.bag import BagError, bag_files
from bow_sweep.record.replay import changed, load_verdicts, replay

SWEEP = recording.small_sweep()


def test_the_same_thresholds_give_the_recorded_verdicts(run):
    before = sorted(path.name for path in run.iterdir())
    result = replay(run)
    assert result["ok"]
    assert result["chunks"] == result["equal"] == 12
    assert result["classifier"] == result["recorded_classifier"] == SWEEP.thresholds.hash
    assert result["file"] is None
    assert sorted(path.name for path in run.iterdir()) == before


def test_other_thresholds_give_a_verdict_set_beside_the_old_one(run):
    bag = bag_files(run / "bag")[0].read_bytes()
    result = replay(run, settings=["correlation=0.5", "corner=0.35"])
    assert result["ok"]
    assert result["equal"] < result["chunks"]
    assert result["file"] == str(run / f"verdicts-{result['classifier']}.npz")
    with np.load(result["file"]) as file:
        assert str(file["classifier"]) == result["classifier"]
        assert file["tested"].all()
        assert not np.array_equal(file["regime"], load_verdicts(run)["regime"])
        assert np.array_equal(file["correlation"], load_verdicts(run)["correlation"], equal_nan=True)
    assert bag_files(run / "bag")[0].read_bytes() == bag
    assert result["classifier"] == Thresholds(correlation=0.5, corner=0.35).hash


def test_the_layers_of_the_recorded_verdicts(recorded):
    layers = load_verdicts(recorded)
    assert layers["tested"].all()
    for name, kind in {"correlation": "f4", "period": "f4", "slips": "u2", "corners": "u2", "regime": "u1"}.items():
        assert layers[name].shape == (4, 12)
        assert layers[name].dtype == kind
    verdict = recording.cdr.decode("Verdicts", recording.chunks(SWEEP, 1)[2].verdicts)
    assert np.array_equal(layers["corners"][2, 5:10], verdict["corners"])


def test_what_is_not_recorded_is_not_tested(tmp_path):
    session = recording.session(tmp_path / "run", SWEEP)
    for topic, data in recording.chunks(SWEEP, 1)[0].items():
        session.take(topic, data, 1)
    session.commit(2)
    layers = load_verdicts(tmp_path / "run")  # while it is being written
    session.abandon()
    assert layers["tested"].sum() == 5
    assert layers["tested"][0, 5:10].all()
    assert (layers["regime"][~layers["tested"]] == 255).all()
    assert np.isnan(layers["correlation"][~layers["tested"]]).all()


def test_a_damaged_bag_is_not_replayed(run):
    path = bag_files(run / "bag")[0]
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    with pytest.raises(BagError, match="`bow verify` tells more"):
        replay(run)


def test_changes_of_thresholds_begin_at_those_of_the_run_or_at_a_preset():
    mine = Thresholds(correlation=0.9)
    assert changed(mine, ["slip=0.05"]) == Thresholds(correlation=0.9, slip=0.05)
    assert changed(mine, ["classifier.slip=0.05"]) == Thresholds(correlation=0.9, slip=0.05)
    assert changed(mine, ["preset=trial", "slip=0.05"]) == Thresholds(slip=0.05, corner=0.4)
    with pytest.raises(ParameterError, match=r"classifier\.slop"):
        changed(mine, ["slop=1"])


@pytest.mark.parametrize("module", ["verify", "replay", "recover", "session"])
def test_the_record_is_read_without_ros(module):
    code = f"import sys, bow_sweep.record.{module}; assert not {{'rclpy', 'rerun'}} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)


def test_the_recorder_needs_no_compiler():
    """It would cost every start a second, and 90 MB."""
    code = "import sys, bow_sweep.record.node; assert 'numba' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)
