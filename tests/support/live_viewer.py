"""Rerun's viewer without a window, and what colour it paints each cell of a map.

The viewer draws with Vulkan: a software renderer will do (Debian's mesa-vulkan-drivers and libvulkan1).
"""

from __future__ import annotations

import contextlib
import ctypes
import io
import json
import os
import signal
import stat
import subprocess
import sys
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from bow_sweep.figures.colours import GREY, TERRAIN_COLOURS, regime_colours, transient_colours, viridis
from bow_sweep.maps.plane import TEST_LAYERS, TEST_RANGES, Snapshot
from bow_sweep.maps.terrain import UNKNOWN, terrain
from bow_sweep.view.viewer import answers, port_of, uri_of
from bow_sweep.view.wanted import free_port

NEEDED = "needs a Vulkan driver: Debian's mesa-vulkan-drivers and libvulkan1"

PATIENCE_S = 60.0
"""Time that a viewer has to show what it should; it takes a few seconds."""

COLUMNS = 3
"""Views beside each other."""

ABOVE, BELOW = 58, 28
"""Height of the bars above and below the views in the viewer's window, pixels."""

LINE = np.array((190, 192, 200))
"""Colour of the frame around a map."""

SLACK = 12
"""Largest difference of a channel from the colour that a legend shows: the viewer's viridis is not quite ours."""

PLACES = (0.3, 0.5, 0.7)
"""Where in a cell its colour is looked at, in both directions."""

STAND_IN = """#!{python}
import os, sys
words = [{rerun!r}, *sys.argv[1:], "--headless"]
os.execv(words[0], words)
"""


def needs_vulkan() -> None:
    """Skip a test on a machine whose viewer cannot draw."""
    drivers = [*Path("/usr/share/vulkan/icd.d").glob("*.json"), *Path("/etc/vulkan/icd.d").glob("*.json")]
    try:
        ctypes.CDLL("libvulkan.so.1")
    except OSError:
        drivers = []
    if not drivers:
        pytest.skip(NEEDED)


def rerun_program() -> Path:
    """Return the path of rerun's own program."""
    import rerun_cli

    return Path(rerun_cli.__file__).with_name("rerun")


def headless_stand_in(path: Path) -> Path:
    """Write a program that runs rerun's viewer without a window; for the environment variable RERUN_CLI_PATH."""
    path.write_text(STAND_IN.format(python=sys.executable, rerun=str(rerun_program())))
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


class HeadlessViewer:
    """A viewer that is looked at through its control service.

    Parameters
    ----------
    uri
        Address of the viewer.
    """

    def __init__(self, uri: str) -> None:
        from rerun.experimental import ViewerClient

        assert answers(uri, PATIENCE_S)
        self.uri = uri
        self.client = ViewerClient.connect(uri)
        eventually(lambda: self.client.get_state() is not None, "the viewer answers")

    def open(self, what: str) -> None:
        """Open a file or an address in place of all recordings that are open."""
        self.client.close("all")
        self.client.open(what)

    def show(self, *origins: str) -> None:
        """Show some views of the layout beside each other, and nothing else."""
        ids: list[str] = []

        def is_there() -> bool:
            found = {view.origin: view.view_id for view in self.client.get_state().views}
            ids[:] = [found[origin] for origin in origins if origin in found]
            return len(ids) == len(origins)

        eventually(is_there, f"the viewer has the views {', '.join(origins)}")
        whole = self.client.get_blueprint("recording").blueprint
        root = str(uuid.uuid4())
        contents = [f"view/{identity}" for identity in ids]
        grid = {"container_kind": "Grid", "contents": contents, "grid_columns": min(COLUMNS, len(ids))}
        kept = {
            path: what
            for path, what in whole.items()
            if not path.startswith(("/view/", "/container/")) or path.split("/")[2] in ids
        }
        kept[f"/container/{root}"] = {"ContainerBlueprint": grid}
        kept["/viewport"]["ViewportBlueprint"]["root_container"] = root
        self.client.set_blueprint(kept, "recording")
        self.client.take_screenshot(max_size=64)  # it has painted the new layout now

    def complaints(self) -> dict[str, Any]:
        """Return what the views say that they cannot show, after they have been painted."""
        self.client.take_screenshot(max_size=64)
        return {view.name: view.reports for view in self.client.get_state().views if view.reports}

    def picture(self, origin: str) -> np.ndarray:
        """Return what one view of the layout paints, (height, width, 3)."""
        identity = next(view.view_id for view in self.client.get_state().views if view.origin == origin)
        return _pixels(self.client.take_screenshot(identity))

    def window(self) -> np.ndarray:
        """Return what the whole window shows, (height, width, 3)."""
        return _pixels(self.client.take_screenshot())

    def pictures(self, *origins: str) -> dict[str, np.ndarray]:
        """Return what some views paint, (height, width, 3), after :meth:`show` has shown just these."""
        window = self.window()
        rows, columns = -(-len(origins) // COLUMNS), min(COLUMNS, len(origins))
        height, width = (window.shape[0] - ABOVE - BELOW) // rows, window.shape[1] // columns
        found = {}
        for number, origin in enumerate(origins):
            top, left = ABOVE + number // columns * height, number % columns * width
            found[origin] = window[top : top + height, left : left + width]
        return found


def _pixels(png: bytes) -> np.ndarray:
    with Image.open(io.BytesIO(png)) as shot:
        return np.asarray(shot.convert("RGB")).astype(int)


@contextlib.contextmanager
def headless_viewer(*opens: str) -> Iterator[HeadlessViewer]:
    """Start a viewer on the loopback, with files or addresses that it opens; end it."""
    uri = uri_of(free_port())
    words = [str(rerun_program()), *opens, "--headless", "--hide-welcome-screen", "--bind", "127.0.0.1"]
    process = subprocess.Popen(
        [*words, "--port", str(port_of(uri))],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "RERUN_APP_ONLY": "true"},
        start_new_session=True,
    )
    try:
        yield HeadlessViewer(uri)
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def eventually(holds: Callable[[], bool], what: str) -> None:
    """Wait until something holds."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        why = ""
        try:
            if holds():
                return
        except (ConnectionError, TimeoutError, RuntimeError, StopIteration, ValueError) as error:
            why = f": {error!r}"  # it is busy, or there is nothing to see yet
        assert time.monotonic() < deadline, f"it never came true that {what}{why}"
        time.sleep(0.2)


def frame_of(picture: np.ndarray) -> tuple[int, int, int, int]:
    """Return left, right, top and bottom of the frame around the map in a picture, pixels."""
    is_line = (abs(picture - LINE) <= 15).all(axis=-1)  # cells that are not computed differ by 20
    longest, bottom, left = 0, 0, 0
    for row, line in enumerate(is_line):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(np.int8), [0]]))).reshape(-1, 2)
        if len(edges):
            length, first = max((int(end - begin), int(begin)) for begin, end in edges)
            if length >= longest:  # the lowest of the long ones; labels may lie on the upper one
                longest, bottom, left = length, row, first
    right = left + longest
    across = np.flatnonzero(is_line[: bottom - 20, left:right].mean(axis=1) > 0.4) if longest > 40 else []
    if not len(across):
        raise ValueError("there is no frame of a map in this picture")
    return left, right, int(across[0]), bottom


def painted(picture: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Return the colours of the cells of a map in a picture, (ny, nx, places, 3); row 0 is the lowest y.

    Raises
    ------
    ValueError
        Where the picture shows no map.
    """
    left, right, top, bottom = frame_of(picture)
    ny, nx = shape
    columns = [left + (np.arange(nx) + place) / nx * (right - left) for place in PLACES]
    rows = [bottom - (np.arange(ny) + place) / ny * (bottom - top) for place in PLACES]
    found = [picture[np.rint(y).astype(int)[:, None], np.rint(x).astype(int)[None, :]] for y in rows for x in columns]
    return np.stack(found, axis=2)


def expected(origin: str, snapshot: Snapshot) -> np.ndarray:
    """Return the colours that the legend of a view gives to the cells of a map, (ny, nx, 3)."""
    missing = np.isnan(snapshot.transient_periods)
    if origin == "/map":
        return transient_colours(snapshot.transient_periods, snapshot.periods).astype(int)
    if origin == "/regime":
        table = np.tile(np.array(GREY), (256, 1))
        table[: len(snapshot.regime_names)] = regime_colours(snapshot.regime_names)
        return table[snapshot.regime]
    if origin == "/terrain":
        table = np.tile(np.array(GREY), (256, 1))
        table[: len(TERRAIN_COLOURS)] = TERRAIN_COLOURS
        assert len(TERRAIN_COLOURS) <= UNKNOWN
        return table[terrain(snapshot.transient_periods)]
    name = origin.removeprefix("/tests/")
    assert name in TEST_LAYERS
    low, high = TEST_RANGES[name]
    colours = viridis((np.nan_to_num(getattr(snapshot, name).astype(float)) - low) / (high - low)).astype(int)
    colours[missing] = GREY
    return colours


def wrong_cells(origin: str, snapshot: Snapshot, picture: np.ndarray) -> np.ndarray:
    """Return which cells are not in the colour of the legend at most of the places looked at, (ny, nx) bool."""
    right = abs(painted(picture, snapshot.shape) - expected(origin, snapshot)[:, :, None]).max(axis=-1) <= SLACK
    return right.mean(axis=-1) < 0.5


def shares(origin: str, snapshot: Snapshot, picture: np.ndarray) -> dict[tuple[int, ...], tuple[float, float]]:
    """Return the share of the map that each colour of the legend should cover, and the share that it covers."""
    want, have = expected(origin, snapshot), painted(picture, snapshot.shape)
    colours = np.unique(want.reshape(-1, 3), axis=0)
    share = lambda of, colour: float((abs(of - colour).max(axis=-1) <= SLACK).mean())
    return {tuple(colour.tolist()): (share(want, colour), share(have, colour)) for colour in colours}


def keep(picture: np.ndarray, path: Path) -> None:
    """Write a picture, to be looked at."""
    Image.fromarray(picture.astype(np.uint8)).save(path)


def ports_of(process_ids: Sequence[int]) -> list[int]:
    """Return the ports that were given to programs of rerun among some processes."""
    found = []
    for pid in process_ids:
        with contextlib.suppress(OSError, ValueError, IndexError):
            words = Path(f"/proc/{pid}/cmdline").read_text().split("\0")
            if "--headless" in words:
                found.append(int(words[words.index("--port") + 1]))
    return found


def run_of(directory: Path) -> str:
    """Return the run_id of a run directory."""
    return str(json.loads((directory / "ledger.jsonl").read_text().splitlines()[0])["run_id"])
