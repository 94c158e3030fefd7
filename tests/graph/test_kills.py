"""SIGKILL one process of each role: the sweep goes on, or can be gone on with, and the account is exact."""

import os
import signal
from collections.abc import Iterable
from pathlib import Path

import pytest
from graph import (
    SMALL,
    TINY,
    assert_gone_on_with,
    assert_same_map,
    assert_survives_a_kill,
    halted,
    left_behind,
    orphans,
    verified,
)

from bow_sim.graph.shm_files import files_of

pytestmark = pytest.mark.usefixtures("ros_domain")


@pytest.mark.parametrize("role", ["simulator", "classifier", "recorder", "dashboard"])
def test_the_sweep_goes_on_by_itself_after_a_kill(role: str, undisturbed: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    assert_survives_a_kill(role, run, SMALL, 2, undisturbed)
    assert orphans(run) == []


def kinds_of(files: Iterable[str]) -> set[str]:
    return {Path(file).name.partition("_")[0] for file in files}


def test_a_killed_process_leaves_no_shared_memory_and_others_keep_theirs(tmp_path: Path) -> None:
    others = Path(f"/dev/shm/fastrtps_{os.getpid():016x}_el")  # not ours: nobody of the graph had it open
    others.touch()
    run = tmp_path / "run"
    try:
        with halted(run, *SMALL) as sweep:
            sweep.wait_until(lambda: sweep.done_blocks() >= 2)
            (first, *_) = sweep.children("simulator")  # it may start still, while another one works
            sweep.wait_until(lambda: kinds_of(files_of(first.pid)) >= {"fastrtps", "fast"})  # segments, lent
            files = files_of(first.pid)
            first.kill()
            sweep.go_on()
            assert sweep.wait() == 0, sweep.text
        assert left_behind(files) == set()
        assert others.exists()
    finally:
        others.unlink()


@pytest.mark.parametrize("role", ["simulator", "classifier", "recorder"])
def test_a_sweep_of_four_cells_does_not_hang(role: str, undisturbed_tiny: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    with halted(run, *TINY, chunks=1) as sweep:
        sweep.wait_until((run / "ledger.jsonl").exists)
        sweep.kill(role)
        sweep.go_on()
        assert sweep.wait() == 0, sweep.text
    verified(run)
    assert_same_map(undisturbed_tiny, run)


def test_without_its_coordinator_a_sweep_stops_and_can_be_gone_on_with(undisturbed: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    with halted(run, *SMALL) as sweep:
        sweep.wait_until(lambda: sweep.done_blocks() >= 2)
        sweep.kill("coordinator")
        assert sweep.wait() == 1, sweep.text
        assert f"bow sweep --resume {run}" in sweep.text
    assert orphans(run) == []
    assert_gone_on_with(run, undisturbed)


def test_a_killed_supervisor_takes_its_processes_with_it(undisturbed: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    with halted(run, *SMALL) as sweep:
        sweep.wait_until(lambda: sweep.done_blocks() >= 2)
        family = sweep.children()
        os.kill(sweep.process.pid, signal.SIGKILL)
        for process in family:
            process.wait(30)
    assert orphans(run) == []
    assert_gone_on_with(run, undisturbed)


def test_all_killed_at_once_can_be_gone_on_with(undisturbed: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    with halted(run, *SMALL) as sweep:
        sweep.wait_until(lambda: sweep.done_blocks() >= 2)
        family = [*sweep.children(), sweep.process]
        files = set[str]().union(*(files_of(process.pid) for process in family))
        for process in family:
            os.kill(process.pid, signal.SIGKILL)
        sweep.wait()
    assert files
    assert_gone_on_with(run, undisturbed)
    assert left_behind(files) == set()
