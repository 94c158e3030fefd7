"""`bow explore`: what it refuses, and how it starts and ends."""

from __future__ import annotations

import importlib.util
import shutil
import socket
import subprocess
import threading
import urllib.request
from collections.abc import Callable
from pathlib import Path

import explored
import psutil
import pytest
from sockets import sockets_of

from bow_sweep.cli import main
from bow_sweep.explore import saved


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return explored.make_run(tmp_path_factory.mktemp("cli") / "run")


Refused = Callable[..., str]


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Refused:
    """Run a command that is wrong; return its line on stderr."""

    def try_it(*words: str | Path) -> str:
        assert main(["explore", *map(str, words)]) == 2
        said = capsys.readouterr()
        assert said.out == ""
        assert said.err.startswith("bow: ")
        assert said.err.count("\n") == 1
        return said.err

    return try_it


def test_wrong_usage_is_one_clear_line(refused: Refused, run: Path, tmp_path: Path) -> None:
    assert "4 runs given; should be one or two" in refused(run, run, run, run)
    assert "--port 70000: should be 1 ... 65535" in refused(run, "--port", "70000")
    assert "is for --save" in refused(run, "--periods", "5")
    assert "--port and --no-browser do not go with it" in refused(run, "--save", tmp_path / "a.html", "--no-browser")
    assert "cannot write a page as .pdf; should end in .html" in refused(run, "--save", tmp_path / "a.pdf")
    assert "should end in .html" in refused(run, "--save", tmp_path / "page")
    for periods in ("1", "31", "-5"):
        said = refused(run, "--save", tmp_path / "a.html", "--periods", periods)
        assert f"--periods {periods}: should be 2 ... 30" in said
    assert list(tmp_path.iterdir()) == []


def test_a_folder_without_map_and_bag_is_no_run(refused: Refused, tmp_path: Path) -> None:
    assert "has neither map.npz nor bag/" in refused(tmp_path, "--no-browser")
    assert "is no directory" in refused(tmp_path / "nothing", "--save", tmp_path / "a.html")


def test_without_bokeh_it_says_how_to_get_it(refused: Refused, run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "bokeh" else real(name))
    assert "needs Bokeh, which is not installed here; pip install" in refused(run)


def test_a_page_that_would_be_too_large_says_what_fits(
    refused: Refused, run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = tmp_path / "page.html"
    saved.save_page([run], ["run"], page, 2)
    before = page.read_bytes()
    monkeypatch.setattr(saved, "MOST_BYTES", len(before) + 5_000)
    said = refused(run, "--save", page, "--periods", "30")
    fit = int(said.rpartition("--periods ")[2].split()[0])
    assert 2 <= fit < 30
    monkeypatch.setattr(saved, "MOST_BYTES", 1_000_000)
    assert "should be a map of fewer cells" in refused(run, "--save", page)
    assert page.read_bytes() == before  # the old file is as it was
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]


def test_a_large_page_has_fewer_bits(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / "page.html"
    assert "with 16 bits" in saved.save_page([run], ["run"], page, 30)
    monkeypatch.setattr(saved, "MOST_BYTES", page.stat().st_size - 100_000)
    assert "with 8 bits" in saved.save_page([run], ["run"], page, 30)


def test_a_file_that_cannot_be_written_is_said(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explore", str(run), "--save", str(tmp_path / "nowhere" / "a.html")]) == 1
    assert "cannot be written: No such file or directory" in capsys.readouterr().err


@pytest.mark.full
def test_it_listens_on_loopback_only_and_ctrl_c_ends_it(run: Path) -> None:
    with explored.served(run) as serving:
        listening = sockets_of(psutil.Process(serving.process.pid))
        assert {found.address for found in listening} == {"127.0.0.1"}
        with urllib.request.urlopen(serving.address, timeout=60) as answer:
            assert b"bow explore: run" in answer.read()
        handshake = (
            f"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{serving.port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\nOrigin: http://evil.example\r\n\r\n"
        )
        with socket.create_connection(("127.0.0.1", serving.port), timeout=60) as stranger:
            stranger.sendall(handshake.encode())
            assert b" 403 " in stranger.recv(100)
        assert serving.interrupt() == 0


@pytest.mark.full
def test_a_port_that_is_taken_is_said(run: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        words = explored.command(run, "--port", str(port), "--no-browser")
        said = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False)
        assert (said.returncode, said.stdout) == (2, "")
        what = f"bow: --port {port}: is taken on 127.0.0.1; should be another one, or left out for a free one\n"
        assert said.stderr == what


def test_without_a_display_the_address_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    from bow_sweep.explore import browser

    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    browser.open_in_browser("http://127.0.0.1:1/", said.append)
    assert said == ["there is no display here"]
    monkeypatch.setenv("BROWSER", "false %s")
    browser.open_in_browser("http://127.0.0.1:1/", said.append)
    for thread in [each for each in threading.enumerate() if each.name == "browser"]:
        thread.join(60)
    assert said[1:] in (["the browser could not be started"], ["no browser is found"])


def test_a_run_without_a_bag_is_shown_computed_again(run: Path, tmp_path: Path) -> None:
    bare = tmp_path / "bare"
    shutil.copytree(run, bare, ignore=shutil.ignore_patterns("bag"))
    said = saved.save_page([bare], ["bare"], tmp_path / "a.html", None)
    assert "48 cells were computed again: there is no bag" in said
