"""The recorder as a process on a real graph: what dies, what is answered, what is in the bag."""

import os
import resource
import subprocess
import sys
import time

import numpy as np
import pytest
import recording
from bow_msgs.msg import Health
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import deserialize_message

from bow_sim.protocol import cdr
from bow_sim.protocol.states import BlockState, PlanState
from bow_sweep.record.bag import bag_files, messages
from bow_sweep.record.verify import verify

SWEEP = recording.small_sweep()
KEYS = {(kind, block, chunk) for kind in (0, 1) for block in range(SWEEP.blocks) for chunk in range(SWEEP.chunks)}
KEYS |= {(2, block, 0) for block in range(SWEEP.blocks)}
"""What is receipted of the whole sweep: streams and verdicts of every chunk, and that every block is on the disk."""


def open_run(graph, epoch=1):
    graph.publish("plan", recording.plan(SWEEP, epoch=epoch))
    graph.until(lambda: graph.state() == Health.BUSY, "the bag is open")


def close_run(graph, epoch=1):
    states = np.full(SWEEP.blocks, BlockState.DONE, np.uint8)
    graph.publish("plan", recording.plan(SWEEP, PlanState.CLOSED, epoch, states))
    graph.until(lambda: graph.state() == Health.CLOSED, "the bag is closed")


def send(graph, attempt=1, blocks=range(SWEEP.blocks)):
    for block in blocks:
        for chunk in recording.chunks(SWEEP, block, attempt):
            for topic, data in chunk.items():
                graph.publish(topic, data)


def answered(graph, attempt):
    return {entry[:3] for entry in graph.answered() if entry[3] == attempt}


def test_a_run_is_recorded_answered_and_closed(graph):
    diagnostics = graph.node.create_publisher(DiagnosticArray, "/diagnostics", 10)
    graph.start_recorder()
    graph.until(lambda: diagnostics.get_subscription_count() > 0, "diagnostics are matched")
    open_run(graph)
    for namespace in ("/another/graph", recording.NAMESPACE, recording.NAMESPACE + "/below"):
        diagnostics.publish(DiagnosticArray(status=[DiagnosticStatus(name=f"{namespace}/coordinator: sweep")]))
    send(graph)
    graph.until(lambda: answered(graph, 1) == KEYS, "everything is receipted")
    send(graph, attempt=2)
    graph.until(lambda: answered(graph, 2) == KEYS, "the second attempt is answered too")
    close_run(graph)
    result = verify(graph.directory)
    assert result["ok"], result["problems"]
    topics = [m.topic for m in messages(graph.directory / "bag")]
    assert topics.count("bridge_force") == topics.count("stick_slip") == topics.count("verdicts") == 12
    assert topics[0] == "plan"
    assert topics[-1] == "plan"
    assert "health" in topics
    kept = [
        deserialize_message(bytes(m.data), DiagnosticArray)
        for m in messages(graph.directory / "bag")
        if "diag" in m.topic
    ]
    named = [array.status[0].name for array in kept]
    assert named == [f"{recording.NAMESPACE}/coordinator: sweep"], "those of this graph alone"
    assert graph.health[-1].duplicates == 36
    assert graph.stop() == 0


def test_a_killed_recorder_goes_on_where_its_file_ends(graph):
    graph.start_recorder()
    open_run(graph)
    send(graph, blocks=[0, 1])
    graph.until(lambda: len(answered(graph, 1)) >= 10, "some are receipted")
    before = answered(graph, 1)
    graph.kill()
    graph.answers.clear()
    graph.start_recorder()  # the plan is latched: it comes by itself
    graph.until(lambda: graph.state() == Health.BUSY, "the bag is open again")
    open_run(graph, epoch=2)
    send(graph, attempt=2)
    graph.until(lambda: answered(graph, 2) == KEYS, "the second attempt is answered in full")
    close_run(graph, epoch=2)
    assert [path.name for path in bag_files(graph.directory / "bag")] == ["bag_0.mcap", "bag_1.mcap"]
    result = verify(graph.directory)
    assert result["ok"], result["problems"]
    stored = [m for m in messages(graph.directory / "bag") if m.file.name == "bag_0.mcap"]
    receipted = set()
    for message in stored:
        if message.topic == "receipts":
            values = cdr.decode("Receipt", message.data)
            receipted |= set(zip(*(values[n].tolist() for n in ("kind", "block", "chunk")), strict=True))
    assert before <= receipted  # what was receipted before the kill is in the first file


def test_a_recorder_that_is_told_to_stop_finishes_its_file(graph):
    graph.start_recorder()
    open_run(graph)
    send(graph, blocks=[0])
    graph.until(lambda: len(answered(graph, 1)) == 9, "a block is receipted")
    assert graph.stop() == 0
    result = verify(graph.directory)
    assert {p["what"].partition(":")[0] for p in result["problems"]} == {"the last plan is open", "outstanding"}
    assert len(list(messages(graph.directory / "bag"))) > 12


def test_rubbish_is_counted_and_does_not_reach_the_bag(graph):
    graph.start_recorder()
    open_run(graph)
    stranger = recording.chunks(SWEEP, 0, run="f" * 16)[0]
    for data in (stranger.bridge_force, b"\x00\x01\x00\x00rubbish"):
        graph.publish("bridge_force", data)
    send(graph)
    graph.until(lambda: answered(graph, 1) == KEYS, "everything is receipted")
    graph.until(lambda: graph.health[-1].ignored >= 2, "the rubbish is counted")
    close_run(graph)
    assert verify(graph.directory)["ok"]


def test_a_full_disk_is_said_and_nothing_is_corrupt(graph):
    graph.start_recorder()
    open_run(graph)
    most = 130_000  # bytes a file may have from now on: as a disk that is full in the middle of a sweep
    resource.prlimit(graph.process.pid, resource.RLIMIT_FSIZE, (most, most))
    send(graph, blocks=[0])
    graph.until(lambda: answered(graph, 1), "the first block is receipted")
    send(graph, blocks=[1, 2])
    failures = lambda: [h for h in graph.health if h.state == Health.FAILED]
    graph.until(lambda: len(failures()) >= 2, "the recorder gives up, and what it answered before is in")
    failed = failures()[-1]
    assert "nothing more is recorded; make room and resume" in failed.detail
    receipted = answered(graph, 1)
    assert 0 < len(receipted) < len(KEYS)
    graph.publish("plan", recording.plan(SWEEP, states=np.array([1, 0, 0], np.uint8)))  # the same epoch goes on
    send(graph)
    graph.spin(1.0)
    assert answered(graph, 1) == receipted
    assert graph.state() == Health.FAILED
    assert graph.stop() == 0

    graph.start_recorder()
    graph.until(lambda: graph.state() == Health.BUSY, "there is room: the bag is open again")
    open_run(graph, epoch=2)
    send(graph, attempt=2)
    graph.until(lambda: answered(graph, 2) == KEYS, "everything is receipted")
    close_run(graph, epoch=2)
    result = verify(graph.directory)
    assert result["ok"], result["problems"]


def test_a_second_recorder_waits_for_the_lock(graph, tmp_path):
    with_lock = recording.session(graph.directory, SWEEP)
    graph.start_recorder()
    graph.publish("plan", recording.plan(SWEEP))
    graph.until(lambda: any("is locked" in h.detail for h in graph.health), "it says that the run is locked")
    with_lock.close(time.time_ns())
    graph.until(lambda: graph.state() == Health.BUSY, "the lock is free")


@pytest.mark.parametrize("run_id", ["../../escape", "run", ""])
def test_a_name_from_the_network_is_no_path(graph, run_id):
    runs = graph.directory.parent / "runs"
    graph.start_recorder("run_dir:=''", f"runs_dir:={runs}")
    graph.publish("plan", recording.plan(SWEEP, run=run_id))
    graph.until(lambda: graph.state() == Health.FAILED, "the plan is refused")
    assert "should be 16 hexadecimal digits" in graph.health[-1].detail
    assert not runs.exists()


def test_runs_lie_below_runs_dir_by_their_name(graph):
    runs = graph.directory.parent / "runs"
    graph.start_recorder("run_dir:=''", f"runs_dir:={runs}")
    open_run(graph)
    send(graph)
    graph.until(lambda: answered(graph, 1) == KEYS, "everything is receipted")
    close_run(graph)
    assert verify(runs / recording.RUN)["ok"]


def test_help_is_printed_without_a_graph():
    command = [sys.executable, "-m", "bow_sweep.record.node", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ, timeout=60, check=True)
    assert "ros2 run bow recorder" in done.stdout
