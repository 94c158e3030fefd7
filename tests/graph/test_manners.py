"""The graph as ROS users and their tools meet it: answers to goals, diagnostics, a chosen cell, quiet logs."""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from bow_msgs.msg import Health, InspectedCell
from bow_msgs.srv import InspectCell
from desk import Desk, desk
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PointStamped
from graph import computed_by, verified
from rclpy.qos import QoSProfile, ReliabilityPolicy
from read_rrd import rows
from sensor_msgs.msg import PointCloud2

from bow_sim.graph.node_base import LATCHED
from bow_sim.protocol import cdr
from bow_sweep.plan.sweep import Sweep
from bow_sweep.record.bag import messages

pytestmark = pytest.mark.usefixtures("ros_domain")


# ---- the logs of a sweep that nothing disturbs

LINE = re.compile(r"\[(?P<level>[A-Z]+)\] \[[0-9.]+\] \[[^]]+\]: (?P<text>.*)")

MOST_WAITS = 8
"""Lines about waiting, each for other nodes or for longer than a second; more on a busy machine."""


def kind_of(text: str) -> str:
    """Return which of the expected lines this is."""
    if text.startswith(("ready in ", "waiting", "waits ")):
        return text.split(maxsplit=1)[0].removesuffix(":")
    found = re.fullmatch(r"run [0-9a-f]{16}(: (?P<percent>\d+) %,| (?P<what>opens:|closes[:,])).*", text)
    return found["percent"] or found["what"][:6] if found else f"not expected: {text}"


@pytest.mark.parametrize("role", ["coordinator", "recorder", "classifier", "simulator", "dashboard"])
def test_a_node_says_little_in_a_healthy_sweep_and_each_line_once(undisturbed: Path, role: str) -> None:
    """Ready, for whom it waits, the run opens, tenths of it, it closes; nothing else, nothing again."""
    [(busiest, _)] = computed_by(undisturbed).most_common(1)  # another simulator may have come when all was done
    name = busiest.rpartition("/")[2] if role == "simulator" else role
    lines = (undisturbed / "log" / f"{name}.log").read_text().splitlines()
    said = [found for line in lines if (found := LINE.fullmatch(line))]
    kinds = Counter(kind_of(line["text"]) for line in said if line["level"] == "INFO")  # a busy machine makes warnings
    waits = kinds.pop("waiting", 0) + kinds.pop("waits", 0)
    assert kinds.pop("ready") == kinds.pop("opens:") == kinds.pop("closes") == 1, lines
    assert waits <= MOST_WAITS, lines
    assert set(kinds) <= {str(percent) for percent in range(10, 101, 10)}, lines
    assert set(kinds.values()) <= {1}, lines


def test_the_screen_shows_nothing_of_the_logs(undisturbed: Path) -> None:
    screen = undisturbed.with_suffix(".out").read_text()
    assert "[INFO]" not in screen
    assert "opens:" not in screen


# ---- goals, diagnostics, a chosen cell


@pytest.fixture
def here(tmp_path: Path, ros_domain: int) -> Iterator[Desk]:
    with desk(tmp_path) as made:
        yield made


class Shown:
    """What a tool shows of /diagnostics."""

    def __init__(self, here: Desk) -> None:
        self.here = here
        self.items: dict[str, DiagnosticStatus] = {}
        self.stamped = True
        here.node.create_subscription(DiagnosticArray, "/diagnostics", self.take, 10)

    def take(self, message: DiagnosticArray) -> None:
        self.stamped &= message.header.stamp.sec > 0
        self.items = {status.name: status for status in message.status}

    def until(self, name: str, level: bytes, words: str = "") -> None:
        """Wait until an item has a level and says something."""

        def so() -> bool:
            item = self.items.get(name)
            return item is not None and item.level == level and words in item.message

        self.here.until(so, f"diagnostics have {name!r} with {words!r}")


def refused(here: Desk, *settings: str, preset: str = "fig11d") -> str:
    """Send a goal that cannot be run; return the reason that the client gets."""
    ended = here.wait(here.send(*settings, preset=preset).get_result_async())
    assert ended.status == GoalStatus.STATUS_ABORTED
    assert ended.result.run_id == ""
    message: str = ended.result.message
    return message


@pytest.mark.full
def test_a_client_gets_the_reason_of_a_refusal_and_a_chosen_cell_has_the_bits_of_the_bag(here: Desk) -> None:
    shown = Shown(here)
    here.start("coordinator", "", "-p", "goal_wait:=1.0")
    goal = "/bow/coordinator: goal"
    assert "preset 'nope'" in refused(here, preset="nope")
    shown.until(goal, DiagnosticStatus.WARN, "preset 'nope'")
    assert "f_asym" in refused(here, "f_asym=-1")
    assert "no recorder is heard, no classifier is heard within 1 s; start both" in refused(here)
    shown.until(goal, DiagnosticStatus.WARN, "no recorder is heard")
    inspector = here.node.create_client(InspectCell, "inspect_cell")
    assert inspector.wait_for_service(30)
    assert "no sweep is open" in ask(here, inspector, cell=3).message

    recorder = here.start("recorder")
    here.start("classifier")
    here.until(lambda: are_heard_by_coordinator(here, "recorder", "classifier"), "the coordinator hears both")
    handle = here.send()
    here.until(lambda: any(m.role == "coordinator" and m.run_id for m in here.health.values()), "the run opens")
    assert "is not finished; one sweep at a time" in refused(here)
    shown.until("/bow/coordinator: sweep", DiagnosticStatus.OK, "0 of 128 cells done")
    shown.until("/bow/coordinator: health", DiagnosticStatus.WARN, "no simulator is heard")

    seen = Seen(here)
    clouds: list[PointCloud2] = []
    here.node.create_subscription(PointCloud2, "basin_map/points", clouds.append, LATCHED)
    sweep = Sweep.from_spec("fig11d", ["x.count=16", "y.count=8", "block_cells=8"])
    by_values = ask(here, inspector, at=["f_asym=3.1", "f_init_ratio=0.67"])
    assert by_values.success, by_values.message
    assert by_values.cell == nearest(sweep, 3.1, 0.67)
    assert f"cell {by_values.cell}: f_asym = {by_values.x:.4g}" in by_values.message
    assert by_values.run_id == next(m.run_id for m in here.health.values() if m.role == "coordinator")
    seen.until_whole(by_values.cell, sweep, lambda: ask(here, inspector, cell=by_values.cell))

    dashboard = here.start("dashboard")  # later than the first choice
    here.until(lambda: state_of(here, dashboard.pid) == Health.BUSY, "the dashboard shows the run")
    clicks = here.node.create_publisher(PointStamped, "/clicked_point", 10)
    here.until(lambda: clicks.get_subscription_count() > 0, "the coordinator takes clicks")
    clicks.publish(point(5.5, 2.5, "basin_map"))
    seen.until_whole(2 * 16 + 5, sweep)
    clicks.publish(point(5.5, 2.5, "odom"))
    shown.until("/bow/coordinator: inspection", DiagnosticStatus.WARN, "frame 'odom': should be in 'basin_map'")
    answer = ask(here, inspector, at=["f_asym=99", "f_init_ratio=1"])
    assert not answer.success
    assert "the nearest is 20" in answer.message

    here.start("simulator", "sim")
    result = here.wait(handle.get_result_async()).result
    assert result.cells_done == 128, result.message
    verified(Path(result.directory))
    here.until(lambda: bool(clouds), "the map is published as points")
    assert (clouds[-1].height, clouds[-1].width, clouds[-1].header.frame_id) == (8, 16, "basin_map")
    recorded = in_the_bag(Path(result.directory) / "bag", set(seen.force))
    assert set(recorded) >= {by_values.cell, 37}
    for cell, chunks in seen.force.items():  # the simulator publishes one too, of which a viewer may miss some
        for chunk, force in chunks.items():
            assert recorded[cell][chunk].tobytes() == force.tobytes(), (cell, chunk)

    here.until(lambda: state_of(here, dashboard.pid) == Health.CLOSED, "the dashboard has drawn it")
    for cell, chunks in recorded.items():
        drawn = rows(Path(result.directory) / "dashboard.rrd", f"waveform/cell_{cell}", "Scalars:scalars")
        force = np.array([value for _, values in drawn for value in values], np.float32)
        np.testing.assert_array_equal(force, np.concatenate([force for _, force in sorted(chunks.items())]))

    recorder.kill()
    recorder.wait()
    shown.until("/bow/recorder: health", DiagnosticStatus.STALE, "not heard any more")
    assert shown.stamped
    assert shown.items["/bow/recorder: health"].hardware_id
    here.processes.pop("recorder")


def are_heard_by_coordinator(here: Desk, *labels: str) -> bool:
    """Return whether the coordinator's heartbeats say that those of nodes arrive."""
    heard = [words.split()[0] for m in here.health.values() if m.role == "coordinator" for words in m.hears]
    return all(here.incarnation(label) in heard for label in labels)


def state_of(here: Desk, pid: int) -> int:
    """Return the latest state of a process's node; -1 if it was not heard."""
    return here.health[pid].state if pid in here.health else -1


def ask(here: Desk, client: Any, **request: Any) -> Any:
    return here.call(client, InspectCell.Request(**request))


def nearest(sweep: Sweep, x: float, y: float) -> int:
    """Return the cell with the values that are nearest, x by its ratio."""
    ix = int(np.argmin(np.abs(np.log(sweep.x.values() / x))))
    return int(np.argmin(np.abs(sweep.y.values() - y))) * sweep.x.count + ix


def point(x: float, y: float, frame: str) -> PointStamped:
    made = PointStamped()
    made.header.frame_id = frame
    made.point.x, made.point.y = x, y
    return made


class Seen:
    """What a viewer takes from `inspect`: cell -> chunk -> samples."""

    def __init__(self, here: Desk) -> None:
        self.here = here
        self.force: dict[int, dict[int, np.ndarray]] = {}
        patient = QoSProfile(depth=500, reliability=ReliabilityPolicy.BEST_EFFORT)
        subscription = here.node.create_subscription(InspectedCell, "inspect", self.take, patient, raw=True)
        here.until(
            lambda: here.node.count_publishers(subscription.topic_name) > 0, "the publisher of inspect is discovered"
        )

    def take(self, data: bytes) -> None:
        values = cdr.unseal("InspectedCell", data)
        self.force.setdefault(values["cell"], {})[values["chunk"]] = np.array(values["bridge_force"])

    def until_whole(self, cell: int, sweep: Sweep, choose: Callable[[], object] = lambda: None) -> None:
        """Wait for all of a chosen cell; choose it again, as the publisher may know of a new viewer too late."""
        chosen = time.monotonic()

        def is_whole() -> bool:
            nonlocal chosen
            there = len(self.force.get(cell, ())) == sweep.chunks
            if not there and time.monotonic() > chosen + 5:
                choose()
                chosen = time.monotonic()
            return there

        self.here.until(is_whole, f"cell {cell} arrives whole")


def in_the_bag(bag: Path, cells: set[int]) -> dict[int, dict[int, np.ndarray]]:
    """Return the samples of some cells as recorded: cell -> chunk -> samples."""
    found: dict[int, dict[int, np.ndarray]] = {cell: {} for cell in cells}
    for message in messages(bag):
        if message.topic.endswith("bridge_force"):
            values = cdr.unseal("BridgeForce", message.data)
            rows = values["data"].reshape(len(values["cells"]), values["samples"])
            for cell, row in zip(values["cells"].tolist(), rows, strict=True):
                if cell in cells:
                    found[cell][values["chunk"]] = np.array(row)
    return found
