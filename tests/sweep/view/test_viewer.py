"""The recording in the real viewer, without a window: no view complains, and what it paints is what was logged."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from example_maps import HELMHOLTZ, SLIP, basin_map, inspection, map_file, plan
from live_viewer import HeadlessViewer, eventually, headless_viewer, needs_vulkan

from bow_sim.protocol import cdr
from bow_sim.protocol.verdict_fields import PENDING
from bow_sweep.figures.colours import GREY, transient_colours
from bow_sweep.maps.map_file import MAP, write_map_npz
from bow_sweep.view.live_run import LiveRun
from bow_sweep.view.tests_over_time import LEDGER

VIEWS = {"/map", "/tests/correlation", "/tests/slips", "/tests/corners", "/regime", "/counts", "/account", "/scope"}
VIEWS |= {"/waveform/cell_35", "/waveform/cell_70"}

Colour = Sequence[int] | np.ndarray
NEVER, FIVE, FIFTY = (0, 0, 0), transient_colours(5, 100), transient_colours(50, 100)


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


@pytest.fixture
def viewer(shown: Path) -> Iterator[HeadlessViewer]:
    needs_vulkan()
    with headless_viewer() as viewer:
        viewer.open(str(shown))
        origins = lambda: {view.origin for view in viewer.client.get_state().views}
        eventually(lambda: origins() >= VIEWS, f"the viewer has {', '.join(sorted(VIEWS))}")
        yield viewer


def near(picture: np.ndarray, colour: Colour, slack: int = 6) -> np.ndarray:
    """Which pixels of a picture have a colour, within `slack` in each channel, (height, width) bool."""
    found: np.ndarray = abs(picture - np.array(colour)).max(axis=-1) <= slack
    return found


def share_of(viewer: HeadlessViewer, colour: Colour) -> float:
    """The share of the map's view that has a colour."""
    return float(near(viewer.picture("/map"), colour).mean())


def is_right_way_up(painted: np.ndarray) -> bool:
    """Whether a picture shows the map, with its rows where they should be: the pending one has the highest y."""
    cells = painted[:, : int(0.75 * painted.shape[1])]  # beside it is the scale
    rows = [np.argwhere(near(cells, colour))[:, 0] for colour in (GREY, FIFTY, NEVER)]
    if not all(map(len, rows)):
        return False
    pending, fifty, never = (float(found.mean()) for found in rows)  # they count downwards
    lowest = painted[int(never) :]
    return pending < fifty < never and bool(near(lowest, FIVE).any())  # the first cell, at the bottom left


@pytest.mark.full
def test_every_view_is_there_and_none_complains(viewer: HeadlessViewer) -> None:
    lines = {"log_time", "sweep", "sample", "test"}
    recording = lambda: viewer.client.get_state().recordings[0]
    eventually(lambda: {timeline.name for timeline in recording().timelines} == lines, f"the timelines are {lines}")
    assert recording().current_timeline == "sweep"
    assert viewer.complaints() == {}


@pytest.mark.full
def test_the_map_is_painted_the_right_way_up_in_its_colours(viewer: HeadlessViewer) -> None:
    eventually(lambda: is_right_way_up(viewer.picture("/map")), "the map is the right way up")
    assert share_of(viewer, GREY) > 0.03


@pytest.mark.full
def test_maps_stay_while_waveforms_are_scrubbed(viewer: HeadlessViewer) -> None:
    eventually(lambda: is_right_way_up(viewer.picture("/map")), "the map is the right way up")
    shares = lambda: [share_of(viewer, colour) for colour in (GREY, FIFTY)]
    before = shares()
    viewer.client.set_time("sample", sequence=5000)
    timeline = lambda: viewer.client.get_state().recordings[0].current_timeline
    eventually(lambda: timeline() == "sample", "the time is that of the waveforms")
    assert viewer.complaints() == {}
    eventually(lambda: shares() == pytest.approx(before, abs=0.01), "the map is as it was")


@pytest.mark.full
def test_the_map_of_each_test_has_its_colours_in_whatever_order_one_looks(viewer: HeadlessViewer) -> None:
    def after(periods: int) -> None:
        viewer.client.set_time("test", sequence=periods, play_state="paused")

    def comes_to(colour: Colour, share: float, rel: float) -> None:
        eventually(lambda: share_of(viewer, colour) == pytest.approx(share, rel=rel), f"{share} of it is {colour}")

    after(0)
    eventually(lambda: share_of(viewer, GREY) > 0.3, "no cell is computed")
    whole = share_of(viewer, GREY)
    after(5)
    comes_to(NEVER, 7 / 8 * whole, rel=0.1)  # of eight rows the last is pending
    for _ in range(2):
        after(50)
        comes_to(FIFTY, 5 / 8 * whole, rel=0.1)
        after(0)
        comes_to(GREY, whole, rel=0.02)
