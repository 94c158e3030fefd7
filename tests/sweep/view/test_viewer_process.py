"""The viewer is a process of its own: on the loopback, away from the working directory and from our Ctrl-C."""

from __future__ import annotations

import json
import os
import stat
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from bow_sweep.view import viewer
from bow_sweep.view.viewer import Viewer

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
    assert ended(Viewer("rerun+http://127.0.0.1:1/proxy", [str(program)])) == why
    words, own_session = json.loads(told.read_text())
    assert words[:4] == ["--connect", "rerun+http://127.0.0.1:1/proxy", "--bind", "127.0.0.1"]
    assert words[4] == "--port"
    assert int(words[5]) > 1023
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
    assert ended(Viewer("rerun+http://127.0.0.1:1/proxy")) == ""
    assert json.loads(told.read_text())[0][0] == "--connect"


def test_without_the_program_that_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewer.importlib.util, "find_spec", lambda _: None)
    with pytest.raises(OSError, match="rerun_cli, a part of rerun-sdk, is not installed"):
        Viewer("rerun+http://127.0.0.1:1/proxy")
