"""`bow station` sees whether the run is over that it is to join."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from split_runs import split

from bow_sweep.cli import main
from bow_sweep.cli.station import _was_closed
from bow_sweep.record.bag import bag_files
from bow_sweep.record.recover import recover


def test_a_run_that_is_finished_is_not_joined(
    complete: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["station", "lab", "--run", str(complete), "--out", str(tmp_path / "out")]) == 0
    assert "the run is over, there is nothing to join" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_bag_of_a_station_says_whether_the_run_was_closed(complete: Path, tmp_path: Path) -> None:
    bag = split(complete, tmp_path / "run", {"": [0], "lab": [1, 2]}) / "bag" / "lab"
    assert _was_closed(bag)
    path = bag_files(bag)[0]
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert not _was_closed(bag)
    assert recover(tmp_path / "run")
    assert not _was_closed(bag)
    shutil.rmtree(bag)
    assert not _was_closed(bag)
