"""`bow verify` compares map.npz, report.json and ledger.jsonl with the bag."""

import json
from pathlib import Path

import numpy as np
import pytest
import recording
from recording import leave_all, quarantined_run, whats

from bow_sweep.record.verify import verify
from bow_sweep.record.verify_files import LEDGER, MAP, REPORT

SWEEP = recording.small_sweep()


def problems(run: Path) -> str:
    result = verify(run)
    assert result["ok"] == (not result["problems"])
    return whats(result)


def test_what_a_run_leaves_agrees_with_its_bag(run):
    assert problems(leave_all(run, SWEEP)) == ""


def test_what_is_left_of_a_run_with_a_quarantined_block_agrees_with_its_bag(tmp_path):
    quarantined_run(tmp_path)
    assert problems(leave_all(tmp_path, SWEEP, (1,))) == ""
    report = json.loads((tmp_path / REPORT).read_text())
    assert sum(report["regimes"].values()) == report["cells"]["done"] == 7


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("transient_periods", (1, 2)),
        ("regime", (0, 0)),
        ("correlation", (3, 2, 1)),
        ("confidence", (0, 1, 1)),
        ("count", (2, 3)),
    ],
)
def test_a_changed_value_of_the_map_is_found_and_its_cell_named(run, name, place):
    leave_all(run, SWEEP)
    with np.load(run / MAP) as file:
        arrays = dict(file)
    arrays[name][place] += 1
    np.savez(run / MAP, **arrays)
    cell = place[-2] * 4 + place[-1]
    assert problems(run) == f"{name} differs from the verdicts in 1 places, first at cell {cell}"


@pytest.mark.parametrize("name", ["f_asym", "f_init_ratio", "test_periods"])
def test_a_changed_axis_of_the_map_is_found(run, name):
    leave_all(run, SWEEP)
    with np.load(run / MAP) as file:
        arrays = dict(file)
    arrays[name][1] *= 2
    np.savez(run / MAP, **arrays)
    assert problems(run) == f"{name} differs from the plan"


def test_a_changed_limit_of_the_map_is_found_and_a_rounding_is_none(tmp_path):
    plane = ["x.name=bow_bridge", "x.scale=linear", "x.first=8", "x.last=11", "x.count=4", "y.name=f_asym",
             "y.scale=log", "y.first=2", "y.last=9", "y.count=3"]  # fmt: skip
    sweep = recording.small_sweep(*plane)
    recording.record(tmp_path, sweep)
    leave_all(tmp_path, sweep)
    assert problems(tmp_path) == ""
    with np.load(tmp_path / MAP) as file:
        arrays = dict(file)
    arrays["limit_schelleng_max_y"][1] *= 1 + 1e-14
    np.savez(tmp_path / MAP, **arrays)
    assert problems(tmp_path) == ""
    arrays["limit_schelleng_max_y"][1] *= 1.001
    np.savez(tmp_path / MAP, **arrays)
    assert problems(tmp_path) == "limit_schelleng_max_y differs from the plan"
    np.savez(tmp_path / MAP, **{name: each for name, each in arrays.items() if name != "limit_schelleng_max_y"})
    assert problems(tmp_path) == "holds no limit_schelleng_max_y"
    np.savez(tmp_path / MAP, **{name: each for name, each in arrays.items() if not name.startswith("limit_")})
    assert problems(tmp_path) == ""  # a map from before there were limits


def test_a_map_of_another_sweep_or_no_map_is_a_problem(run):
    leave_all(run, SWEEP)
    with np.load(run / MAP) as file:
        arrays = dict(file)
    np.savez(run / MAP, **{**arrays, "sweep_id": np.array("f" * 16)})
    assert problems(run) == "sweep_id differs from the plan"
    del arrays["slips"]
    np.savez(run / MAP, **{**arrays, "corners": arrays["corners"][:2]})
    assert "holds no slips" in problems(run)
    assert "corners is uint16 (2, 3, 4), should be uint16 (4, 3, 4)" in problems(run)
    (run / MAP).write_bytes(b"rubbish")
    assert "cannot be read" in problems(run)


def test_cells_of_a_block_given_up_may_hold_what_was_known_of_them_but_no_length(tmp_path):
    quarantined_run(tmp_path)
    leave_all(tmp_path, SWEEP, (1,))
    with np.load(tmp_path / MAP) as file:
        arrays = dict(file)
    assert np.isnan(arrays["transient_periods"].flat[5:10]).all()
    arrays["slips"][3].flat[7] += 1
    np.savez(tmp_path / MAP, **arrays)
    assert problems(tmp_path) == ""
    arrays["transient_periods"].flat[7] = 5
    np.savez(tmp_path / MAP, **arrays)
    assert "transient_periods differs from the verdicts in 1 places, first at cell 7" in problems(tmp_path)


def changed_report(run: Path, change) -> str:
    """Return the problems after a change of report.json."""
    leave_all(run, SWEEP)
    report = json.loads((run / REPORT).read_text())
    change(report)
    (run / REPORT).write_text(json.dumps(report))
    return problems(run)


def test_every_entry_of_the_report_that_the_bag_knows_is_held_against_it(run):
    leave_all(run, SWEEP)
    right = json.loads((run / REPORT).read_text())
    known = set(right) - {"attempts", "epoch", "wall_seconds", "cells_per_second", "versions", "machine", "picture"}
    known -= {"notes"}  # what this version of bow says of the settings
    assert {"cells", "settings", "helmholtz_fraction", "median_transient_periods", "playability"} <= known
    for name in known:
        (run / REPORT).write_text(json.dumps({**right, name: 7.5}))
        assert problems(run).startswith(f"{name} is 7.5, in the bag it is "), name
        (run / REPORT).write_text(json.dumps({key: value for key, value in right.items() if key != name}))
        assert problems(run) == ("" if name == "notes" else f"holds no {name}")  # reports of older runs have no notes


def test_a_changed_number_of_the_report_is_found(run):
    def change(report):
        report["playability"]["helmholtz"]["value"] += 1e-3

    assert "playability is" in changed_report(run, change)


@pytest.mark.parametrize("content", [b"", b"rubbish", b"[1]", b"[" * 10**5, b"\xff\xfe"])
def test_a_report_that_cannot_be_read_is_said_to_be_none(run, content):
    leave_all(run, SWEEP)
    (run / REPORT).write_bytes(content)
    assert "cannot be read" in problems(run)


def test_the_ledger_is_held_against_the_bag(run):
    ledger = leave_all(run, SWEEP) / LEDGER
    lines = ledger.read_text().splitlines()

    def said(*entries: str, tail: str = "") -> str:
        ledger.write_text("".join(f"{entry}\n" for entry in entries) + tail)
        return problems(run)

    assert said(*lines, tail='{"event": "disp') == ""  # cut off by a crash
    assert "is outstanding in the ledger, done in the plan of the bag" in said(*lines[:-1])
    for name, other in (("run_id", "f" * 16), ("settings", ["x.count=4"]), ("preset", "fig11d")):
        changed = json.dumps({**json.loads(lines[0]), name: other})
        assert f"{name} is {json.dumps(other)}, in the bag it is" in said(changed, *lines[1:])
    assert "line 1 is no entry" in said("rubbish", *lines)
    assert "does not begin with the plan" in said(*lines[1:])
