"""The recording as a viewer receives it while it is written; the file does not depend on the viewer."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from example_maps import basin_map, outline, settings
from read_rrd import entities, rows, verify

from bow_sweep.maps.plane import Snapshot
from bow_sweep.view import rerun_recording
from bow_sweep.view.rerun_recording import RunRecording
from bow_sweep.view.viewer import Server, answers, connections, uri_of
from bow_sweep.view.wanted import free_port


def snapshot(computed: int | None = None) -> Snapshot:
    return Snapshot.from_message(basin_map(computed=computed)).with_plan(settings(), "fig11d")


def recording(path: Path, **options) -> RunRecording:
    return RunRecording(path, Snapshot.empty(outline()), **options)


@pytest.fixture
def path(tmp_path) -> Path:
    return tmp_path / "dashboard.rrd"


@pytest.fixture
def server():
    made = Server(0)
    assert answers(made.uri, 60.0)
    yield made
    made.stop()


def test_viewers_that_come_late_get_everything_also_when_the_dashboard_has_ended(path, tmp_path, server):
    shown = recording(path, uri=server.uri)
    shown.map(snapshot(computed=12))
    shown.map(snapshot())
    shown.status("the end")
    shown.finish()
    assert verify(path) == ""
    got = tmp_path / "got.rrd"
    viewer = subprocess.Popen(
        [sys.executable, "-m", "rerun", "--connect", server.uri, "--save", str(got)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,  # the viewer is a child of this process
    )
    try:
        deadline = 60.0
        while deadline > 0 and not (got.exists() and _holds(got, "account")):
            try:
                viewer.wait(0.5)
            except subprocess.TimeoutExpired:
                deadline -= 0.5
        assert len(connections(server.port)) == 1
    finally:
        os.killpg(viewer.pid, signal.SIGTERM)
        viewer.wait()
    assert [value for _, value in rows(got, "account", "TextDocument:text")] == [["the end"]]
    assert len(rows(got, "map/picture", "Image:buffer")) == 3


def test_the_file_is_whole_where_the_viewer_goes_away(path, server):
    said: list[str] = []
    shown = recording(path, uri=server.uri, warn=said.append)
    shown.map(snapshot(computed=12))
    shown.flush()
    server.stop()
    for computed in (16, 20, 24):
        shown.map(snapshot(computed=computed))
        shown.flush()
    shown.map(snapshot())
    shown.finish()
    assert said == ["the viewer is gone; dashboard.rrd is written on"]
    assert verify(path) == ""
    assert len(rows(path, "map/picture", "Image:buffer")) == 6


def test_a_viewer_that_is_stopped_holds_nobody_up(path, server, monkeypatch):
    monkeypatch.setattr(rerun_recording, "DELIVER_S", 0.5)
    shown = recording(path, uri=server.uri, warn=lambda _: None)
    os.kill(server.pid, signal.SIGSTOP)
    for _ in range(200):
        shown.map(snapshot())
    shown.finish()
    assert verify(path) == ""
    assert len(rows(path, "map/picture", "Image:buffer")) == 201
    os.kill(server.pid, signal.SIGCONT)


def test_where_no_viewer_is_the_file_is_written_and_that_is_said(path, monkeypatch):
    monkeypatch.setattr(rerun_recording, "ANSWER_S", 0.1)
    said: list[str] = []
    nobody = uri_of(free_port())
    shown = recording(path, uri=nobody, warn=said.append)
    shown.map(snapshot())
    shown.finish()
    assert said == [f"the map is not shown live: nothing listens at {nobody}"]
    assert verify(path) == ""


def _holds(path: Path, entity: str) -> bool:
    try:
        return entity in entities(path)
    except Exception:
        return False
