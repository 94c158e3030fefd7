"""A run directory can be read after crashes; a directory that is not one is refused."""

import json
import multiprocessing
from pathlib import Path

import numpy as np
import pytest

from bow_classifier.verdict.regimes import HELMHOLTZ, REGIMES
from bow_sim.atomic_files import replacing
from bow_sweep.coordinator.results import writing
from bow_sweep.maps.basin_map import Basin
from bow_sweep.plan.sweep import Sweep
from bow_sweep.processes.new_directory import never_began
from bow_sweep.run.directory import LEDGER, PICTURE, Run, RunError, digest, is_finished, read_ledger
from bow_sweep.run.ledger import State
from bow_sweep.run.lock import take

SMALL = ["x.count=4", "y.count=2", "block_cells=4", "periods=10"]


def small_run(directory: Path) -> Run:
    return Run.create(directory, "a" * 16, Sweep.from_spec("fig11d", SMALL))


def test_a_run_can_be_resumed_with_its_sweep_and_its_account(tmp_path: Path) -> None:
    run = small_run(tmp_path / "run")
    run.record([{"event": "dispatched", "block": 1, "attempt": 3, "epoch": 1}, {"event": "done", "block": 0}])
    run.close()
    again = Run.resume(tmp_path / "run")
    assert (again.run_id, again.sweep.sweep_id) == (run.run_id, run.sweep.sweep_id)
    assert again.accounts() == {"planned": 8, "done": 4, "quarantined": 0, "outstanding": 4}
    assert again.ledger.blocks[1].attempt == 3
    assert again.ledger.epoch == 2
    again.close()
    third = Run.resume(tmp_path / "run")
    assert third.ledger.epoch == 3
    third.close()


@pytest.mark.parametrize("torn", [b'{"event": "done", "bl', b"\x00\xff", b"{"])
def test_a_line_cut_off_by_a_crash_is_left_out_and_the_next_entry_begins_a_line(tmp_path: Path, torn: bytes) -> None:
    small_run(tmp_path / "run").close()
    path = tmp_path / "run" / LEDGER
    path.write_bytes(path.read_bytes() + torn)
    run = Run.resume(tmp_path / "run")
    run.record([{"event": "done", "block": 1}])
    run.close()
    last = read_ledger(tmp_path / "run")[-1]
    assert (last["event"], last["block"]) == ("done", 1)


def test_a_damaged_line_is_named(tmp_path: Path) -> None:
    run = small_run(tmp_path / "run")
    run.record([{"event": "done", "block": 1}])
    run.close()
    path = tmp_path / "run" / LEDGER
    lines = path.read_bytes().split(b"\n")
    path.write_bytes(b"\n".join([lines[0], b"garbage", *lines[1:]]))
    with pytest.raises(RunError, match="line 2"):
        Run.resume(tmp_path / "run")


def test_a_directory_without_a_run_and_one_with_a_run_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"ledger\.jsonl"):
        Run.resume(tmp_path)
    small_run(tmp_path / "run").close()
    with pytest.raises(RunError, match="holds a run already"):
        small_run(tmp_path / "run")


def test_a_run_is_not_resumed_with_another_kernel(tmp_path: Path) -> None:
    small_run(tmp_path / "run").close()
    path = tmp_path / "run" / LEDGER
    plan = json.loads(path.read_text())
    plan["fingerprint"] = "other"
    path.write_text(json.dumps(plan) + "\n")
    with pytest.raises(RunError, match="other"):
        Run.resume(tmp_path / "run")


def _try_lock(directory: str, answers: "multiprocessing.Queue[str]") -> None:
    try:
        take(Path(directory), "coordinator")
        answers.put("got it")
    except RunError as error:
        answers.put(str(error))


def test_two_processes_do_not_lock_the_same_run(tmp_path: Path) -> None:
    run = small_run(tmp_path / "run")
    context = multiprocessing.get_context("spawn")
    answers: multiprocessing.Queue[str] = context.Queue()
    process = context.Process(target=_try_lock, args=(str(tmp_path / "run"), answers))
    process.start()
    assert "at work on this run as its coordinator" in answers.get(timeout=60)
    process.join()
    run.close()


def test_the_report_accounts_for_every_cell(tmp_path: Path) -> None:
    run = small_run(tmp_path / "run")
    run.ledger.blocks[0].state = State.DONE
    run.ledger.blocks[1].state = State.QUARANTINED
    run.quarantined[1] = "poison"
    report = run.report(Basin(4, 2, 2), 1.0, {})
    run.close()
    assert report == json.loads((tmp_path / "run" / "report.json").read_text())
    cells = report["cells"]
    assert cells["planned"] == cells["done"] + cells["quarantined"] + cells["outstanding"] == 8
    assert report["quarantined_blocks"] == {"1": "poison"}
    assert report["samples"] == 4 * 10 * 139
    assert {"numpy", "numba", "llvmlite", "python"} <= set(report["versions"])


def test_a_file_is_replaced_completely_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "f"
    with replacing(path) as file:
        file.write(b"old")

    def interrupted() -> None:
        with replacing(path) as file:
            file.write(b"ne")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def verdict(regime: list[int]) -> dict:
    cells = len(regime)
    return {
        "correlation": np.ones(cells, np.float32),
        "period": np.full(cells, 139, np.float32),
        "slips": np.full(cells, 5),
        "corners": np.full(cells, 5),
        "regime": np.array(regime, np.uint8),
        "confidence": np.ones(cells, np.float32),
        "beat": np.full(cells, np.nan, np.float32),
        "transient": np.full(cells, np.nan, np.float32),
    }


def test_transient_length_is_the_first_test_passed_and_a_later_failure_does_not_change_it() -> None:
    other = REGIMES.index("aperiodic")
    basin = Basin(3, 1, 3)
    assert np.isnan(basin.transient_periods).all()
    cells = np.arange(3)
    for test, regimes in enumerate([[other, HELMHOLTZ, other], [HELMHOLTZ, other, other], [HELMHOLTZ, other, other]]):
        basin.take(test, cells, verdict(regimes))
        basin.take(test, cells, verdict(regimes))
    np.testing.assert_array_equal(basin.transient_periods, [10, 5, 0])
    np.testing.assert_array_equal(basin.tested, 3)
    assert basin.helmholtz_fraction() == pytest.approx(2 / 3)
    assert basin.regime_counts()[other] == 2
    assert basin.regime_counts().sum() == 3


def test_results_that_cannot_be_written_are_an_error_with_a_remedy(tmp_path: Path) -> None:
    what = r"No space left on device; every block is done and in the bag: make room, then resume"
    with pytest.raises(RunError, match=what), writing(tmp_path):
        raise OSError(28, "No space left on device", "map.png")


def test_the_report_has_the_hash_of_its_picture(tmp_path: Path) -> None:
    run = small_run(tmp_path / "run")
    assert run.report(Basin(4, 2, 2), 1.0, {})["picture"] is None
    (tmp_path / "run" / PICTURE).write_bytes(b"picture")
    assert run.report(Basin(4, 2, 2), 1.0, {})["picture"] == digest(tmp_path / "run" / PICTURE)
    run.close()


def test_a_block_that_was_reopened_and_is_done_again_is_settled(tmp_path: Path) -> None:
    run = small_run(tmp_path / "run")
    events = [("done", 0), ("done", 1), ("reopened", 0)]
    run.record([{"event": event, "block": block} for event, block in events])
    run.report(Basin(4, 2, 2), 1.0, {})
    assert not is_finished(tmp_path / "run", read_ledger(tmp_path / "run"))
    run.record([{"event": "done", "block": 0}])
    assert is_finished(tmp_path / "run", read_ledger(tmp_path / "run"))
    run.close()


def test_a_new_ledger_appears_together_with_its_plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []

    def killed_here(source: Path, target: Path) -> None:
        seen.append((Path(target).name, Path(target).exists()))
        raise KeyboardInterrupt

    monkeypatch.setattr("os.replace", killed_here)
    with pytest.raises(KeyboardInterrupt):
        small_run(tmp_path)
    assert seen == [("ledger.jsonl", False)]
    assert not (tmp_path / "ledger.jsonl").exists()
    assert never_began(tmp_path)
