"""The check of a run at its end, of which most is done before the report is written."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
import recording
from recording import leave_all, whats

from bow_sweep.record import verify as verifying
from bow_sweep.record.bag import bag_files
from bow_sweep.record.verify import SelfCheck
from bow_sweep.record.verify_files import LEDGER, MAP, REPORT

SWEEP = recording.small_sweep()


@pytest.fixture
def begun(run: Path, monkeypatch: pytest.MonkeyPatch) -> SelfCheck:
    """A check that was begun before the report was there."""
    leave_all(run, SWEEP)
    report = (run / REPORT).read_bytes()
    (run / REPORT).unlink()
    check = SelfCheck(run, whole=False)
    assert check.begin()
    (run / REPORT).write_bytes(report)
    reads = verifying.read_run
    monkeypatch.setattr(verifying, "read_run", lambda *given: check.__dict__.update(read_again=True) or reads(*given))
    return check


def was_read_again(check: SelfCheck) -> bool:
    return "read_again" in vars(check)


def test_a_run_that_holds_is_read_once(begun: SelfCheck) -> None:
    assert begun.end() == {"ok": True, "problem_count": 0, "problems": [], "unseen": {}}
    assert not was_read_again(begun)


def test_what_the_report_says_is_compared_when_it_is_there(begun: SelfCheck, run: Path) -> None:
    report = json.loads((run / REPORT).read_text())
    report["cells"]["done"] += 1
    (run / REPORT).write_text(json.dumps(report))
    result = begun.end()
    assert not result["ok"]
    assert "cells is" in whats(result)
    assert not was_read_again(begun)


@pytest.mark.parametrize("name", ["bag", LEDGER, MAP])
def test_what_changes_after_the_beginning_is_found(begun: SelfCheck, run: Path, name: str) -> None:
    if name == "bag":
        os.truncate(bag_files(run / "bag")[0], 1000)
    elif name == LEDGER:
        (run / LEDGER).write_text("rubbish\n")
    else:
        with np.load(run / MAP) as file:
            arrays = dict(file)
        arrays["regime"][0, 0] += 1
        np.savez(run / MAP, **arrays)
    result = begun.end()
    assert not result["ok"]
    assert any(name in problem["file"] for problem in result["problems"])
    assert was_read_again(begun)


def test_what_does_not_hold_at_the_beginning_is_told_in_the_end(run: Path) -> None:
    leave_all(run, SWEEP)
    (run / REPORT).unlink()
    (run / LEDGER).write_text("rubbish\n")
    check = SelfCheck(run, whole=False)
    assert check.begin()
    assert not check.end()["ok"]


def test_without_a_map_it_has_not_begun_and_a_whole_or_large_one_does_not_begin(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    leave_all(run, SWEEP)
    (run / REPORT).unlink()
    monkeypatch.setattr(verifying, "EARLY_BYTES", 0)
    large, whole, early = SelfCheck(run, whole=False), SelfCheck(run, whole=True), SelfCheck(run, whole=False)
    assert large.begin()
    assert whole.begin()
    (run / MAP).unlink()
    assert not early.begin()
    for check in (large, whole, early):
        assert check._begun is None
        assert check.end()["ok"]
