"""The page served on loopback: a Bokeh server whose documents ask for the samples of the chosen cells."""

from __future__ import annotations

import errno
import logging
import signal
import socket
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from bokeh.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.document import Document
from bokeh.models.callbacks import CustomJS
from bokeh.server.server import Server

from bow_sweep.cell.run_cells import RunCells
from bow_sweep.cell.sound import SoundError, sound_of
from bow_sweep.cell.waveform import CellError
from bow_sweep.explore.packed import Progress
from bow_sweep.explore.page import SECONDS, Page, Panel, Shown, page_of
from bow_sweep.explore.plots import COLUMNS
from bow_sweep.explore.samples import columns_of

LOOPBACK = "127.0.0.1"

TRIES = 5
"""How often a free port is looked for: another process may take it first."""


class PortError(ValueError):
    """The page cannot be served on a port; says why, and what would be right."""


def shown(run: RunCells, name: str) -> Shown:
    """Return what the page has to know of a run."""
    parameters = run.sweep.parameters
    return Shown(name, run.map, parameters.sample_rate, parameters.period)


class CellPage:
    """A page whose samples come from the runs, one for each browser window.

    Parameters
    ----------
    runs, names
        One or two runs, and their names.
    """

    def __init__(self, runs: Sequence[RunCells], names: Sequence[str]) -> None:
        self.runs = runs
        self.page: Page = page_of([shown(run, name) for run, name in zip(runs, names, strict=True)])
        self._played = 0
        self._cells: list[int | None] = [None] * len(runs)
        self._choose("data", {}, self.page.chosen.data)
        self.page.chosen.on_change("data", self._choose)
        for number, panel in enumerate(self.page.panels):
            panel.play.js_on_click(CustomJS(code="bow.ready()"))
            panel.play.on_click(partial(self._play, number))
            listen = CustomJS(args={"sound": panel.sound}, code="bow.play(sound.data.samples[0])")
            panel.sound.js_on_change("data", listen)

    def _choose(self, _name: str, _old: Any, new: Any) -> None:
        for number, cell in enumerate(np.ravel(new["cell"]).tolist()):
            if cell != self._cells[number]:
                self._cells[number] = cell
                show_cell(self.page.panels[number], self.runs[number], int(cell))

    def _play(self, number: int) -> None:
        panel, cell = self.page.panels[number], self._cells[number]
        assert cell is not None
        try:
            record = self.runs[number].record(cell)
            sound = sound_of(record.bridge_force, record.parameters, SECONDS, body=bool(panel.body.active))
        except (CellError, SoundError) as error:
            panel.say(str(error))
            return
        panel.say(f"{record.why}. Sound: {sound.describe()}")
        self._played += 1  # the same sound again is a change, and is played again
        panel.sound.data = {"samples": [sound.samples], "number": [self._played]}


def show_cell(panel: Panel, run: RunCells, cell: int) -> None:
    """Put the samples of a cell into the plots of a run; the reason where there are none."""
    try:
        record = run.record(cell)
    except CellError as error:
        for name in ("wave", "slips", "spectrum", "harmonics"):
            getattr(panel, name).data = {column: [] for column in COLUMNS[name]}
        panel.say(str(error))
        return
    for name, columns in columns_of(record).items():
        getattr(panel, name).data = columns
    panel.say(record.why)


def serve(
    runs: Sequence[Path],
    names: Sequence[str],
    port: int,
    started: Callable[[str], None],
    progress: Progress | None = None,
) -> None:
    """Serve the page on `LOOPBACK` until SIGINT or SIGTERM.

    Parameters
    ----------
    runs, names
        Directories of one or two runs, and their names.
    port
        0 for a free one.
    started
        Called once with the address, when the page can be opened.
    progress
        Called with (done, total) while bags are read that were not closed.

    Raises
    ------
    CellError
        Where a run cannot be shown.
    PortError
        Where the port cannot be used.
    """
    opened = [RunCells(run, progress) for run in runs]
    for run in opened:
        _ = run.sweep  # raises where the settings are not known
    # What browsers ask for and is not there, and connections that end early, are no news for the user.
    for name in ("tornado.access", "bokeh.server.views.ws", "bokeh.server.protocol_handler"):
        logging.getLogger(name).setLevel(logging.ERROR)

    def document(made: Document) -> None:
        CellPage(opened, names).page.add_to(made)

    server = _server(Application(FunctionHandler(document)), port)
    try:
        server.start()
        loop = server.io_loop
        before = {
            number: signal.signal(number, lambda *_: loop.add_callback_from_signal(loop.stop))
            for number in (signal.SIGINT, signal.SIGTERM)
        }
        try:
            loop.add_callback(started, f"http://{LOOPBACK}:{server.port}/")
            loop.start()
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
    finally:
        server.stop()
        for run in opened:
            run.close()


def _server(application: Application, port: int) -> Server:
    """Return a server that listens on a port of `LOOPBACK`, and accepts WebSockets from its own pages only.

    The origins have to be known before the server listens, so a free port is looked for first.
    """
    for left in reversed(range(TRIES)):
        number = port or _free_port()
        origins = [f"{LOOPBACK}:{number}", f"localhost:{number}"]
        try:
            return Server({"/": application}, address=LOOPBACK, port=number, allow_websocket_origin=origins)
        except OSError as error:
            if port or not left:
                raise PortError(_why(number, error)) from None
    raise AssertionError("not reached")


def _why(port: int, error: OSError) -> str:
    if error.errno == errno.EADDRINUSE:
        return f"--port {port}: is taken on {LOOPBACK}; should be another one, or left out for a free one"
    return f"--port {port}: cannot be used on {LOOPBACK}: {error.strerror}"


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])
