"""Nodes started by hand, and what else happens in their namespace: doubles, played bags, remaps, clocks, parameters."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from bow_msgs.msg import Verdicts
from desk import Desk, desk
from graph import assert_same_map, verified
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from bow_sim.graph.node_base import STREAM
from bow_sim.protocol import cdr
from bow_sim.protocol.messages import STREAMS
from bow_sim.protocol.verdict_fields import VERDICT_FIELDS
from bow_sweep.record.bag import BagMessage, messages
from bow_sweep.record.node import _class_of
from bow_sweep.record.topics import TOPICS, full_names

pytestmark = pytest.mark.usefixtures("ros_domain")


def test_the_second_of_a_kind_is_named_and_gives_way_and_the_sweep_goes_on(undisturbed: Path, tmp_path: Path) -> None:
    with desk(tmp_path) as here:
        here.start_all()
        here.gate.write_text("200")  # two and a half blocks
        goal = here.send("periods=400")
        here.until(lambda: any(m.held_blocks for m in here.health.values()), "the simulator is at work")
        second = {
            "coordinator": here.start("coordinator"),
            "recorder": here.start("recorder", "another_recorder"),
            "classifier": here.start("classifier"),
            "sim": here.start("simulator", "sim"),
        }
        here.until(lambda: all(p.poll() is not None for p in second.values()), "the second of each kind has ended")
        assert {label: process.returncode for label, process in second.items()} == dict.fromkeys(second, 1)
        for label in ("coordinator+", "another_recorder", "classifier+", "sim+"):
            assert "is there already (process " in here.text(label)
        here.gate.unlink()
        result = here.wait(goal.get_result_async()).result
        assert result.cells_done == result.cells_planned == 128
        verified(Path(result.directory))
        assert_same_map(undisturbed, here.sweep())
        for label in ("coordinator", "recorder", "classifier", "sim"):
            assert here.processes[label].poll() is None
            assert "restarted" not in here.text(label)
            assert "Traceback" not in here.text(label)


def play(here: Desk, bag: Path, speed: float, before: Callable[[BagMessage], object] = lambda _: None) -> int:
    """Publish each message of a bag on its own topic at recorded times, as `ros2 bag play` does; return how many.

    `before` is called with each message before it is published.
    """
    publishers: dict[str, Any] = {}
    for name, topic in TOPICS.items():
        qos = QoSProfile(
            depth=1000,
            reliability=ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy[topic.qos.durability.upper()],
        )
        publishers[name] = here.node.create_publisher(_class_of(topic), full_names()[name], qos)
    judged = [publishers[name] for name in ("health", "plan", "bridge_force", "stick_slip")]
    here.until(lambda: all(each.get_subscription_count() for each in judged), "the player is matched")
    first, began, count = 0, time.monotonic(), 0
    for message in messages(bag):
        first = first or message.log_time
        while time.monotonic() - began < (message.log_time - first) / 1e9 / speed:
            here.executor.spin_once(timeout_sec=0.01)
        before(message)
        publishers[message.topic].publish(bytes(message.data))
        count += 1
    here.executor.spin_once(timeout_sec=0.1)
    return count


@pytest.mark.full
def test_a_bag_that_is_played_to_a_classifier_alone_is_judged_as_in_its_run(undisturbed: Path, tmp_path: Path) -> None:
    recorded: dict[tuple[int, int], dict[str, Any]] = {}
    again: dict[tuple[int, int], dict[str, Any]] = {}
    for message in messages(undisturbed / "bag"):
        if message.topic == "verdicts":
            values = cdr.decode("Verdicts", message.data)
            recorded[values["block"], values["chunk"]] = values

    def take(data: bytes) -> None:
        values = cdr.decode("Verdicts", data)
        if values["incarnation"] == here.incarnation("classifier") and len(values["cells"]):  # no hello
            again[values["block"], values["chunk"]] = values

    played: dict[str, set[tuple[int, int]]] = {"bridge_force": set(), "stick_slip": set()}

    def wait_for_verdicts(message: BagMessage) -> None:
        """A plan that says that a block is done comes, as in a run, after the verdicts of the block."""
        if message.topic == "plan":
            both = played["bridge_force"] & played["stick_slip"]
            here.until(lambda: again.keys() >= both, "what was played is judged")
        elif message.topic in played:
            values = cdr.decode_head(STREAMS[message.topic], message.data)
            played[message.topic].add((values["block"], values["chunk"]))

    with desk(tmp_path) as here:
        here.node.create_subscription(Verdicts, "/bow/verdicts", take, STREAM, raw=True)
        here.start("classifier")
        here.until(lambda: bool(here.incarnation("classifier")), "the classifier is heard")
        play(here, undisturbed / "bag", 0.5, wait_for_verdicts)
        here.until(lambda: again.keys() == recorded.keys(), "every chunk is judged")
        assert here.processes["classifier"].poll() is None
    for key, values in recorded.items():
        for name in ("checksum", "header.stamp", "attempt", "run_id"):
            assert again[key][name] == values[name]
        assert all(again[key][name].tobytes() == values[name].tobytes() for name in VERDICT_FIELDS)


def content(directory: Path) -> dict[str, str]:
    """Return the files of a directory with what is in them."""
    return {
        str(path.relative_to(directory)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(directory.rglob("*"))
        if path.is_file()
    }


def ignored(here: Desk, role: str) -> int:
    return next(m.ignored for m in here.health.values() if m.role == role and m.pid == here.processes[role].pid)


def test_a_bag_that_is_played_into_a_live_namespace_changes_nothing_and_is_counted(tmp_path: Path) -> None:
    with desk(tmp_path) as here:
        here.start_all()
        finished = here.sweep()
        before = content(finished)
        others = {path.name for path in finished.parent.iterdir()}
        assert play(here, finished / "bag", speed=1.0) > 100  # into an idle graph
        here.until(lambda: ignored(here, "recorder") > 0, "the recorder has counted the plans")
        time.sleep(1)
        assert content(finished) == before
        assert {path.name for path in finished.parent.iterdir()} == others

        here.gate.write_text("200")
        goal = here.send("periods=400", "v_mid=0.3")
        here.until(lambda: any(m.held_blocks for m in here.health.values()), "the sweep is in progress")
        counted = ignored(here, "recorder"), ignored(here, "classifier")
        play(here, finished / "bag", speed=1.0)
        here.gate.unlink()
        result = here.wait(goal.get_result_async()).result
        assert result.cells_done == result.cells_planned == 128, result.message
        here.until(lambda: ignored(here, "recorder") > counted[0], "the recorder has counted")
        here.until(lambda: ignored(here, "classifier") > counted[1], "the classifier has counted")
        account = verified(Path(result.directory))
        assert account["run"] == result.run_id
        assert content(finished) == before
        assert {path.name for path in finished.parent.iterdir()} == {*others, result.run_id}
        assert "restarted" not in here.text("coordinator")


@pytest.mark.parametrize(
    "arguments",
    [
        ["-r", "bridge_force:=/strings/force", "-r", "verdicts:=/strings/verdicts"],
        ["-p", "use_sim_time:=true"],
    ],
    ids=["remapped", "sim_time"],
)
def test_whatever_topics_and_clocks_are_called_the_sweep_goes_on_and_its_bag_is_found(
    arguments: Sequence[str], undisturbed: Path, tmp_path: Path
) -> None:
    with desk(tmp_path, *arguments) as here:
        here.start_all()
        here.until(lambda: all(map(here.incarnation, here.processes)), "all are heard")
        began = time.monotonic()
        run = here.sweep()
        assert time.monotonic() - began < 40  # timers that stand still made a minute of it
        verified(run)
        assert_same_map(undisturbed, run)


def test_parameters_that_are_not_obeyed_cannot_be_set(tmp_path: Path) -> None:
    tried = {
        "coordinator": ("runs_dir", "preset", "run_id", "settings", "once"),
        "recorder": ("runs_dir", "run_dir"),
        "sim": ("credit", "inspect"),
        "dashboard": ("runs_dir", "port", "view", "server_memory"),
    }
    with desk(tmp_path) as here:
        for label in tried:
            here.start("simulator" if label == "sim" else label, label if label == "sim" else "")
        for label, names in tried.items():
            client = here.node.create_client(SetParameters, f"/bow/{label}/set_parameters")
            assert client.wait_for_service(60)
            for name in names:
                value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="/elsewhere")
                request = SetParameters.Request(parameters=[Parameter(name=name, value=value)])
                (answer,) = here.call(client, request).results
                assert not answer.successful, (label, name)
