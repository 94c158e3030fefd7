"""An adaptive sweep as a graph of processes: rounds, kills and going on, and the same map whatever happens."""

import json
import os
import signal
from pathlib import Path

import numpy as np
import pytest
from domains import own_domain
from graph import assert_gone_on_with, assert_survives_a_kill, bow, halted, run_sweep, sweeping, verified

from bow_sweep.maps.in_process import compute
from bow_sweep.plan.sweep import Sweep

pytestmark = pytest.mark.usefixtures("ros_domain")

SETTINGS = ["x.count=24", "y.count=12", "x.first=2", "x.last=14", "block_cells=12", "adaptive=0.5"]
ADAPTIVE = ["fig11f", *(f"--set={line}" for line in SETTINGS)]
"""At most 144 of 288 cells, in some seven rounds."""


@pytest.fixture(scope="module")
def adaptive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The adaptive sweep without any mishap."""
    with own_domain():
        return run_sweep(tmp_path_factory.mktemp("adaptive") / "run", *ADAPTIVE)


def rounds(run: Path) -> list[list[int]]:
    lines = (run / "ledger.jsonl").read_text().splitlines()
    return [entry["cells"] for entry in map(json.loads, lines) if entry["event"] == "round"]


def test_an_adaptive_sweep_is_accounted_for_and_its_map_filled(adaptive: Path) -> None:
    account = verified(adaptive)
    report = json.loads((adaptive / "report.json").read_text())
    cells = sum(map(len, rounds(adaptive)))
    assert len(rounds(adaptive)) == report["rounds"] > 3
    assert report["cells"] == {"planned": cells, "done": cells, "quarantined": 0, "outstanding": 0}
    assert (account["cells"], account["cells_predicted"], account["notes"]) == (cells, 288 - cells, [])
    assert cells <= 144
    assert json.loads(bow("replay", str(adaptive)).stdout)["ok"]
    alone = compute(Sweep.from_spec("fig11f", SETTINGS))  # without a graph
    with np.load(adaptive / "map.npz") as file:
        simulated, length = file["simulated"], file["transient_periods"]
    np.testing.assert_array_equal(simulated.ravel(), ~np.isnan(alone.transient_periods))
    np.testing.assert_array_equal(length[simulated], alone.transient_periods[simulated.ravel()])
    assert not np.isnan(length).any()


@pytest.mark.full
@pytest.mark.parametrize("role", ["simulator", "classifier", "recorder"])
def test_it_goes_on_by_itself_after_a_kill(role: str, adaptive: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    assert_survives_a_kill(role, run, ADAPTIVE, 4, adaptive)
    assert rounds(run) == rounds(adaptive)


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGKILL, marks=pytest.mark.full)])
def test_cut_off_in_a_round_it_goes_on_to_the_same_map(number: signal.Signals, adaptive: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    with halted(run, *ADAPTIVE, chunks=90) as sweep:
        sweep.wait_until(lambda: sweep.done_blocks() >= 4)
        if number == signal.SIGKILL:
            sweep.children("coordinator")[0].kill()
            assert sweep.wait() == 1, sweep.text
        else:
            sweep.process.send_signal(number)
            assert sweep.wait() == 130, sweep.text
    before = rounds(run)
    assert len(before) < len(rounds(adaptive))
    assert_gone_on_with(run, adaptive)
    assert rounds(run) == rounds(adaptive)


@pytest.mark.full
def test_a_block_given_up_is_not_predicted_and_the_rounds_go_on(
    adaptive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1] / "support"), prepend=os.pathsep)
    monkeypatch.setenv("POISON_BLOCK", "1")
    monkeypatch.setenv("POISON_DEATH", "SIGSEGV")
    run = tmp_path / "run"
    with sweeping(run, *ADAPTIVE, "--out", str(run), module="poison_simulator") as sweep:
        assert sweep.wait() == 3, sweep.text
    account = verified(run)
    assert (account["cells_quarantined"], account["quarantined_blocks"], account["notes"]) == (12, [1], [])
    lost = rounds(run)[0][12:24]
    with np.load(run / "map.npz") as file:
        assert np.flatnonzero(np.isnan(file["transient_periods"])).tolist() == lost
        assert not file["simulated"].ravel()[lost].any()
    assert rounds(run)[0] == rounds(adaptive)[0]
    assert len(rounds(run)) > 3
    assert not set(lost) & {cell for cells in rounds(run)[1:] for cell in cells}


def test_a_share_that_is_none_is_refused(tmp_path: Path) -> None:
    for value in ("0", "2", "half"):
        result = bow("sweep", "fig11a", "--adaptive", value, "--out", str(tmp_path / "run"))
        assert result.returncode == 2
        assert "adaptive = " in result.stderr
        assert not (tmp_path / "run").exists()
