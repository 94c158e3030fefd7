"""`bow collect` brings the bags of stations to the other bags of their run."""

import os
import shutil
import signal
import subprocess
import sys
import time

import psutil
import pytest
import recording
from graph import has_ended, until
from split_runs import split

from bow_sweep.cli import main
from bow_sweep.coordinator.resume import prepare
from bow_sweep.record.bag import COLLECTED, METADATA, bag_files
from bow_sweep.record.collect import CollectError, collect
from bow_sweep.record.recover import recover
from bow_sweep.record.verify import verify
from bow_sweep.run.errors import RunError
from bow_sweep.run.ledger_file import latest_states, read_ledger

RSYNC = """#!/bin/sh
# Stands in for rsync: the last but one argument is HOST:DIR/, the last DIR/.
echo "$@" >> "$SEEN"
for word; do before=$last; last=$word; done
case "$before" in *broken*) echo "rsync: connection unexpectedly closed" >&2; exit 12;; esac
cp -r "${before#*:}." "$last" 2>/dev/null || { echo "rsync: change_dir failed: No such file" >&2; exit 23; }
"""

SSH = """#!/bin/bash
# Stands in for ssh: runs the command here, and keeps what it sends.
while [[ $1 == -* ]]; do if [[ $1 == -o ]]; then shift; fi; shift; done
if [[ $1 == refuses ]]; then echo "Permission denied (publickey)." >&2; exit 255; fi
shift
bash -c "$*" | tee "$SENT"
"""


def put_on_path(monkeypatch, folder, name, text):
    """Write an executable file that is found before others of its name."""
    folder.mkdir()
    (folder / name).write_text(text)
    (folder / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")


@pytest.fixture
def parts(complete, tmp_path):
    """The coordinator's run with block 0, and a directory of station b with the others."""
    run = split(complete, tmp_path / "run", {"": [0], "b": [1, 2]})
    there = tmp_path / "there"
    (there / "bag").mkdir(parents=True)
    shutil.move(run / "bag" / "b", there / "bag" / "b")
    return run, there


def whole(run):
    found = verify(run)
    return found["ok"] and not found["unseen"]


def leftovers(run):
    return [path for path in (run / "bag").iterdir() if path.name.startswith(".")]


@pytest.mark.parametrize("inside", ["", recording.RUN])
def test_a_bag_is_brought_to_the_others(parts, tmp_path, inside):
    run, there = parts
    if inside:
        there = shutil.copytree(there, tmp_path / "out" / inside).parent
    assert verify(run)["unseen"] == {"b": [1, 2]}
    assert collect(run, str(there)).bags == ["b"]
    assert whole(run)
    assert collect(run, str(there)).known == ["b"]
    assert not leftovers(run)


def test_a_bag_that_has_grown_takes_the_place_of_its_beginning(parts):
    run, there = parts
    shutil.copytree(there / "bag" / "b", run / "bag" / "b")
    (path,) = bag_files(run / "bag" / "b")
    beginning = path.read_bytes()[:5000]
    path.write_bytes(beginning)
    said = []
    assert collect(run, str(there), said.append).bags == ["b"]
    assert whole(run)
    assert (run / "bag_aside" / "b.before" / "b_0.mcap").read_bytes() == beginning
    path.write_bytes(path.read_bytes() + b"more")
    assert collect(run, str(there)).known == ["b"]  # what is here is the longer one


def test_a_bag_that_is_still_written_can_be_collected_and_repaired(parts):
    run, there = parts
    (path,) = bag_files(there / "bag" / "b")
    path.write_bytes(path.read_bytes()[:-2000])
    said = []
    collect(run, str(there), said.append)
    assert "still being written" in said[-1]
    assert recover(run)["ok"]


def collect_beginning(run, there, share):
    """Collect the bag of station b as it was when it had this share of its bytes."""
    (path,) = bag_files(there / "bag" / "b")
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    collect(run, str(there))
    path.write_bytes(whole)
    recover(run)


@pytest.fixture(params=[0.6, 0.7], ids=["in part", "without a word that it is on the disk"])
def early(request, parts):
    """The run, with a copy of the bag of station b from before block 2 was done."""
    run, there = parts
    collect_beginning(run, there, request.param)
    return run, there


def test_what_a_station_has_recorded_since_its_bag_was_collected_is_not_seen_and_can_be_brought(early):
    run, there = early
    found = verify(run)
    assert found["ok"], recording.whats(found)
    assert found["unseen"] == {"b": [1, 2]}
    assert found["cells"] == found["cells_planned"] - found["cells_unseen"]
    assert collect(run, str(there)).bags == ["b"]
    assert whole(run)


def test_a_block_counts_from_another_bag_where_its_own_was_collected_before(complete, tmp_path):
    run = split(complete, tmp_path / "run", {"": [0, 1], "b": [1, 2]}, {1: "b"})
    shutil.move(run / "bag" / "b", tmp_path / "there" / "bag" / "b")
    collect_beginning(run, tmp_path / "there", 0.6)
    found = verify(run)
    assert found["ok"], recording.whats(found)
    assert found["unseen"] == {"b": [2]}


def test_a_bag_that_was_not_collected_lacks_what_it_does_not_hold(early):
    run, _ = early
    (run / "bag" / "b" / COLLECTED).unlink()
    found = verify(run)
    assert not found["unseen"]
    assert {problem.get("block") for problem in found["problems"]} >= {2}


def test_a_collected_bag_lacks_what_it_says_it_has(parts):
    run, there = parts
    collect(run, str(there))
    (path,) = bag_files(run / "bag" / "b")
    content = path.read_bytes()
    middle = len(content) * 2 // 3
    path.write_bytes(content[:middle] + bytes(5000) + content[middle + 5000 :])
    recover(run)
    found = verify(run)
    assert not found["unseen"]
    assert {problem.get("block") for problem in found["problems"] if problem["what"] == "missing"} == {2}


def test_a_run_is_not_resumed_before_the_rest_of_a_collected_bag_is_brought_or_called_lost(early):
    run, _ = early
    (run / "report.json").unlink()
    with pytest.raises(RunError, match="station b: blocks 1, 2\n"):
        prepare(run)
    prepare(run, lost=["b"])
    assert latest_states(read_ledger(run)) == {0: "done", 1: "reopened", 2: "reopened"}


def test_a_bag_of_another_run_is_refused_and_nothing_is_left_of_it(parts, tmp_path):
    run, _ = parts
    sweep = recording.small_sweep("v_mid=0.1")
    made = recording.session(tmp_path / "other", sweep)
    recording.finish(made, sweep)
    (tmp_path / "another" / "bag").mkdir(parents=True)
    shutil.move(tmp_path / "other" / "bag", tmp_path / "another" / "bag" / "c")
    with pytest.raises(CollectError, match=r"bag c: bag_0\.mcap is of run"):
        collect(run, str(tmp_path / "another"))
    assert sorted(path.name for path in (run / "bag").iterdir()) == ["bag_0.mcap", METADATA]


def test_files_that_are_neither_older_nor_newer_stay(parts):
    run, there = parts
    shutil.copytree(there / "bag" / "b", run / "bag" / "b")
    (path,) = bag_files(run / "bag" / "b")
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    with pytest.raises(CollectError, match="what is here stays"):
        collect(run, str(there))
    assert path.read_bytes() == content


def test_a_place_without_bags_is_refused(parts, tmp_path):
    run, there = parts
    shutil.rmtree(there / "bag" / "b")
    for source, what in ((there, "holds no bag of a station"), (tmp_path / "nowhere", "is no directory")):
        with pytest.raises(CollectError, match=what):
            collect(run, str(source))
    with pytest.raises(CollectError, match="is no directory"):
        collect(tmp_path / "nowhere", str(there))
    assert not leftovers(run)


def test_what_a_killed_process_has_left_is_removed(parts):
    run, there = parts
    (run / "bag" / ".collect-abc").mkdir()
    collect(run, str(there))
    assert not leftovers(run)
    assert whole(run)


def test_another_machine_is_asked_by_rsync(parts, tmp_path, monkeypatch, capsys):
    run, there = parts
    put_on_path(monkeypatch, tmp_path / "bin", "rsync", RSYNC)
    monkeypatch.setenv("SEEN", str(tmp_path / "seen"))
    out = shutil.copytree(there, tmp_path / "out" / recording.RUN).parent
    assert main(["collect", str(run), f"lab2:{out}"]) == 0  # rsync finds nothing at the first place
    assert whole(run)
    asked = (tmp_path / "seen").read_text().splitlines()
    assert f"lab2:{out}/bag/" in asked[0]
    assert f"lab2:{out}/{recording.RUN}/bag/" in asked[1]
    capsys.readouterr()
    assert main(["collect", str(run), "lab3:/broken"]) == 1
    assert "lab3:/broken: rsync could not copy: rsync: connection unexpectedly closed" in capsys.readouterr().err
    assert whole(run)


def test_rsync_itself_brings_what_is_not_here(parts, tmp_path, monkeypatch, capsys):
    """A bag that has grown replaces its beginning, of which nothing is sent again."""
    if shutil.which("rsync") is None:
        pytest.skip("there is no rsync here")
    run, there = parts
    put_on_path(monkeypatch, tmp_path / "bin", "ssh", SSH)
    sent = tmp_path / "sent"
    monkeypatch.setenv("SENT", str(sent))
    (path,) = bag_files(there / "bag" / "b")
    whole_bag = path.read_bytes()
    path.write_bytes(whole_bag[: len(whole_bag) // 2])
    assert main(["collect", str(run), f"lab2:{there}"]) == 0
    assert sent.stat().st_size > len(whole_bag) / 4
    path.write_bytes(whole_bag)
    assert main(["collect", str(run), f"lab2:{there}"]) == 0
    assert sent.stat().st_size < len(whole_bag) * 3 / 4
    assert whole(run)
    assert main(["collect", str(run), f"lab2:{there}"]) == 0
    assert sent.stat().st_size < 5000
    capsys.readouterr()
    for source, why in {
        f"lab2:{tmp_path}/nowhere": f'change_dir "{tmp_path}/nowhere/bag" failed: No such file or directory (2)\n',
        f"refuses:{there}": "could not copy: Permission denied (publickey).; rsync: ",
    }.items():
        assert main(["collect", str(run), source]) == 1
        assert why in capsys.readouterr().err
    assert whole(run)
    assert not leftovers(run)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_rsync_ends_with_the_command(parts, tmp_path, monkeypatch, number):
    """It would go on copying for nobody."""
    run, there = parts
    put_on_path(monkeypatch, tmp_path / "bin", "rsync", '#!/bin/sh\necho $$ > "$SEEN"\nexec sleep 600\n')
    seen = tmp_path / "seen"
    monkeypatch.setenv("SEEN", str(seen))
    command = [sys.executable, "-m", "bow_sweep", "collect", str(run), f"lab2:{there}"]
    with subprocess.Popen(command) as process:
        while not (seen.exists() and seen.read_text()):
            assert process.poll() is None
            time.sleep(0.01)
        copying = psutil.Process(int(seen.read_text()))
        process.send_signal(number)
    until(lambda: has_ended(copying), "rsync goes on")
    collect(run, str(there))
    assert not leftovers(run)


def test_what_is_still_missed_is_said(parts, tmp_path, complete, capsys):
    run, _ = parts
    other = split(complete, tmp_path / "with_c", {"c": [0]})
    assert main(["collect", str(run), str(other)]) == 0
    assert "not seen: 2 blocks of station b" in capsys.readouterr().err
