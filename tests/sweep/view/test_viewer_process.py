"""The viewer is a process of its own: on the loopback, away from the working directory and from our Ctrl-C."""

from __future__ import annotations

import importlib.util
import itertools
import json
import os
import socket
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
from rooms import ROOT
from sockets import family, sockets_of

from bow_sweep.view import viewer
from bow_sweep.view.viewer import Screen, Server, Viewer, answers, connections
from bow_sweep.view.wanted import free_port

STUB = """#!{python}
import json, os, sys
print("a line")
print({last!r})
json.dump([sys.argv[1:], os.getsid(0) == os.getpid() or os.getsid(0) == os.getppid()], open({told!r} + ".new", "w"))
os.replace({told!r} + ".new", {told!r})
sys.exit({status})
"""


@pytest.fixture
def told(tmp_path: Path) -> Path:
    return tmp_path / "told"


@pytest.fixture
def program(tmp_path: Path, told: Path, request: pytest.FixtureRequest) -> Path:
    """A program that stands for the viewer: says what it was told, and ends."""
    status, last = request.param
    path = tmp_path / "viewer"
    path.write_text(STUB.format(python=sys.executable, last=last, told=str(told), status=status))
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


def ended(shown: Viewer) -> str:
    deadline = time.monotonic() + 30
    while (why := shown.ended()) is None:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    return why


@pytest.mark.parametrize(
    ("program", "why"),
    [
        ((0, "goodbye"), ""),
        ((3, "no graphics"), "the viewer ended (exit status 3): no graphics"),
        ((0, "Error: no X server"), "the viewer ended (exit status 0): Error: no X server"),
        ((1, ""), "the viewer ended (exit status 1): a line"),
    ],
    indirect=["program"],
)
def test_a_viewer_that_fails_says_why_and_one_that_is_closed_does_not(program: Path, told: Path, why: str) -> None:
    shown = Viewer("run/dashboard.rrd", program=[str(program)])
    assert ended(shown) == why
    words, own_session = json.loads(told.read_text())
    assert words[0] == "run/dashboard.rrd"
    options = dict(itertools.pairwise(words))
    assert (options["--bind"], options["--port"]) == ("127.0.0.1", str(shown.port))
    assert shown.uri == f"rerun+http://127.0.0.1:{shown.port}/proxy"
    assert own_session


@pytest.fixture
def elsewhere(tmp_path: Path) -> Iterator[Path]:
    """A working directory whose modules end whoever imports them."""
    for name in ("random", "os", "subprocess", "rerun_cli", "rerun", "tempfile"):
        (tmp_path / f"{name}.py").write_text('raise SystemExit("mine")')
    before = Path.cwd()
    os.chdir(tmp_path)
    yield tmp_path
    os.chdir(before)


@pytest.mark.parametrize("program", [(0, "goodbye")], indirect=True)
def test_reruns_own_program_takes_nothing_from_the_working_directory(
    elsewhere: Path, program: Path, told: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RERUN_CLI_PATH", str(program))  # rerun's own command runs it in place of its window
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    assert ended(Viewer("some.rrd")) == ""
    assert json.loads(told.read_text())[0][0] == "some.rrd"
    monkeypatch.delenv("RERUN_CLI_PATH")
    assert Path(viewer._program()[0]).is_absolute()


def test_without_the_program_that_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RERUN_CLI_PATH", raising=False)
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(OSError, match="rerun_cli, a part of rerun-sdk, is not installed"):
        Viewer()
    screen = Screen.open(window=True, port=0)
    assert screen.uri == ""
    assert "the map is not shown live: the package rerun_cli" in screen.notes[0]


def test_a_server_listens_on_this_machine_alone_and_ends_when_told(tmp_path: Path) -> None:
    screen = Screen.open(window=False, port=free_port())
    server = screen.process
    assert isinstance(server, Server)
    assert answers(server.uri, 30.0)
    bound = set().union(*(sockets_of(process) for process in family(server.pid)))
    assert {(one.kind, one.address) for one in bound} == {("TCP", "127.0.0.1")}
    assert screen.notes == [f"watch the map grow with: rerun --connect {server.uri}"]
    said: list[str] = []
    screen.close(said.append)
    assert said == []  # nobody is connected
    assert not answers(server.uri, 0.0)


def test_a_server_waits_until_its_viewers_have_everything(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    screen = Screen.open(window=False, port=free_port())
    server = screen.process
    assert isinstance(server, Server)
    assert answers(server.uri, 30.0)
    with socket.create_connection(("127.0.0.1", server.port)):
        while not connections(server.port):
            time.sleep(0.01)
        under_way = iter([[1], [1], [0]])  # bytes that the viewer has not received
        looks: list[int] = []
        monkeypatch.setattr(viewer, "connections", lambda _: looks.append(1) or next(under_way, [0]))
        said: list[str] = []
        screen.close(said.append)
    assert said == ["still serving viewers for up to 20 s; Ctrl-C ends it"]
    assert len(looks) >= 3 + viewer.DELIVERED_S / viewer.LOOK_S - 1
    assert not answers(server.uri, 0.0)


def test_a_server_ends_with_the_process_that_started_it(tmp_path: Path) -> None:
    script = (
        "from bow_sweep.view.viewer import Server\n"
        "import os, signal\n"
        "print(Server(0).pid, flush=True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, cwd=ROOT)
    pid = int(done.stdout)
    deadline = time.monotonic() + 60
    while psutil.pid_exists(pid) and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE:
        assert time.monotonic() < deadline
        time.sleep(0.02)
