"""Several stations in a run: one loses its recorder; one comes late, is killed whole, comes back and leaves."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest
from domains import own_domain
from graph import (
    PATIENCE_S,
    Halted,
    assert_same_map,
    entries_of,
    halted,
    kill_at_once,
    orphans,
    run_sweep,
    stations_of,
    verified,
)

from bow_sim.graph.shm_files import files_of
from bow_sweep.record.bag import station_bags

pytestmark = [pytest.mark.full, pytest.mark.usefixtures("ros_domain")]

MANY = ["fig11d", "--nx", "64", "--ny", "64", "--set", "block_cells=16", "--no-dashboard", "--own-graph"]
BLOCKS = 256


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sweep on one station."""
    with own_domain():
        return run_sweep(tmp_path_factory.mktemp("alone") / "run", *MANY)


class Station:
    """`bow station` as a process, of which the simulator waits as those of its sweep do."""

    def __init__(self, name: str, sweep: Halted, out: Path) -> None:
        self.name, self.sweep, self.output = name, sweep, out.with_suffix(".out")
        self._before = len(entries_of(sweep.directory))
        words = ["-m", "gated_simulator", "station", name, "--run", str(sweep.directory), "--simulators", "1"]
        with open(self.output, "ab") as output, sweep.gated():
            self.process = subprocess.Popen(
                [sys.executable, *words, "--out", str(out)],
                stdout=output,
                stderr=output,
                stdin=subprocess.DEVNULL,
                env=os.environ,
            )

    @property
    def family(self) -> list[psutil.Process]:
        """All its processes, itself first."""
        first = psutil.Process(self.process.pid)
        return [first, *first.children(recursive=True)]

    def wait_for_a_block(self) -> None:
        """Wait until the ledger says that it has done a block: another of its name may have done some before."""
        self._wait_until(lambda: bool(self._blocks("done") & self._blocks("dispatched")))

    def _blocks(self, event: str) -> set[int]:
        """Return the blocks that this happened to with this station since it was started."""
        entries = entries_of(self.sweep.directory)[self._before :]
        return {each["block"] for each in entries if each["event"] == event and each.get("station") == self.name}

    def _wait_until(self, what: Callable[[], bool]) -> None:
        def is_there() -> bool:
            assert self.process.poll() is None, self.output.read_text()
            return what()

        self.sweep.wait_until(is_there)


@contextlib.contextmanager
def station(name: str, sweep: Halted, out: Path) -> Iterator[Station]:
    """Start a station; nothing of it is left in the end."""
    one = Station(name, sweep, out)
    try:
        yield one
    finally:
        if one.process.poll() is None:
            kill_at_once(one.family)
        one.process.wait()


def test_two_stations_of_a_machine_give_the_same_map_though_one_loses_its_recorder(alone: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    with halted(run, *MANY, "--simulators", "2", "--stations", "2") as sweep:
        sweep.wait_until(lambda: len(stations_of(run)) == 2)
        (recorder,) = [one for one in sweep.children("recorder") if "/station_1" in " ".join(one.cmdline())]
        recorder.kill()
        sweep.go_on()
        assert sweep.wait() == 0, sweep.text
    assert "station_1/recorder ended (killed by SIGKILL), starting it again" in sweep.text
    assert orphans(run) == []
    assert set(station_bags(run)) == {"station_1", "station_2"}
    assert set(stations_of(run)) == {"station_1", "station_2"}
    report = verified(run)
    assert (report["cells"], report["unseen"]) == (4096, {})
    assert report["verdicts_equal"] == report["verdicts"] == report["chunks_planned"]
    assert_same_map(alone, run)


def test_a_station_comes_late_is_killed_whole_comes_back_and_leaves(alone: Path, tmp_path: Path) -> None:
    run, out = tmp_path / "run", tmp_path / "stations"
    with halted(run, *MANY, "--simulators", "1") as sweep:
        sweep.wait_until(lambda: sweep.done_blocks() > 0)
        with station("lab", sweep, out) as lab:
            lab.wait_for_a_block()
            family = lab.family
            files = set[str]().union(*(files_of(process.pid) for process in family))
            kill_at_once(family)
            lab.process.wait()
        with station("lab", sweep, out) as lab:
            lab.wait_for_a_block()
            lab.process.send_signal(signal.SIGINT)
            assert lab.process.wait(PATIENCE_S) == 130, lab.output.read_text()
            assert "the run goes on without station lab" in lab.output.read_text()
        assert files
        assert not [file for file in files if "_port" not in file and Path(file).exists()], (
            "the second removes what is left"
        )
        sweep.go_on()
        assert sweep.wait() == 0, sweep.text
    assert_same_map(alone, run)
    shares = stations_of(run)
    assert sum(shares.values()) == BLOCKS
    assert set(shares) == {"", "lab"}
    assert f"not seen: {shares['lab']} blocks of station lab" in sweep.text
    assert {name: len(blocks) for name, blocks in verified(run)["unseen"].items()} == {"lab": shares["lab"]}
    (bag,) = out.glob("*/bag/lab")
    assert len(list(bag.glob("*.mcap"))) == 2
    shutil.copytree(bag, run / "bag" / "lab")
    report = verified(run)
    assert report["unseen"] == {}
    assert report["verdicts_equal"] == report["chunks_planned"]


def test_a_station_that_finds_no_run_says_so_and_leaves_nothing(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "bow_sweep", "station"]
    for arguments, text in (
        (["Lab", "--run", "a" * 16], "should be a lower-case letter"),
        (["lab", "--run", "nowhere"], "--run nowhere: should be the identity of a run"),
        (["lab", "--run", "a" * 16, "--network", "no.such.machine.invalid"], "should be SUBNET, or machines"),
        (["lab", "--run", "a" * 16, "--simulators", "0"], "should be at least 1"),
    ):
        command = [*words, *arguments, "--out", str(tmp_path / "out")]
        result = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        assert result.returncode == 2
        assert text in result.stderr
        assert len(result.stderr.splitlines()) == 1
    process = subprocess.Popen([*words, "lab", "--run", "a" * 16, "--out", str(tmp_path / "out")], stderr=-1)
    log = tmp_path / "out" / ("a" * 16) / "log" / "lab_simulator_1.log"
    deadline = time.monotonic() + PATIENCE_S
    while not log.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130, said
    assert not (tmp_path / "out" / ("a" * 16)).exists()
