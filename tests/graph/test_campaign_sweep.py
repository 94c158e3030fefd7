"""Six maps with one command, cut off and gone on with."""

import json
import signal
from pathlib import Path

import pytest
from graph import bow, sweeping, verified

pytestmark = [pytest.mark.full, pytest.mark.usefixtures("ros_domain")]

SMALL = ["fig11", "--nx", "4", "--ny", "2", "--periods", "20", "--no-dashboard"]


def test_a_campaign_that_was_cut_off_is_gone_on_with(tmp_path: Path) -> None:
    campaign = tmp_path / "campaign"
    second = campaign / "fig11b" / "ledger.jsonl"
    with sweeping(tmp_path / "first", *SMALL, "--out", str(campaign)) as sweep:
        sweep.wait_until(second.exists)
        sweep.process.send_signal(signal.SIGINT)
        assert sweep.wait() == 130, sweep.text
        assert f"bow sweep --resume {campaign}" in sweep.text
    first = (campaign / "fig11a" / "report.json").read_bytes()
    with sweeping(tmp_path / "second", "--resume", str(campaign), "--no-dashboard") as sweep:
        assert sweep.wait() == 0, sweep.text
        assert "fig11f (5 of 5)" in sweep.text or "fig11f: stiff_cremer" in sweep.text
    assert (campaign / "fig11a" / "report.json").read_bytes() == first
    report = json.loads((campaign / "study.json").read_text())
    assert report["cells"] == {"planned": 48, "done": 48, "quarantined": 0, "outstanding": 0}
    assert [each["run"] for each in report["maps"]] == [f"fig11{letter}" for letter in "abcdef"]
    assert (campaign / "maps.png").stat().st_size > 10_000
    verified(campaign / "fig11b")
    again = bow("sweep", "--resume", str(campaign))
    assert again.returncode == 0
    assert "48 of 48 cells" in again.stdout
