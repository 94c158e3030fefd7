"""The node as a process of its own, on a graph of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import rclpy
from bow_msgs.msg import BasinMap, Health, InspectedCell, Plan
from example_maps import RUN, basin_map, inspection, plan
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from read_rrd import named, pending, rows, verify

from bow_sim.graph.node_base import INSPECT, LATCHED
from bow_sim.protocol import cdr

NAMESPACE = "/bow/test"
PATIENCE_S = 60.0
OUTPUT = "output.txt"


class Graph:
    """A coordinator, as far as a dashboard sees it, and the dashboard."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node("coordinator", namespace=NAMESPACE, context=self.context, enable_rosout=False)
        self.plans = self.node.create_publisher(Plan, "plan", LATCHED)
        self.maps = self.node.create_publisher(BasinMap, "basin_map", LATCHED)
        self.inspections = self.node.create_publisher(InspectedCell, "inspect", INSPECT)
        self.healths = self.node.create_publisher(Health, "health", LATCHED)
        self.heard: list[Health] = []
        self.node.create_subscription(Health, "health", self._on_health, LATCHED)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.process: subprocess.Popen[bytes] | None = None

    def _on_health(self, message: Health) -> None:
        if self.process is not None and message.pid == self.process.pid:
            self.heard.append(message)

    def start(self, *parameters: str) -> subprocess.Popen[bytes]:
        self.heard.clear()
        arguments = [word for parameter in parameters for word in ("-p", parameter)]
        command = [
            sys.executable,
            "-m",
            "bow_sweep.view.node",
            "--ros-args",
            "-r",
            f"__ns:={NAMESPACE}",
            *arguments,
        ]
        with open(self.folder / OUTPUT, "w") as output:
            self.process = subprocess.Popen(
                command, cwd=self.folder, stdout=output, stderr=subprocess.STDOUT, env=_environment()
            )
        return self.process

    def output(self) -> str:
        return (self.folder / OUTPUT).read_text()

    def until(self, condition: Callable[[], bool], what: str) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while not condition():
            assert self.process is not None
            if time.monotonic() > deadline or self.process.poll() is not None:
                said = [(message.state, message.detail, message.messages, message.ignored) for message in self.heard]
                pytest.fail(f"waited for {what}; the dashboard said {said[-3:]} and printed: {self.output()}")
            self.executor.spin_once(timeout_sec=0.05)

    def until_state(self, state: int) -> None:
        self.until(lambda: bool(self.heard) and self.heard[-1].state == state, f"Health.state = {state}")

    def plan(self, *args: object, **kwargs: object) -> None:
        self.plans.publish(cdr.encode("Plan", plan(*args, **kwargs)))  # type: ignore[arg-type]

    def map(self, computed: int | None = None, run: str = RUN) -> None:
        self.maps.publish(cdr.encode("BasinMap", basin_map(computed=computed, run=run)))

    def stop(self, number: int = signal.SIGTERM) -> int:
        assert self.process is not None
        self.process.send_signal(number)
        return self.process.wait(20)

    def close(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.wait()
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


def _environment() -> dict[str, str]:
    root = str(Path(__file__).resolve().parents[3])
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH", "")]))}


@pytest.fixture
def graph(ros_domain: int, tmp_path: Path) -> Iterator[Graph]:
    made = Graph(tmp_path)
    yield made
    made.close()


def test_a_whole_sweep_ends_in_a_finished_file(graph, tmp_path):
    graph.start("runs_dir:=runs")
    graph.until_state(Health.READY)
    graph.map(computed=4)  # before its plan: topics don't wait for each other
    graph.plan()
    graph.until_state(Health.BUSY)
    assert graph.heard[-1].run_id == RUN
    path = tmp_path / "runs" / RUN / "dashboard.rrd"
    assert path.exists()
    graph.healths.publish(
        Health(role="simulator", node=f"{NAMESPACE}/simulator_7", state=Health.BUSY, detail="block 1")
    )
    for chunk in range(4):
        for cell in (3, 17):
            graph.inspections.publish(inspection(cell, chunk))
    for computed in (8, 16, 24, 32):
        graph.map(computed)
        graph.plan(done=computed // 8)
        graph.until(lambda: True, "a moment")
        time.sleep(0.05)
    graph.plan(2, done=4)
    graph.until_state(Health.CLOSED)
    assert verify(path) == ""
    said = [text for line in named(path, "map") for text in line]
    for length, text in zip(basin_map()["transient_periods"].tolist(), said, strict=True):
        assert text.endswith(f"transient {length:g} periods" if length else "no Helmholtz motion")
    assert len([1 for when, _ in rows(path, "waveform/cell_17", "Scalars:scalars") if when]) == 4 * 695
    assert "simulator_7" in rows(path, "account", "TextDocument:text")[-1][1][0]
    assert pending(path)[-1] == 0
    assert graph.heard[-1].ignored == 0

    second = "f" * 16  # the same node shows the next run
    graph.plan(run=second)
    graph.until_state(Health.BUSY)
    graph.map(run=second)
    graph.plan(2, run=second, done=4)
    graph.until_state(Health.CLOSED)
    assert verify(tmp_path / "runs" / second / "dashboard.rrd") == ""
    assert graph.stop(signal.SIGINT) == 0


def maps_in(path: Path) -> int:
    """How many maps a recording has that may be written just now."""
    try:
        return len(rows(path, "counts", "Scalars:scalars")) if path.exists() else 0
    except RuntimeError:  # a part of the last message is in the file
        return 0


def test_a_killed_dashboard_is_replaced_and_the_file_goes_on(graph, tmp_path):
    graph.start("run_dir:=here")
    graph.until_state(Health.READY)
    graph.plan()
    graph.map(8)
    path = tmp_path / "here" / "dashboard.rrd"
    graph.until(lambda: maps_in(path) >= 2, "the first map, after the empty one")
    assert graph.stop(signal.SIGKILL) == -signal.SIGKILL
    before = rows(path, "counts", "Scalars:scalars")

    graph.start("run_dir:=here")
    graph.map()
    graph.until_state(Health.BUSY)  # from the latched plan
    graph.plan(2, done=4)
    graph.until_state(Health.CLOSED)
    assert verify(path) == ""
    after = rows(path, "counts", "Scalars:scalars")
    assert after[: len(before)] == before
    assert pending(path)[-1] == 0
    assert [p.name for p in path.parent.iterdir()] == ["dashboard.rrd"]


def test_told_to_stop_it_finishes_the_file_and_says_goodbye(graph, tmp_path, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    graph.start("run_dir:=here", "view:=true")  # nowhere to show it: said, and served all the same
    graph.until_state(Health.READY)
    graph.plan()
    graph.map(12)
    path = tmp_path / "here" / "dashboard.rrd"
    graph.until(lambda: maps_in(path) >= 2, "the first map, after the empty one")
    assert graph.stop(signal.SIGTERM) == 0
    assert verify(path) == ""
    assert pending(path)[-1] == 20
    assert "interrupted" in rows(path, "account", "TextDocument:text")[-1][1][0]
    assert "there is no display here; the map is served instead" in graph.output()
    assert "watch the map grow with: rerun --connect rerun+http://127.0.0.1:" in graph.output()


def test_the_network_gives_no_path_and_no_rubbish(graph, tmp_path):
    graph.start("runs_dir:=runs")
    graph.until_state(Health.READY)
    evil = {**plan(), "run_id": "../../evil"}
    graph.plans.publish(cdr.encode("Plan", evil))
    graph.until(lambda: graph.heard[-1].ignored >= 1, "the evil plan to be ignored")
    graph.maps.publish(b"\x00\x01\x00\x00rubbish")
    graph.until(lambda: graph.heard[-1].ignored >= 2, "rubbish to be ignored")
    graph.plan(2)  # over before we came: nothing to show
    graph.plan()
    graph.until_state(Health.BUSY)
    spoilt = bytearray(inspection(3, 0))
    spoilt[-1] ^= 1
    graph.inspections.publish(bytes(spoilt))
    graph.until(lambda: graph.heard[-1].ignored >= 3, "the wrong checksum to be ignored")
    assert sorted(p.name for p in tmp_path.iterdir()) == [OUTPUT, "runs"]
    assert [p.name for p in (tmp_path / "runs").iterdir()] == [RUN]


def test_a_directory_that_cannot_be_made_fails_the_picture_and_not_the_process(graph, tmp_path):
    (tmp_path / "file").write_text("")
    graph.start("run_dir:=file/below")
    graph.until_state(Health.READY)
    graph.plan()
    graph.until_state(Health.FAILED)
    assert "file/below" in graph.heard[-1].detail
    graph.plan()
    graph.until(lambda: graph.heard[-1].messages >= 2, "the next plan to be taken")
    assert graph.stop() == 0
    assert graph.output().count("nothing more is shown") == 1


@pytest.mark.parametrize(
    ("parameter", "complaint"),
    [
        ("server_memory:=lots", "server_memory = 'lots': should be like 256MiB"),
        ("port:=70000", "port"),
        ("connect:=http://example.org", "should be like rerun+http://127.0.0.1:9876/proxy"),
        ("view:=3", "view"),
    ],
)
def test_parameters_that_cannot_be_are_refused(graph, parameter, complaint):
    process = graph.start(parameter)
    assert process.wait(PATIENCE_S) == 1
    assert complaint in graph.output()
    assert "Traceback" not in graph.output()


def test_help_teaches(graph):
    process = subprocess.run(
        [sys.executable, "-m", "bow_sweep.view.node", "--help"],
        capture_output=True,
        text=True,
        env=_environment(),
        check=True,
    )
    assert "rerun --connect" in process.stdout
