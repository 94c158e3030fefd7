"""What the viewer paints while a sweep runs: every cell in the colour that the legend gives to its value.

One sweep is watched by two viewers: one that is open from its beginning, as `--view` opens it, and one that connects in
the middle of it. There its simulators wait, so that both can be held against the same map. Then its dashboard is
killed, and the next one goes on with file and viewer.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
import rclpy
from bow_msgs.msg import BasinMap
from domains import own_domain
from graph import halted
from live_viewer import (
    PATIENCE_S,
    HeadlessViewer,
    eventually,
    headless_stand_in,
    headless_viewer,
    keep,
    needs_vulkan,
    ports_of,
    run_of,
    shares,
    wrong_cells,
)
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from sockets import family

from bow_sim.graph.discovery import apply_defaults
from bow_sim.graph.node_base import LATCHED
from bow_sim.protocol import cdr
from bow_sweep.maps.map_file import read_map_npz
from bow_sweep.maps.plane import Snapshot
from bow_sweep.view.viewer import uri_of

NX, NY = 24, 12
SWEEP = ["fig11d", "--nx", str(NX), "--ny", str(NY), "--periods", "200", "--set", "block_cells=8", "--simulators", "2"]

HALF = 410
"""Chunks that each of them publishes by then: ten of 36 blocks of 40 chunks."""

LIVE = ("/map", "/tests/correlation", "/tests/slips", "/tests/corners", "/regime")
VIEWS = (*LIVE, "/terrain")

MOST_WRONG = 0.06
"""Share of the cells that may have another colour: those under the marks of inspected cells."""

MOMENTS = {
    "open from the beginning, map half done": LIVE,
    "connected in the middle, map half done": LIVE,
    "open from the beginning, map done": VIEWS,
    "connected after the end": VIEWS,
    "from the file": VIEWS,
}


class Seen:
    """Pictures of views, and the map that they should show."""

    def __init__(self, snapshot: Snapshot) -> None:
        self.snapshot = snapshot
        self.pictures: dict[str, np.ndarray] = {}

    def wrong(self, origin: str) -> float:
        """Return the share of cells in another colour than the legend's."""
        try:
            return float(wrong_cells(origin, self.snapshot, self.pictures[origin]).mean())
        except ValueError:  # no map is to be seen
            return 1.0

    def look(self, viewer: HeadlessViewer, origins: tuple[str, ...]) -> Seen:
        """Take a picture of each view, again and again until it is right, for a while."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline or not self.pictures:
            try:
                viewer.show(*VIEWS)
                self.pictures = viewer.pictures(*VIEWS)
            except (ConnectionError, TimeoutError):  # busy, or the dashboard has sent its layout again
                time.sleep(1.0)
            else:
                if all(self.wrong(origin) <= MOST_WRONG for origin in origins):
                    break
        return self


def latest_map(run: str) -> dict[str, Any]:
    """Return the latest BasinMap of a run that has halted."""
    apply_defaults()
    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node("watcher", namespace=f"/bow/{run}", context=context, enable_rosout=False)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    came: list[bytes] = []
    node.create_subscription(BasinMap, "basin_map", came.append, LATCHED, raw=True)
    try:
        deadline, since = time.monotonic() + 60, time.monotonic()
        while not came or time.monotonic() - since < 2.0:
            assert time.monotonic() < deadline, "no map came"
            before = len(came)
            executor.spin_once(timeout_sec=0.1)
            if len(came) > before:
                since = time.monotonic()
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown(context=context)
    return cdr.decode("BasinMap", came[-1])


def snapshot_of(run: Path, values: dict[str, Any]) -> Snapshot:
    """Return a message as a map, with the length of its simulations."""
    settings = json.loads((run / "ledger.jsonl").read_text().splitlines()[0])["settings"]
    return Snapshot.from_message(values).with_plan(settings)


def finished(run: Path) -> Snapshot:
    """Return the map of a finished run at its latest test."""
    plane = read_map_npz(run / "map.npz")
    values = {name: getattr(plane, name) for name in ("run_id", "sweep_id", "x_name", "y_name", "x", "y")}
    values |= {"transient_periods": plane.transient_periods.ravel(), "regime": plane.regime.ravel()}
    values |= {name: getattr(plane, name)[-1].ravel() for name in ("correlation", "slips", "corners")}
    cells = plane.regime.size
    values |= {"regime_names": list(plane.regime_names), "tests": np.full(cells, len(plane.test_periods), np.uint16)}
    values |= {"cells_done": cells, "cells_quarantined": 0, "cells_outstanding": 0}
    return Snapshot.from_message(values).with_plan(list(plane.settings))


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Seen]]:
    """What was seen at each of the moments."""
    needs_vulkan()
    folder = tmp_path_factory.mktemp("live")
    run = folder / "run"
    found: dict[str, Seen] = {}
    with own_domain(), pytest.MonkeyPatch.context() as patch:
        patch.setenv("DISPLAY", ":77")  # the stand-in opens no window
        patch.setenv("RERUN_CLI_PATH", str(headless_stand_in(folder / "rerun")))
        viewers: list[int] = []
        try:
            with halted(run, *SWEEP, "--view", chunks=HALF) as sweep:
                sweep.wait_until(lambda: bool(ports_of([one.pid for one in family(sweep.process.pid)])))
                viewers += [one.pid for one in family(sweep.process.pid) if ports_of([one.pid])]
                early = HeadlessViewer(uri_of(ports_of(viewers)[0]))
                sweep.wait_until(lambda: sweep.done_blocks() >= NX * NY // 8 // 2)
                half = snapshot_of(run, latest_map(run_of(run)))
                assert 0.2 < np.isnan(half.transient_periods).mean() < 0.8
                found["open from the beginning, map half done"] = Seen(half).look(early, LIVE)
                with headless_viewer(early.uri) as late:
                    found["connected in the middle, map half done"] = Seen(half).look(late, LIVE)
                sweep.kill("dashboard")  # the next one sends everything again to the viewer that is open
                sweep.wait_until(lambda: (run / "log" / "dashboard.log").read_text().count(" opens:") == 2)
                assert "dashboard ended" in sweep.text
                sweep.go_on()
                assert sweep.wait() == 0, sweep.text
                whole = finished(run)
                found["open from the beginning, map done"] = Seen(whole).look(early, VIEWS)
                with headless_viewer(early.uri) as late:
                    found["connected after the end"] = Seen(whole).look(late, VIEWS)
                    late.open(str(run / "dashboard.rrd"))
                    found["from the file"] = Seen(whole).look(late, VIEWS)
                eventually(lambda: len(early.client.get_state().recordings) == 1, "there is one recording")
        finally:
            for pid in viewers:  # they stay, with what they have received
                psutil.Process(pid).kill()
    for moment, what in found.items():
        for origin, picture in what.pictures.items():
            keep(picture, folder / f"{moment}{origin.replace('/', ' ')}.png")
    return found


@pytest.mark.full
@pytest.mark.parametrize(("moment", "origin"), [(moment, origin) for moment in MOMENTS for origin in MOMENTS[moment]])
def test_every_cell_has_the_colour_that_the_legend_gives_to_its_value(
    seen: dict[str, Seen], moment: str, origin: str
) -> None:
    what = seen[moment]
    assert what.wrong(origin) <= MOST_WRONG
    for colour, (should, covers) in shares(origin, what.snapshot, what.pictures[origin]).items():
        if should > 0.1:
            assert covers == pytest.approx(should, abs=MOST_WRONG), colour
