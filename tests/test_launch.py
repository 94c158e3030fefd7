"""The launch files start the graph they promise.

`launch` and `launch_ros` are not among the ROS wheels: stand-ins take their place. What a launch file comes to in the
end is a list of command lines, and those are run for real.
"""

from __future__ import annotations

import contextlib
import os
import py_compile
import re
import runpy
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml
from checkout import ROOT, assigned
from launch_stand_ins import (
    DeclareLaunchArgument,
    ExecuteProcess,
    SetEnvironmentVariable,
    launched,
    nodes,
    put_in_place,
)

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
LEFT_EARLY = re.compile(r"DATASHARING.* Failed to open segment|RTPS_READER.* Failed to add Writer Proxy .*data sharing")
"""What Fast DDS prints where a node has left before another has opened its shared memory; it has no switch for it."""

# Without stations.launch.py, which starts commands by ssh, no nodes: see test_launchers.py.
FILES = sorted(path for path in (ROOT / "launch").glob("*.launch.py") if path.name != "stations.launch.py")


@pytest.fixture(autouse=True)
def stand_ins(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)  # `runs` is made where `ros2 launch` was typed
    put_in_place(monkeypatch)


# ---- the statements


@pytest.mark.parametrize("file", FILES, ids=lambda path: path.name)
def test_a_launch_file_compiles(file: Path, tmp_path: Path) -> None:
    py_compile.compile(str(file), cfile=str(tmp_path / "compiled"), doraise=True)


def test_the_arguments_are_read_without_our_requirements() -> None:
    """`ros2 launch` runs in the system's Python, which may lack what a virtual environment has."""
    program = f"import sys; sys.path.insert(0, {str(ROOT)!r}); import bow_sweep.processes.launch_arguments"
    subprocess.run([sys.executable, "-I", "-S", "-c", program], check=True)


def test_a_sweep_is_one_node_of_each_kind_and_a_simulator_per_core() -> None:
    graph = nodes(launched("sweep.launch.py"))
    simulators = {f"simulator_{i + 1}" for i in range(len(os.sched_getaffinity(0)))}
    assert set(graph) == {"coordinator", "classifier", "recorder", "dashboard"} | simulators
    assert {node.executable for node in graph.values()} == set(assigned("NODES"))
    assert {node.namespace for node in graph.values()} == {"bow"}


def test_the_number_of_simulators_is_an_argument() -> None:
    graph = nodes(launched("sweep.launch.py", simulators=5))
    assert len([node for node in graph.values() if node.executable == "simulator"]) == 5


def test_preset_and_settings_reach_the_coordinator(tmp_path: Path) -> None:
    given = {"preset": "fig11d", "settings": "v_mid=0.3 x.count=16", "runs_dir": tmp_path, "once": "true"}
    graph = nodes(launched("sweep.launch.py", **given))
    assert graph["coordinator"].given == {
        "preset": "fig11d",
        "settings": ["v_mid=0.3", "x.count=16"],
        "runs_dir": str(tmp_path),
        "once": True,
    }
    assert graph["recorder"].given["runs_dir"] == graph["dashboard"].given["runs_dir"] == str(tmp_path)


@pytest.mark.parametrize("file", [file.name for file in FILES])
def test_a_parameter_has_the_type_it_is_declared_with(file: str, run: Path) -> None:
    """A text stays a text, even where YAML would see a number in it."""
    given: dict[str, object] = {"run": run} if file == "replay.launch.py" else {"preset": "2024", "settings": "1 2"}
    for node in nodes(launched(file, **given)).values():
        given_here = [one for one in node.parameters if isinstance(one, dict)]
        for parameter in (parameter for one in given_here for parameter in one.values()):
            kind = list if isinstance(parameter.value, list) else parameter.value_type
            assert isinstance(parameter.value, kind)


def test_the_run_ends_with_its_coordinator_and_survives_the_others() -> None:
    for node in nodes(launched("sweep.launch.py")).values():
        assert bool(node.on_exit) == (node.executable == "coordinator")
        assert node.respawn == (node.executable != "coordinator")


def environment_of(file: str, run: Path, **given: object) -> dict[str, str]:
    entities = launched(file, **({"run": run} if file == "replay.launch.py" else {}), **given)
    return {one.name: one.value for one in entities if isinstance(one, SetEnvironmentVariable)}


@pytest.mark.parametrize("file", [file.name for file in FILES])
def test_the_graph_stays_on_this_machine_unless_asked(file: str, run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(RANGE, "LOCALHOST")
    assert environment_of(file, run) == {RANGE: "LOCALHOST"}
    assert environment_of(file, run, discovery_range="SUBNET")[RANGE] == "SUBNET"
    for unset in ("", None):
        if unset is None:
            monkeypatch.delenv(RANGE)
        else:
            monkeypatch.setenv(RANGE, unset)
        assert environment_of(file, run)[RANGE] == "LOCALHOST"


@pytest.mark.parametrize("file", [file.name for file in FILES])
def test_what_the_user_has_exported_is_the_default(file: str, run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(RANGE, "SUBNET")
    assert environment_of(file, run)[RANGE] == "SUBNET"
    assert environment_of(file, run, discovery_range="localhost")[RANGE] == "LOCALHOST"


@pytest.mark.parametrize("file", [file.name for file in FILES])
@pytest.mark.parametrize("wrong", ["OFF", "off", "everywhere", "2"])
def test_a_range_in_which_no_node_finds_another_is_refused(
    file: str, wrong: str, run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(RuntimeError, match="LOCALHOST, for this machine alone, or SUBNET is needed"):
        environment_of(file, run, discovery_range=wrong)
    monkeypatch.setenv(RANGE, wrong)
    with pytest.raises(RuntimeError, match=RANGE):
        environment_of(file, run)


@pytest.mark.parametrize("file", [file.name for file in FILES])
def test_the_nodes_take_their_parameters_from_a_file(file: str, run: Path, tmp_path: Path) -> None:
    given: dict[str, object] = {"run": run} if file == "replay.launch.py" else {}
    for node in nodes(launched(file, **given)).values():
        assert node.files == [str(ROOT / "config" / "nodes.yaml")]
        assert node.parameters[0] == node.files[0], "an argument goes before the file"
    mine = tmp_path / "mine.yaml"
    mine.write_text("/**:\n  ros__parameters:\n    credit: 4\n")
    for node in nodes(launched(file, **given, params_file=mine)).values():
        assert node.files == [str(mine)]


def test_an_argument_that_is_not_given_leaves_the_parameter_to_the_file() -> None:
    graph = nodes(launched("sweep.launch.py"))
    assert set(graph["coordinator"].given) == set(graph["dashboard"].given) == {"runs_dir"}


@pytest.mark.parametrize("file", [file.name for file in FILES])
def test_what_ros2_launch_shows_of_an_argument_says_what_it_takes(file: str) -> None:
    """As `ros2 launch --show-args` prints: a description for each, choices where only some words are right."""
    (*declared, _) = runpy.run_path(str(ROOT / "launch" / file))["generate_launch_description"]().entities
    arguments: dict[str, DeclareLaunchArgument] = {argument.name: argument for argument in declared}
    assert {"params_file", "log_level", "dashboard", "use_sim_time", "namespace", "view"} <= set(arguments)
    assert all(argument.description for argument in arguments.values())
    assert arguments["log_level"].choices == ["debug", "info", "warn", "error", "fatal"]
    assert arguments["params_file"].default_value == str(ROOT / "config" / "nodes.yaml")
    for name in ("dashboard", "view", "use_sim_time"):
        assert arguments[name].choices == ["true", "false", "True", "False"]


@pytest.mark.parametrize("file", [file.name for file in FILES])
def test_the_level_of_the_logs_and_the_clock_reach_every_node(file: str, run: Path) -> None:
    given: dict[str, object] = {"run": run} if file == "replay.launch.py" else {}
    for node in nodes(launched(file, **given)).values():
        assert node.ros_arguments == ["--log-level", "info"]
        assert "use_sim_time" not in node.given
    for node in nodes(launched(file, **given, log_level="debug", use_sim_time="true")).values():
        assert node.ros_arguments == ["--log-level", "debug"]
        assert node.given["use_sim_time"] is True


@pytest.mark.parametrize("file", [file.name for file in FILES])
def test_the_dashboard_can_be_left_out(file: str, run: Path) -> None:
    given: dict[str, object] = {"run": run} if file == "replay.launch.py" else {}
    with_it, without = (set(nodes(launched(file, **given, dashboard=word))) for word in ("true", "False"))
    assert with_it - without == {"dashboard"}


def test_a_resumed_run_goes_on_where_it_is_and_ends_the_launch(tmp_path: Path) -> None:
    unfinished = tmp_path / "somewhere" / "mine"
    unfinished.mkdir(parents=True)
    (unfinished / "ledger.jsonl").touch()
    graph = nodes(launched("sweep.launch.py", resume=unfinished))
    assert graph["coordinator"].given["resume"] == str(unfinished)
    assert graph["coordinator"].given["once"] is True
    assert graph["recorder"].given["run_dir"] == graph["dashboard"].given["run_dir"] == str(unfinished)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"simulators": "0"}, "simulators:=0: a whole number from 1 on"),
        ({"simulators": "many"}, "simulators:=many: a whole number"),
        ({"simulators": "1000"}, "simulators:=1000: a whole number from 1 on, to 100"),
        ({"view": "maybe"}, 'Argument "view" provided value "maybe" is not valid'),
        ({"once": "1"}, 'Argument "once" provided value "1" is not valid'),
        ({"log_level": "loud"}, r"Valid options are: \['debug', 'info', 'warn', 'error', 'fatal'\]"),
        ({"dashboard": "no"}, "Valid options are: .'true', 'false', 'True', 'False'"),
        ({"view": "true", "dashboard": "false"}, "view:=true needs the dashboard that dashboard:=false leaves out"),
        ({"resume": "/no/such/run"}, "resume:=/no/such/run: is no directory; that of an unfinished run is needed"),
        ({"resume": "/"}, "resume:=/: has neither ledger.jsonl nor bag/"),
        ({"resume": "/", "preset": "fig11d"}, "resume:=/: a run has its settings; give no preset"),
        ({"runs_dir": "/proc/x"}, "runs_dir:=/proc/x: cannot be made or written"),
        ({"runs_dir": __file__}, "cannot be made or written: File exists; a directory of yours is needed"),
        ({"params_file": "/no/such"}, "params_file:=/no/such: cannot be read: No such file or directory"),
        ({"namespace": "my bow"}, "namespace:=my bow: letters, digits and _ are needed"),
        ({"namespace": ""}, "letters, digits and _ are needed"),
    ],
)
def test_a_wrong_argument_is_named_with_what_would_be_right(wrong: Mapping[str, str], message: str) -> None:
    with pytest.raises(RuntimeError, match=message) as error:
        launched("sweep.launch.py", **wrong)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"rate": "fast"}, "rate:=fast: a number above 0"),
        ({"rate": "0"}, "rate:=0: a number above 0"),
        ({"rate": "nan"}, "rate:=nan: a number above 0"),
        ({"view": "maybe"}, 'Argument "view" provided value "maybe" is not valid'),
        ({"view": "True", "dashboard": "False"}, "view:=true needs the dashboard"),
        ({"namespace": "a-b"}, "namespace:=a-b: letters"),
        ({"run": "/no/such/run"}, "not a complete rosbag2 directory"),
    ],
)
def test_a_wrong_argument_of_a_replay_is_named_too(wrong: Mapping[str, str], message: str, run: Path) -> None:
    with pytest.raises(RuntimeError, match=message) as error:
        launched("replay.launch.py", **{"run": run, **wrong})
    assert len(str(error.value).splitlines()) == 1


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run directory whose bag has a list of topics, and no more."""
    bag = tmp_path / "a run" / "bag"
    bag.mkdir(parents=True)
    names = ("plan", "bridge_force", "stick_slip", "verdicts", "receipts", "basin_map")
    topics = [{"topic_metadata": {"name": f"/bow/{name}"}, "message_count": 1} for name in names]
    information = {"topics_with_message_count": topics, "custom_data": {"bow.version": "3"}}
    (bag / "metadata.yaml").write_text(yaml.dump({"rosbag2_bagfile_information": information}))
    return bag.parent


def test_a_replay_plays_the_recorded_streams_into_a_namespace_of_its_own(run: Path) -> None:
    entities = launched("replay.launch.py", run=run)
    (play,) = (entity for entity in entities if isinstance(entity, ExecuteProcess))
    assert play.cmd[:4] == ["ros2", "bag", "play", str(run / "bag")]
    assert "/bow/bridge_force:=/bow/replay/bridge_force" in play.cmd
    assert not [word for word in play.cmd if "verdicts" in word or "receipts" in word]
    assert set(nodes(entities)) == {"classifier", "dashboard"}
    assert {node.namespace for node in nodes(entities).values()} == {"/bow/replay"}


def test_a_replay_of_no_bag_is_told_so_in_one_line(tmp_path: Path, run: Path) -> None:
    with pytest.raises(RuntimeError, match="not a complete rosbag2 directory"):
        launched("replay.launch.py", run=tmp_path)
    metadata = run / "bag" / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("bow.version", "of_others"))
    with pytest.raises(RuntimeError, match="holds messages of a bow before format 3"):
        launched("replay.launch.py", run=run)
    metadata.write_text("a: [\nb: }")
    with pytest.raises(RuntimeError, match="not a complete rosbag2 directory") as error:
        launched("replay.launch.py", run=run)
    assert len(str(error.value).splitlines()) == 1


@pytest.fixture
def processes() -> Iterator[list[subprocess.Popen[bytes]]]:
    running: list[subprocess.Popen[bytes]] = []
    yield running
    for process in running:
        process.terminate()
    for process in running:
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


Processes = dict[str, "subprocess.Popen[bytes]"]


def start(entities: list[Any], scratch: Path, processes: list[subprocess.Popen[bytes]]) -> Processes:
    """Start the nodes as launch does, each with a log beside."""
    environment = {one.name: one.value for one in entities if isinstance(one, SetEnvironmentVariable)}
    started = {}
    for name, node in nodes(entities).items():
        command = node.command(Path(sys.prefix), scratch)
        with open(scratch / f"{name}.log", "wb") as log:
            started[name] = subprocess.Popen(
                command, stdout=log, stderr=subprocess.STDOUT, env=os.environ | environment, cwd=scratch
            )
        processes.append(started[name])
    return started


def interrupt(process: subprocess.Popen[bytes]) -> None:
    """Send SIGINT as soon as our code has begun, which catches SIGTERM, as Python itself does not."""
    deadline = time.monotonic() + 60
    while process.poll() is None and time.monotonic() < deadline:
        with contextlib.suppress(OSError):
            status = Path(f"/proc/{process.pid}/status").read_text()
            if int(status.partition("SigCgt:")[2].split()[0], 16) >> (signal.SIGTERM - 1) & 1:
                break
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)


def test_a_launch_that_cannot_be_leaves_one_useful_line(
    tmp_path: Path, ros_domain: int, processes: list[subprocess.Popen[bytes]]
) -> None:
    entities = launched("sweep.launch.py", preset="nope", runs_dir=tmp_path / "runs", simulators=2)
    started = start(entities, tmp_path, processes)
    assert started["coordinator"].wait(60) == 1
    for process in started.values():  # what the end of the coordinator sets off, while others may still import
        interrupt(process)
    assert {process.wait(30) for name, process in started.items() if name != "coordinator"} == {0}
    said = "".join((tmp_path / f"{name}.log").read_text() for name in started)
    assert "preset 'nope'" in said
    assert "Traceback" not in said
    assert len([line for line in said.splitlines() if "[INFO]" not in line and not LEFT_EARLY.search(line)]) == 1, said


def test_signals_at_any_moment_of_the_start_leave_no_traces(
    tmp_path: Path, ros_domain: int, processes: list[subprocess.Popen[bytes]]
) -> None:
    entities = launched("sweep.launch.py", runs_dir=tmp_path / "runs", simulators=2)
    started = start(entities, tmp_path, processes)
    for number, process in enumerate(started.values()):
        time.sleep(0.3 * number)
        interrupt(process)
    assert {process.wait(30) for process in started.values()} == {0}
    said = "".join((tmp_path / f"{name}.log").read_text() for name in started)
    assert "Traceback" not in said, said


@pytest.mark.full
def test_the_launched_graph_runs_a_sweep_to_its_end(
    tmp_path: Path, ros_domain: int, processes: list[subprocess.Popen[bytes]]
) -> None:
    settings = "x.count=2 y.count=2 periods=10"
    runs = tmp_path / "runs"
    entities = launched("sweep.launch.py", preset="fig11d", settings=settings, runs_dir=runs, once="true", simulators=2)
    graph, started = nodes(entities), start(entities, tmp_path, processes)
    deadline = time.monotonic() + 120
    while started["coordinator"].poll() is None and time.monotonic() < deadline:
        time.sleep(0.1)
    logs = "\n".join(f"== {name}\n{(tmp_path / f'{name}.log').read_text()[-2000:]}" for name in graph)
    assert started["coordinator"].returncode == 0, logs
    assert {name: process.poll() for name, process in started.items() if name != "coordinator"} == dict.fromkeys(
        set(graph) - {"coordinator"}
    ), logs
    (run,) = runs.iterdir()
    assert (run / "bag" / "metadata.yaml").is_file(), logs
    assert (run / "map.npz").is_file(), logs
