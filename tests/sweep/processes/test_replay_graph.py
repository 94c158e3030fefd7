"""Replay = live: through DDS and a classifier process a bag gets the same verdicts as in this process."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
import recording
from graph import has_ended, nodes_of, until

from bow_sweep.processes.replay_graph import chunks_in_order, classify_in_graph
from bow_sweep.processes.supervisor import GraphError
from bow_sweep.record.bag_contents import Survey
from bow_sweep.record.replay import classify_here, replay

pytestmark = pytest.mark.usefixtures("ros_domain")

SWEEP = recording.small_sweep()


def bow_replay(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "bow_sweep", "replay", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def test_through_dds_the_verdicts_are_the_recorded_ones(run: Path) -> None:
    before = {path: path.read_bytes() for path in sorted(run.rglob("*")) if path.is_file()}
    result = bow_replay(str(run), "--graph")
    assert result.returncode == 0, result.stderr
    said = json.loads(result.stdout)
    assert said["chunks"] == said["equal"] == 12
    assert said["file"] is None
    assert said == replay(run)
    assert {path: path.read_bytes() for path in sorted(run.rglob("*")) if path.is_file()} == before


def test_other_thresholds_give_the_same_new_verdict_set_on_both_ways(run: Path) -> None:
    bag = (run / "bag" / "bag_0.mcap").read_bytes()
    settings = ["correlation=0.5", "corner=0.35"]
    here = replay(run, settings=settings, classify=classify_here)
    in_process = Path(here["file"]).read_bytes()
    Path(here["file"]).unlink()
    there = replay(run, settings=settings, classify=classify_in_graph)
    assert here == there
    assert here["equal"] < here["chunks"] == 12
    assert Path(there["file"]).read_bytes() == in_process
    assert (run / "bag" / "bag_0.mcap").read_bytes() == bag


@pytest.fixture(scope="module")
def long(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of 480 chunks, many more than are under way at once."""
    sweep = recording.small_sweep("periods=200", "block_cells=1")
    return recording.record(tmp_path_factory.mktemp("long") / "run", sweep)


@pytest.mark.full
def test_a_long_bag_goes_through_bit_by_bit(long: Path) -> None:
    result = replay(long, classify=classify_in_graph)
    assert result["ok"]
    assert result["equal"] == result["chunks"] == 12 * 40


@pytest.mark.full
def test_a_bag_with_a_gap_is_classified_up_to_it(tmp_path: Path) -> None:
    session = recording.session(tmp_path / "run", SWEEP)
    for block in range(SWEEP.blocks):
        for number, chunk in enumerate(recording.chunks(SWEEP, block)):
            for topic, data in chunk.items():
                if (block, number, topic) != (1, 2, "stick_slip"):
                    session.take(topic, data, time.time_ns())
    recording.finish(session, SWEEP)
    survey = Survey(tmp_path / "run" / "bag").read()
    assert [chunk for block, chunk in chunks_in_order(survey, _task(survey)) if block == 1] == [0, 1]
    here, there = (replay(tmp_path / "run", classify=classify) for classify in (classify_here, classify_in_graph))
    assert not here["ok"]
    assert here == there


def _task(survey: Survey) -> object:
    from bow_sweep.record.replay import task_of

    return task_of(survey)


@pytest.mark.full
def test_the_exit_of_the_classifier_is_reported(long: Path) -> None:
    survey = Survey(long / "bag").read()
    verdicts = classify_in_graph(survey, _task(survey))  # type: ignore[arg-type]
    next(verdicts)
    (classifier,) = nodes_of(os.getpid(), "classifier")
    classifier.kill()
    with pytest.raises(GraphError, match=r"the classifier ended \(killed by SIGKILL\)"):
        list(verdicts)


STOPS = """
import os, signal, sys
from bow_sweep.cli import main
from bow_sweep.processes.replay_graph import _Graph

def open_and_stop(self, opens=_Graph.open):
    opens(self)
    os.kill(os.getpid(), signal.SIGSTOP)

_Graph.open = open_and_stop
sys.exit(main(sys.argv[1:]))
"""
"""A command that stops itself before it sends the first chunk."""


@pytest.mark.full
def test_interrupted_it_leaves_nothing_behind(run: Path) -> None:
    words = [sys.executable, "-c", STOPS, "replay", str(run), "--graph", "--set", "correlation=0.5"]
    process = subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, start_new_session=True)
    stops = lambda: psutil.Process(process.pid).status() == psutil.STATUS_STOPPED
    until(lambda: process.poll() is not None or stops(), "no chunk is sent")
    children = nodes_of(process.pid, "classifier")
    assert len(children) == 1
    for number in (signal.SIGINT, signal.SIGCONT):
        process.send_signal(number)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130, said
    assert b"nothing was written" in said
    until(lambda: all(map(has_ended, children)), "the classifier does not end")
    assert not list(run.glob("verdicts-*"))
