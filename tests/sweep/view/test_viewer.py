"""The recording in the real viewer, without a window: no view complains, and what it paints is what was logged."""

from __future__ import annotations

import io
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from example_maps import HELMHOLTZ, SLIP, basin_map, inspection, map_file, plan
from live_viewer import needs_vulkan, spawned_viewer
from PIL import Image

from bow_sim.protocol import cdr
from bow_sim.protocol.verdict_fields import PENDING
from bow_sweep.figures.colours import GREY, transient_colours
from bow_sweep.maps.map_file import MAP, write_map_npz
from bow_sweep.view.live_run import LiveRun
from bow_sweep.view.tests_over_time import LEDGER

SETTLE_S = 2.0


@pytest.fixture(scope="module")
def shown(tmp_path_factory) -> Path:
    """A finished recording of a small map, some of it pending, with two inspected cells."""
    show = LiveRun(tmp_path_factory.mktemp("run"), plan(nx=16, ny=8), warn=pytest.fail)
    for computed in (32, 64, 112):
        show._next_draw_at = 0.0
        show.map(basin_map(16, 8, computed))
        time.sleep(0.05)
    for chunk in range(20):
        for cell in (35, 70):
            show.inspect(cdr.unseal("InspectedCell", inspection(cell, chunk)))
    result = map_file(16, 8, computed=112)
    tested = ~np.isnan(result.transient_periods)
    regimes = np.where(tested, np.where(result.helmholtz, HELMHOLTZ, SLIP), PENDING).astype(np.uint8)
    directory = show.recording.path.parent
    (directory / LEDGER).touch()
    confidence = np.full(regimes.shape, 0.9, np.float32)
    write_map_npz(directory / MAP, replace(result, regimes=regimes, confidence=confidence))
    show.plan(plan(2, nx=16, ny=8, done=14))
    show.finish([])
    return show.recording.path


@pytest.fixture(scope="module")
def viewer(shown):
    needs_vulkan()
    with spawned_viewer() as client:
        client.open(str(shown))
        time.sleep(SETTLE_S)
        yield client


def picture(viewer, view: str) -> np.ndarray:
    """What a view paints, (height, width, 3)."""
    identity = next(entry.view_id for entry in viewer.get_state().views if entry.origin == f"/{view}")
    with Image.open(io.BytesIO(viewer.take_screenshot(identity))) as screenshot:
        return np.asarray(screenshot.convert("RGB")).astype(int)


def share_of(picture: np.ndarray, colour, slack: int = 6) -> float:
    """The share of a picture that has a colour, within `slack` in each channel."""
    return float((abs(picture - np.array(colour)).max(axis=-1) <= slack).mean())


@pytest.mark.full
def test_every_view_is_there_and_none_complains(viewer):
    state = viewer.get_state()
    origins = {view.origin for view in state.views}
    assert {"/map", "/tests/correlation", "/tests/slips", "/tests/corners", "/regime"} <= origins
    assert {"/counts", "/account", "/scope", "/waveform/cell_35", "/waveform/cell_70"} <= origins
    assert {view.name: view.reports for view in state.views if view.reports} == {}
    assert state.recordings[0].current_timeline == "sweep"
    assert {timeline.name for timeline in state.recordings[0].timelines} == {"log_time", "sweep", "sample", "test"}


@pytest.mark.full
def test_the_map_is_painted_the_right_way_up_in_its_colours(viewer):
    painted = picture(viewer, "map")
    where = {
        name: np.argwhere(abs(painted - np.array(colour)).max(axis=-1) <= 6)
        for name, colour in {"never": (0, 0, 0), "pending": GREY, "fifty": transient_colours(50, 100)}.items()
    }
    width = painted.shape[1]
    middle = {name: places[places[:, 1] < 0.75 * width][:, 0].mean() for name, places in where.items()}  # not the scale
    assert middle["pending"] < middle["fifty"] < middle["never"]  # rows count downwards: pending is the highest y
    assert share_of(painted, GREY) > 0.03
    lowest = painted[int(middle["never"]) :, :]
    assert share_of(lowest, transient_colours(5, 100)) > 0  # the first cell, at the bottom left


@pytest.mark.full
def test_maps_stay_while_waveforms_are_scrubbed(viewer):
    before = picture(viewer, "map")
    viewer.set_time("sample", sequence=5000)
    time.sleep(SETTLE_S)
    state = viewer.get_state()
    assert state.recordings[0].current_timeline == "sample"
    assert {view.name: view.reports for view in state.views if view.reports} == {}
    again = picture(viewer, "map")
    for colour in (GREY, transient_colours(50, 100)):
        assert share_of(again, colour) == pytest.approx(share_of(before, colour), abs=0.01)


@pytest.mark.full
def test_the_map_of_each_test_has_its_colours_in_whatever_order_one_looks(viewer):
    def shown(periods: int, colour) -> float:
        viewer.set_time("test", sequence=periods, play_state="paused")
        time.sleep(SETTLE_S)
        return share_of(picture(viewer, "map"), colour)

    whole = shown(0, GREY)
    assert whole > 0.3
    assert shown(5, (0, 0, 0)) == pytest.approx(7 / 8 * whole, rel=0.1)  # of eight rows the last is pending
    for _ in range(2):
        assert shown(50, transient_colours(50, 100)) == pytest.approx(5 / 8 * whole, rel=0.1)
        assert shown(0, GREY) == pytest.approx(whole, rel=0.02)
