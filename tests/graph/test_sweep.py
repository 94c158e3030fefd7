"""`bow sweep` as its users meet it: finished, interrupted, gone on with, refused."""

import json
import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from graph import SMALL, TINY, assert_gone_on_with, bow, halted, orphans, run_sweep, sweeping, verified

from bow_sim.kernel.block import transient
from bow_sim.protocol import cdr
from bow_sweep.plan.sweep import Sweep
from bow_sweep.record.bag import messages

pytestmark = pytest.mark.usefixtures("ros_domain")


def test_a_sweep_leaves_what_it_promises_and_everything_is_accounted_for(undisturbed: Path) -> None:
    for name in ("bag/metadata.yaml", "ledger.jsonl", "map.npz", "map.png", "dashboard.rrd", "report.json"):
        assert (undisturbed / name).stat().st_size > 0, name
    report = json.loads((undisturbed / "report.json").read_text())
    assert report["cells"] == {"planned": 128, "done": 128, "quarantined": 0, "outstanding": 0}
    assert report["samples"] == 128 * 13_900
    account = verified(undisturbed)
    assert (account["cells"], account["samples"]) == (128, 128 * 13_900)
    printed = bow("verify", str(undisturbed))
    assert (printed.returncode, {**json.loads(printed.stdout), "seconds": 0}) == (0, {**account, "seconds": 0})
    assert orphans(undisturbed) == []


def test_the_verdicts_of_a_cell_do_not_depend_on_pool_or_block(undisturbed: Path, tmp_path: Path) -> None:
    other = run_sweep(tmp_path / "run", "fig11d", "--nx=16", "--ny=8", "--set=block_cells=37", "--simulators=1")
    with np.load(undisturbed / "map.npz") as one, np.load(other / "map.npz") as two:
        for name in set(one.files) - {"run_id", "sweep_id", "settings"}:
            np.testing.assert_array_equal(one[name], two[name], err_msg=name)


def test_a_reflection_function_of_ones_own_and_the_bow_position_can_be_swept(tmp_path: Path) -> None:
    mine = tmp_path / "nut.txt"
    mine.write_text("first=124 taps=-0.97")
    settings = [f"nut_function=@{mine}", "x.count=6", "x.last=20", "y.count=4", "block_cells=5"]
    run = run_sweep(tmp_path / "run", "schelleng", *(f"--set={line}" for line in settings))
    assert verified(run)["cells"] == 24
    sweep = Sweep.from_spec("", json.loads((run / "report.json").read_text())["settings"])
    assert "-0.97" in sweep.parameters.nut_function
    np.testing.assert_array_equal(sweep.x.values(), [5, 8, 11, 14, 17, 20])
    cell = 2 * 6 + 4  # third force, bow at 17 samples
    alone = sweep.parameters.replace(bow_bridge=17, f_asym=float(sweep.y.values()[2]))
    expected = transient(alone)["bridge_force"].astype(np.float32)
    waveform = {}
    for message in messages(run / "bag"):
        if message.topic.endswith("bridge_force"):
            values = cdr.decode("BridgeForce", message.data)
            if cell in values["cells"]:
                row = values["cells"].tolist().index(cell)
                waveform[values["chunk"]] = values["data"].reshape(-1, values["samples"])[row]
    recorded = np.concatenate([part for _, part in sorted(waveform.items())])
    np.testing.assert_array_equal(recorded, expected)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_it_stops_in_order_and_says_how_to_go_on(
    undisturbed: Path, tmp_path: Path, number: signal.Signals
) -> None:
    run = tmp_path / "run"
    with halted(run, *SMALL) as sweep:
        sweep.wait_until(lambda: sweep.done_blocks() >= 2)
        sweep.process.send_signal(number)
        assert sweep.wait() == 130, sweep.text
        assert f"bow sweep --resume {run}" in sweep.text
    assert orphans(run) == []
    assert_gone_on_with(run, undisturbed, shown=True)


def test_a_second_ctrl_c_changes_nothing(tmp_path: Path) -> None:
    run = tmp_path / "run"
    with halted(run, *SMALL) as sweep:
        sweep.wait_until(lambda: sweep.done_blocks() >= 2)
        for _ in range(3):
            sweep.process.send_signal(signal.SIGINT)
            time.sleep(0.1)
        assert sweep.wait() == 130, sweep.text
        assert "Traceback" not in sweep.text
    assert orphans(run) == []


def test_a_finished_run_is_not_begun_again(undisturbed: Path) -> None:
    before = (undisturbed / "report.json").read_bytes()
    result = bow("sweep", *SMALL, "--out", str(undisturbed))
    assert result.returncode == 2
    assert "is not empty" in result.stderr
    assert (undisturbed / "report.json").read_bytes() == before


def test_going_on_with_a_finished_run_says_that_there_is_nothing_to_do(undisturbed: Path) -> None:
    result = bow("sweep", "--resume", str(undisturbed))
    assert result.returncode == 0
    assert "nothing to do" in result.stdout


def test_a_run_cut_off_before_its_report_gets_one(tmp_path: Path) -> None:
    run = run_sweep(tmp_path / "run", *TINY)
    (run / "report.json").unlink()
    (run / "map.npz").unlink()
    with sweeping(run, "--resume", str(run)) as sweep:
        assert sweep.wait() == 0, sweep.text
    verified(run)
    assert (run / "report.json").exists()
    assert (run / "map.npz").exists()


def test_bad_input_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    out = tmp_path / "run"
    cases = {
        ("nope",): "preset 'nope'",
        ("fig11d", "--model", "erard"): "model = 'erard'",
        ("fig11d", "--v-mid", "1"): "v_mid",
        ("fig11d", "--v-mid", "nan"): "v_mid",
        ("fig11d", "--nx", "0"): "x.count = 0",
        ("fig11d", "--ny", "99999999"): "y.count = 99999999",
        ("fig11d", "--set", "tau_f=-1"): "tau_f",
        ("fig11d", "--set", "colour=red"): "colour",
        ("fig11d", "--simulators", "0"): "--simulators 0",
        ("fig11d", "--resume", str(tmp_path)): "--resume",
        ("--resume", str(tmp_path / "nothing")): "is no directory; should be a run directory",
    }
    for arguments, message in cases.items():
        places = [] if "--resume" in arguments else ["--out", str(out)]
        result = bow("sweep", *arguments, *places)
        assert result.returncode == 2, arguments
        assert message in result.stderr
        assert len(result.stderr.strip().splitlines()) == 1
        assert not out.exists()


def test_an_output_directory_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    result = bow("sweep", *SMALL, "--out", str(tmp_path / "file"))
    assert result.returncode == 2
    assert "is a file" in result.stderr
    assert (tmp_path / "file").read_text() == "mine"


def test_an_output_directory_that_cannot_be_written_is_refused() -> None:
    if not Path("/proc").is_dir():
        pytest.skip("no /proc here")
    result = bow("sweep", *SMALL, "--out", f"/proc/{os.getpid()}/run")
    assert result.returncode == 2
    assert "cannot be written" in result.stderr
