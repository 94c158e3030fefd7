"""A block that kills its simulator again and again is given up and named; all the others are computed."""

import json
import os
import signal
from pathlib import Path

import numpy as np
import pytest
from graph import SMALL, bow, halted, map_of, orphans, sweeping, verified

from bow_sweep.run.ledger import POISON_CRASHES

pytestmark = pytest.mark.usefixtures("ros_domain")

POISON = 5
CELLS = slice(8 * POISON, 8 * POISON + 8)
"""Of block 5, at eight cells a block."""


def ledger(run: Path) -> list[dict]:
    return [json.loads(line) for line in (run / "ledger.jsonl").read_text().splitlines()]


@pytest.mark.parametrize(
    ("death", "cause"),
    [
        ("SIGSEGV", "killed by SIGSEGV"),
        ("exit", "exit status 1"),
    ],
)
@pytest.mark.full
def test_a_block_that_kills_its_simulators_is_quarantined_and_named_and_the_rest_completes(
    death: str, cause: str, undisturbed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1] / "support"), prepend=os.pathsep)
    monkeypatch.setenv("POISON_BLOCK", str(POISON))
    monkeypatch.setenv("POISON_DEATH", death)
    run = tmp_path / "run"
    with sweeping(run, *SMALL, "--out", str(run), module="poison_simulator") as sweep:
        assert sweep.wait() == 3, sweep.text
        assert (
            f"QUARANTINED block {POISON}: poison: {POISON_CRASHES} simulators crashed while computing only this block"
            in sweep.text
        )
        assert sweep.text.count(cause) >= POISON_CRASHES
        assert "Traceback" not in sweep.text
    assert orphans(run) == []

    report = json.loads((run / "report.json").read_text())
    assert report["cells"] == {"planned": 128, "done": 120, "quarantined": 8, "outstanding": 0}
    assert list(report["quarantined_blocks"]) == [str(POISON)]
    crashes = [entry for entry in ledger(run) if entry["event"] == "died"]
    assert [entry["block"] for entry in crashes if entry["alone"]] == [POISON] * POISON_CRASHES
    assert any(cause in entry["why"] for entry in crashes)

    account = verified(run)
    assert (account["cells"], account["cells_quarantined"]) == (120, 8)
    assert account["quarantined_blocks"] == [POISON]
    right, given = map_of(undisturbed), map_of(run)
    assert np.isnan(given["transient_periods"].reshape(-1)[CELLS]).all()
    for name in ("transient_periods", "regime"):
        here, there = (np.delete(values[name].reshape(-1), np.r_[CELLS]) for values in (right, given))
        np.testing.assert_array_equal(here, there, err_msg=name)

    again = bow("sweep", "--resume", str(run))
    assert again.returncode == 3
    assert f"QUARANTINED block {POISON}" in again.stdout


def test_simulators_that_their_supervisor_stops_make_no_block_suspect(tmp_path: Path) -> None:
    run = tmp_path / "run"
    with halted(run, *SMALL) as sweep:
        sweep.wait_until(lambda: sweep.done_blocks() >= 2)
        sweep.process.send_signal(signal.SIGINT)
        assert sweep.wait() == 130, sweep.text
    events = [entry["event"] for entry in ledger(run)]
    assert "dispatched" in events
    assert "died" not in events
