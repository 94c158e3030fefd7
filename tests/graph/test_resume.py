"""`bow sweep --resume` after what befalls the files of a run: power cuts, copies, deleted files."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from graph import SMALL, assert_gone_on_with, bow, halted, run_sweep, verified

pytestmark = pytest.mark.usefixtures("ros_domain")


@pytest.fixture(scope="module")
def cut_off(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A run that was killed, all of it at once, and a copy that was made of it some blocks before."""
    folder = tmp_path_factory.mktemp("cut")
    run, older = folder / "run", folder / "older"
    with halted(run, *SMALL, "--no-dashboard") as sweep:
        sweep.wait_until(lambda: sweep.done_blocks() >= 2)
        shutil.copytree(run, older)
        sweep.let(130)
        sweep.wait_until(lambda: sweep.done_blocks() >= 6)
        sweep.stop()  # at once
    return run, older


def deleted(run: Path, _: Path) -> None:
    (run / "bag" / "bag_0.mcap").unlink()


def bag_deleted(run: Path, _: Path) -> None:
    shutil.rmtree(run / "bag")


def zeros_after_the_end(run: Path, _: Path) -> None:
    with open(run / "bag" / "bag_0.mcap", "ab") as file:
        file.write(bytes(4096))


def zeros_in_the_middle(run: Path, _: Path) -> None:
    path = run / "bag" / "bag_0.mcap"
    with open(path, "r+b") as file:
        file.seek(path.stat().st_size // 2)
        file.write(bytes(20_000))


def older_bag(run: Path, older: Path) -> None:
    shutil.copy(older / "bag" / "bag_0.mcap", run / "bag")


def older_ledger(run: Path, older: Path) -> None:
    shutil.copy(older / "ledger.jsonl", run)


def lost_ledger(run: Path, _: Path) -> None:
    (run / "ledger.jsonl").write_bytes(bytes(3000))


def torn_ledger_and_metadata(run: Path, _: Path) -> None:
    with open(run / "ledger.jsonl", "ab") as file:
        file.write(bytes(500) + b"\n{")
    (run / "bag" / "metadata.yaml").write_bytes(b"")


def copied_bag(run: Path, _: Path) -> None:
    shutil.copy(run / "bag" / "bag_0.mcap", run / "bag" / "bag_1.mcap")


OTHERS = (
    *(bag_deleted, zeros_after_the_end, zeros_in_the_middle, older_bag, older_ledger, lost_ledger),
    *(torn_ledger_and_metadata, copied_bag),
)


@pytest.mark.parametrize("befall", [deleted, *(pytest.param(other, marks=pytest.mark.full) for other in OTHERS)])
def test_a_cut_off_run_is_gone_on_with(
    cut_off: tuple[Path, Path], undisturbed: Path, tmp_path: Path, befall: Callable[[Path, Path], None]
) -> None:
    run, older = cut_off
    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    befall(copy, older)
    assert_gone_on_with(copy, undisturbed)


@pytest.mark.full
@pytest.mark.parametrize("name", ["bag/bag_0.mcap", "map.npz", "report.json", "map.png", "ledger.jsonl"])
def test_a_finished_run_that_lost_a_file_gets_it_again(undisturbed: Path, tmp_path: Path, name: str) -> None:
    copy = tmp_path / "run"
    shutil.copytree(undisturbed, copy)
    (copy / name).unlink()
    assert_gone_on_with(copy, undisturbed)
    assert (copy / name).is_file() or name.startswith("bag")
    result = bow("sweep", "--resume", str(copy))
    assert (result.returncode, "nothing to do" in result.stdout) == (0, True)


@pytest.mark.full
def test_without_syncs_and_locks_a_sweep_is_the_same(undisturbed: Path, tmp_path: Path) -> None:
    run = run_sweep(tmp_path / "run", *SMALL, "--no-sync", "--no-lock", "--no-dashboard")
    assert verified(run)["cells"] == 128
    assert not (run / ".coordinator.lock").exists()
    assert not (run / ".recorder.lock").exists()


def test_a_run_that_does_not_hold_is_not_called_done(tmp_path: Path) -> None:
    from bow_sweep.cli.sweep_report import RunCheck

    (tmp_path / "bag").mkdir()
    said = RunCheck(tmp_path, lambda _: None, whole=False).end()
    assert "holds no bag" in said
    assert f"bow verify {tmp_path}" in said
    assert f"bow sweep --resume {tmp_path}" in said
