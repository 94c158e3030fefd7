"""The state file of a standing graph: believed only while its process is there, and only in a folder of this user."""

from __future__ import annotations

import json
import os
import stat
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from bow_sim.graph.process_stat import start_of
from bow_sweep.cli.parser import parser
from bow_sweep.processes.supervisor import GraphError
from bow_sweep.run.places import Place, write_place
from bow_sweep.standing import state as module
from bow_sweep.standing.fits import objection
from bow_sweep.standing.state import (
    FILE,
    PLACES,
    State,
    boot,
    default_folder,
    left_out,
    make_folder,
    note_left_out,
    read_state,
    sources,
)


@pytest.fixture
def state() -> State:
    """A graph that this very process keeps."""
    pid = os.getpid()
    return State(
        pid=pid,
        started=start_of(pid) or 0,
        boot=boot(),
        since=time.time(),
        namespace="/bow/aaaaaaaa",
        domain=os.environ.get("ROS_DOMAIN_ID", "0"),
        version=module_version(),
        sources=sources(),
        simulators=2,
        dashboard=True,
        root="/runs",
    )


def module_version() -> str:
    import importlib.metadata

    return importlib.metadata.version("bow")


def test_a_graph_is_read_as_it_was_written(tmp_path: Path, state: State) -> None:
    make_folder(tmp_path / "graph")
    state.write(tmp_path / "graph")
    assert read_state(tmp_path / "graph") == state
    assert read_state(tmp_path / "none") is None


def test_the_state_file_of_a_graph_from_before_it_had_stations_is_read(tmp_path: Path, state: State) -> None:
    make_folder(tmp_path)
    state.write(tmp_path)
    content = json.loads((tmp_path / FILE).read_text())
    del content["stations"]
    (tmp_path / FILE).write_text(json.dumps(content))
    assert read_state(tmp_path) == state
    del content["namespace"]
    (tmp_path / FILE).write_text(json.dumps(content))
    assert read_state(tmp_path) is None


def test_a_graph_serves_who_asks_for_its_number_of_stations_or_for_none(state: State) -> None:
    divided = replace(state, stations=2)
    wanted = {"simulators": None, "dashboard": False, "watched": False}
    assert objection(divided, **wanted) == objection(divided, **wanted, stations=2) == ""
    assert objection(divided, **wanted, stations=3) == "it has 2 stations, --stations asks for 3"


def test_a_station_joins_a_standing_graph_and_not_one_of_its_runs(
    tmp_path: Path, state: State, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    folder, run_id = default_folder(), "a" * 16
    make_folder(folder)
    state.write(folder)
    write_place(folder / PLACES, run_id, Place(tmp_path / "run"))
    args = parser().parse_args(["station", "lab", "--run", run_id])
    assert args.run(args) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith(f"the graph of `bow up`: a station joins that, for all of its runs, by --run {'a' * 8}")


def test_a_state_file_that_a_power_cut_left_is_no_graph(tmp_path: Path, state: State) -> None:
    make_folder(tmp_path)
    replace(state, boot="an earlier boot").write(tmp_path)
    assert read_state(tmp_path) is None


def test_another_process_with_the_number_is_no_graph(tmp_path: Path, state: State) -> None:
    make_folder(tmp_path)
    replace(state, started=state.started + 1).write(tmp_path)
    assert read_state(tmp_path) is None
    with subprocess.Popen([sys.executable, "-c", ""]) as gone:
        pass
    replace(state, pid=gone.pid).write(tmp_path)
    assert read_state(tmp_path) is None


@pytest.mark.parametrize("content", [b"", b"[]", b"{}", b'{"pid": 1}'])
def test_a_state_file_that_is_none_is_no_graph(tmp_path: Path, content: bytes) -> None:
    (tmp_path / FILE).write_bytes(content)
    assert read_state(tmp_path) is None


def test_a_folder_that_others_can_write_is_refused(tmp_path: Path, state: State) -> None:
    make_folder(tmp_path)
    state.write(tmp_path)
    assert stat.S_IMODE(tmp_path.stat().st_mode) == 0o700
    tmp_path.chmod(0o770)
    with pytest.raises(GraphError, match="others can write it"):
        read_state(tmp_path)


def test_the_folder_is_of_this_machine_and_where_the_environment_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", "/elsewhere")
    monkeypatch.setattr(module.socket, "gethostname", lambda: "host")
    assert default_folder() == Path("/elsewhere/bow/graph-host")
    monkeypatch.setenv("XDG_STATE_HOME", "relative, which the specification has one ignore")
    assert default_folder() == Path.home() / ".local/state/bow/graph-host"


def test_a_graph_fits_only_what_it_can_serve(state: State, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = {"simulators": None, "dashboard": True, "watched": False}
    assert objection(state, **plain) == ""
    assert objection(state, **{**plain, "simulators": 2}) == ""
    assert "--simulators" in objection(state, **{**plain, "simulators": 3})
    assert "--view" in objection(state, **{**plain, "watched": True})
    assert "--no-sync" in objection(state, **plain, sync=False)
    assert "--no-lock" in objection(state, **plain, lock=False)
    assert "dashboard" in objection(replace(state, dashboard=False), **plain)
    assert objection(replace(state, dashboard=False), **{**plain, "dashboard": False}) == ""
    assert "has changed" in objection(replace(state, sources="other"), **plain)
    assert "has changed" in objection(replace(state, version="0.0.0"), **plain)
    assert "domain" in objection(replace(state, domain="99"), **plain)
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    assert "this machine" in objection(state, **plain)
    assert objection(replace(state, network={"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}), **plain) == ""
    assert "other machines" in objection(replace(state, network={"ROS_STATIC_PEERS": "10.0.0.2"}), **plain)


def test_the_hash_of_the_sources_changes_with_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake = tmp_path / "bow_sweep" / "standing" / "state.py"
    fake.parent.mkdir(parents=True)
    fake.write_text("a")
    monkeypatch.setattr(module, "__file__", str(fake))
    before = sources()
    assert sources() == before
    fake.write_text("longer")
    assert sources() != before


def test_nodes_that_a_graph_goes_on_without_are_written_down(tmp_path: Path) -> None:
    assert left_out(tmp_path) == {}
    note_left_out(tmp_path, "dashboard", "exit status 1", tmp_path / "dashboard.log")
    note_left_out(tmp_path, "other", "killed", tmp_path / "other.log")
    assert left_out(tmp_path) == {
        "dashboard": ("exit status 1", tmp_path / "dashboard.log"),
        "other": ("killed", tmp_path / "other.log"),
    }
    (tmp_path / "left_out.json").write_text("[1]")
    assert left_out(tmp_path) == {}
