"""The check by the index, at the end of a sweep, finds the same as reading everything."""

import json
import shutil

import numpy as np
import pytest
import recording
from small_graph import SmallGraph

from bow_sweep.record.bag import bag_files
from bow_sweep.record.bag_contents import Survey
from bow_sweep.record.index_contents import IndexSurvey
from bow_sweep.record.mcap_reader import Scan
from bow_sweep.record.verify import verify

SWEEP = recording.small_sweep()


def check(run):
    return verify(run, classify=False, index=True)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A run that was interrupted once, in two files."""
    run = tmp_path_factory.mktemp("index") / "run"
    SmallGraph(run, SWEEP, cut_after=5).run()
    SmallGraph(run, SWEEP, again=True).run()
    assert len(bag_files(run / "bag")) == 2
    return run


@pytest.fixture
def run(finished, tmp_path):
    return shutil.copytree(finished, tmp_path / "run")


def test_the_index_tells_what_reading_everything_tells(finished):
    by_index, read = IndexSurvey(finished / "bag").read(), Survey(finished / "bag").read()
    for name in ("receipts", "attempts", "epoch", "first", "last", "gaps", "noted", "version", "files"):
        assert getattr(by_index, name) == getattr(read, name), name
    assert by_index.places == read.places
    assert {k: (v.checksum, v.chunk_checksum) for k, v in by_index.verdicts.items()} == {
        k: (v.checksum, v.chunk_checksum) for k, v in read.verdicts.items()
    }
    assert check(finished)["ok"]
    assert check(finished)["cells"] == 12


def test_it_does_not_read_the_waveforms(run):
    path = bag_files(run / "bag")[0]
    scan = Scan(path)
    wave = next(m for m in scan.messages() if len(m.data) > 10_000)
    content = bytearray(path.read_bytes())
    content[wave.offset + 5000] ^= 1
    path.write_bytes(content)
    assert check(run)["ok"]
    assert not verify(run)["ok"]


@pytest.mark.parametrize("name", ["bag_0.mcap", "bag_1.mcap"])
def test_a_file_that_is_gone_or_torn_is_a_problem(run, name):
    path = run / "bag" / name
    content = path.read_bytes()
    for changed in (content[:-1], content[: len(content) // 2], b"", bytes(len(content))):
        path.write_bytes(changed)
        assert not check(run)["ok"]
    path.unlink()
    assert not check(run)["ok"]


def test_what_lies_beside_is_held_against_the_bag(run):
    with np.load(run / "map.npz") as file:
        arrays = dict(file)
    arrays["transient_periods"][0, 0] += 5
    np.savez(run / "map.npz", **arrays)
    report = json.loads((run / "report.json").read_text())
    report["cells"]["done"] = 11
    (run / "report.json").write_text(json.dumps(report))
    ledger = (run / "ledger.jsonl").read_text().splitlines()
    (run / "ledger.jsonl").write_text("\n".join(line for line in ledger if '"done", "block": 2' not in line) + "\n")
    assert {problem["file"] for problem in check(run)["problems"]} == {"map.npz", "report.json", "ledger.jsonl"}
