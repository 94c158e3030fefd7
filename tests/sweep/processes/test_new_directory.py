"""A run directory is used by one process, and removed where no run began."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from bow_sweep.processes.new_directory import create_directory, open_directory
from bow_sweep.run.directory import LEDGER, RunError


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_many_at_the_same_second_get_a_directory_each(folder: Path) -> None:
    code = (
        "from bow_sweep.processes.new_directory import create_directory; owned = create_directory(None, 'fig')\n"
        "print(owned.directory); (owned.directory / 'x').mkdir()"
    )
    processes = [subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) for _ in range(5)]
    places = {process.communicate()[0] for process in processes}
    assert [process.returncode for process in processes] == [0] * 5
    assert len(places) == 5
    assert all(place.startswith(f"{folder}/runs/fig-") for place in places)


def test_names_are_numbered_where_others_have_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("time.strftime", lambda _: "now")
    names = [create_directory(None, "fig").directory.name for _ in range(3)]
    assert names == ["fig-now", "fig-now-2", "fig-now-3"]


def test_one_directory_is_for_one_process(folder: Path) -> None:
    first = create_directory(folder / "run", "fig")
    with pytest.raises(RunError, match=r"--out .*another process is at work on this run as its supervisor"):
        create_directory(folder / "run", "fig")
    assert not first.release()
    assert not (folder / "run").exists()
    create_directory(folder / "run", "fig").release()


def test_nothing_is_left_where_no_run_began(folder: Path) -> None:
    held = create_directory(Path("a/b/run"), "fig")
    (held.directory / "log").mkdir()
    (held.directory / "log" / "recorder.log").touch()
    (held.directory / "campaign.json").touch()
    (held.directory / "study.yaml").touch()
    (held.directory / "fig11a" / "log").mkdir(parents=True)
    assert not held.release(held.directory / "fig11a")
    assert list(folder.iterdir()) == []


def test_a_directory_of_the_user_stays(folder: Path) -> None:
    (folder / "run").mkdir()
    held = create_directory(Path("run"), "fig")
    (held.directory / "mine.txt").touch()
    held.release()
    assert [path.name for path in (folder / "run").iterdir()] == ["mine.txt"]


def test_a_run_that_began_stays() -> None:
    held = create_directory(Path("run"), "fig")
    (held.directory / LEDGER).touch()
    assert held.release()
    assert (held.directory / LEDGER).exists()
    again = open_directory(held.directory)
    with pytest.raises(RunError, match="at work on this run as its supervisor"):
        open_directory(held.directory)
    assert again.release()


def test_a_start_that_was_killed_can_be_given_again_and_not_resumed(folder: Path) -> None:
    (folder / "run" / "log").mkdir(parents=True)
    (folder / "run" / "log" / "recorder.log").touch()
    with pytest.raises(RunError, match="no run was begun here; give the sweep anew, with --out"):
        open_directory(folder / "run")
    create_directory(Path("run"), "fig").release()
    (folder / "other" / "log").mkdir(parents=True)
    (folder / "other" / "log" / "of the user").touch()
    with pytest.raises(RunError, match="--out other: is not empty; choose a new one, or an empty one"):
        create_directory(Path("other"), "fig")


def test_resuming_removes_nothing(folder: Path) -> None:
    (folder / "log").mkdir()
    (folder / "log" / "x.log").touch()
    (folder / "bag").mkdir()
    assert open_directory(folder).release()
    assert (folder / "log" / "x.log").exists()


@pytest.mark.parametrize("name", ["file", "file/run", "full/run", "\udcff"])
def test_what_cannot_be_is_refused_by_the_name_that_was_given(folder: Path, name: str) -> None:
    (folder / "file").touch()
    (folder / "full").mkdir()
    (folder / "full" / "run").mkdir()
    (folder / "full" / "run" / "x").touch()
    before = sorted(folder.rglob("*"))
    with pytest.raises(RunError, match="--out ") as refusal:
        create_directory(Path(name), "fig")
    assert f"--out {name}: " in str(refusal.value)
    assert sorted(folder.rglob("*")) == before


def test_a_default_directory_that_cannot_be_made_speaks_of_no_option_that_was_not_given(folder: Path) -> None:
    (folder / "runs").touch()
    with pytest.raises(RunError) as refusal:
        create_directory(None, "fig")
    assert str(refusal.value).startswith("runs/: ")
    (folder / "runs").unlink()
    os.chdir("/proc")
    with pytest.raises(RunError, match=r"^runs/: cannot be written: .*; --out DIR puts the run somewhere else$"):
        create_directory(None, "fig")
