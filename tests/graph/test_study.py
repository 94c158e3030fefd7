"""A study of real processes: killed in the middle, gone on with, and the same maps as sweeps alone."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest
from graph import PATIENCE_S, assert_same_map, bow, gated, kill_at_once, verified

from bow import sweep
from bow_sweep.study.search import Optimiser, Search

pytestmark = [pytest.mark.full, pytest.mark.usefixtures("ros_domain")]

VALUES = (0.8, 1.0, 1.2)
GRID = {"nx": 16, "ny": 8, "periods": 40}
NAMES = [f"{number}_mu_s={value:g}" for number, value in enumerate(VALUES)]


class Command:
    """A command of bow as a process, with its output in a file."""

    def __init__(self, output: Path, *words: str, module: str = "bow_sweep") -> None:
        self.output = output
        with open(output, "wb") as file:
            command = [sys.executable, "-m", module, *words]
            streams = {"stdin": subprocess.DEVNULL, "stdout": file, "stderr": subprocess.STDOUT}
            self.process = subprocess.Popen(command, start_new_session=True, env=os.environ, **streams)

    def wait_until(self, what: Callable[[], bool]) -> None:
        """Wait for something to become true while it runs."""
        deadline = time.monotonic() + PATIENCE_S
        while not what():
            if (self.process.poll() is not None or time.monotonic() > deadline) and not what():
                pytest.fail(f"it never came true; the command says:\n{self.output.read_text()}")
            time.sleep(0.02)

    def wait(self) -> int:
        """Wait for its end and return its exit status."""
        return self.process.wait(PATIENCE_S)

    def kill_all(self) -> None:
        """SIGKILL to it and all its descendants."""
        if self.process.poll() is None:
            first = psutil.Process(self.process.pid)
            kill_at_once([first, *first.children(recursive=True)])
        self.process.wait(PATIENCE_S)


def held_in_its_second_map(output: Path, *words: str, chunks: int) -> Command:
    """Start a command of which each simulator publishes all of the first map, but only some chunks of the second."""
    gate = output.with_suffix(".gate")
    gate.write_text(f"{chunks} 1")
    with gated(gate):
        return Command(output, *words, module="gated_simulator")


def done_blocks(run: Path) -> int:
    ledger = run / "ledger.jsonl"
    return ledger.read_bytes().count(b'"event": "done"') if ledger.exists() else 0


def test_a_study_that_was_killed_in_the_middle_is_gone_on_with_and_has_the_maps_of_sweeps_alone(tmp_path: Path) -> None:
    study = tmp_path / "study"
    over = "mu_s=" + ",".join(map(str, VALUES))
    grid = ["--nx", "16", "--ny", "8", "--periods", "40", "--set", "block_cells=8", "--simulators", "2"]
    asked = ["study", "fig11d", "--over", over, *grid, "--out", str(study)]
    command = held_in_its_second_map(tmp_path / "first.out", *asked, chunks=50)
    try:
        command.wait_until(lambda: done_blocks(study / NAMES[1]) >= 2)
    finally:
        command.kill_all()
    kept = (study / NAMES[0] / "report.json").read_bytes()
    assert not (study / NAMES[2] / "report.json").exists()
    assert not (study / "study.json").exists()

    command = Command(tmp_path / "second.out", "study", "--resume", str(study))
    try:
        assert command.wait() == 0, command.output.read_text()
    finally:
        command.kill_all()
    said = command.output.read_text()
    assert "of 3 maps are finished, and were checked" in said
    assert (study / NAMES[0] / "report.json").read_bytes() == kept
    for name, value in zip(NAMES, VALUES, strict=True):
        verified(study / name)
        alone = tmp_path / f"alone-{name}"
        alone.mkdir()
        sweep("fig11d", **GRID, block_cells=8, mu_s=value, record="verdicts", progress=False).save(alone / "map.npz")
        assert_same_map(alone, study / name)
    content = json.loads((study / "study.json").read_text())
    assert [each["run"] for each in content["maps"]] == NAMES
    assert content["cells"] == {"planned": 384, "done": 384, "quarantined": 0, "outstanding": 0}
    assert (study / "study.png").stat().st_size > 10_000
    assert (study / "study.nc").stat().st_size > 1_000

    again = bow("study", "--resume", str(study))
    assert again.returncode == 0, again.stderr
    assert "3 of 3 maps are finished" in again.stderr


def test_a_search_that_was_interrupted_says_how_to_go_on_and_gives_what_it_would_have_given(tmp_path: Path) -> None:
    asked = ["fig11d", "--over", "mu_s=0.8:1.2", "--nx", "8", "--ny", "4", "--periods", "20", "--trials", "4"]
    search = tmp_path / "search"
    command = held_in_its_second_map(tmp_path / "first.out", "optimise", *asked, "--out", str(search), chunks=1)
    try:
        command.wait_until(lambda: len(list(search.glob("1_*/ledger.jsonl"))) == 1)
        command.process.send_signal(signal.SIGINT)
        assert command.wait() == 130, command.output.read_text()
    finally:
        command.kill_all()
    assert f"bow optimise --resume {search}" in command.output.read_text()
    again = bow("optimise", "--resume", str(search))
    assert again.returncode == 0, again.stderr
    assert "best" in again.stdout
    found = json.loads((search / "optimise.json").read_text())
    assert len(found["trials"]) == 4
    optimiser = Optimiser(Search.in_directory(search))
    for trial in found["trials"]:
        assert optimiser.ask() == trial["values"]
        optimiser.tell(trial["value"])
    values = [trial["value"] for trial in found["trials"]]
    assert found["best"] == found["trials"][values.index(max(values))]["run"]
