"""A sweep as a rerun recording: the growing map, its tests, counts, waveforms and status.

There are three timelines. On `sweep`, seconds since the recording began, the map grows. On `sample` the waveforms are
drawn and the map does not change. On `test` the map is what it was after 5, 10 ... periods. A view shows only data on
the active timeline; so waveforms are on `sweep` too, in seconds since the start of the gesture.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import Chunk, RrdReader
from rerun.error_utils import RerunWarning

from bow_sim.physics.parameters import FIELDS
from bow_sweep.maps.map_file import MapFile
from bow_sweep.maps.plane import Snapshot
from bow_sweep.view import bounded
from bow_sweep.view.blueprint import NO_CELLS, arrange, send
from bow_sweep.view.map_layers import ABOVE, CONTEXT, SEQUENCES, THIN, MapLayers, texts
from bow_sweep.view.pieces import Piece, Pieces
from bow_sweep.view.scope import Scope, force_range, name_of, trace_name
from bow_sweep.view.tests_over_time import at_each_test, confidence_words
from bow_sweep.view.viewer import answers

APPLICATION = "bow"

ANSWER_S, TAKE_IN_S, DELIVER_S = 3.0, 1.0, 5.0
"""Time that a viewer has to listen at first, to take in what was drawn since the last flush, and what is drawn last."""

VIEWER_GONE, TOO_SLOW = "gRPC", "timed out"
"""Parts of the texts of rerun's errors."""

VALUES = "Scalars:scalars"
"""Column of the values of a waveform in a recording."""

RATE_WINDOW_S = 2.0
"""Cells per second are averaged over this time."""


class RunRecording:
    """A recording that is being written: its file, and the viewer or server that it is sent to, if there is one.

    An earlier recording of the same run is continued: its contents are copied into the new file first, which then
    replaces it, so that the file at `path` never becomes shorter. The file of another run is renamed with a number.

    Parameters
    ----------
    path
        Of the ``.rrd`` file.
    snapshot
        The map as planned; its `run_id` becomes the identity of the recording.
    uri
        Address of a viewer or server that shows the recording live; "" for none. The file does not depend on it.
    warn
        Called with a line for people where something failed.
    inspected
        Cells whose waveforms will come: they have their views from the beginning.

    Attributes
    ----------
    snapshot
        The latest map.
    """

    def __init__(
        self,
        path: Path,
        snapshot: Snapshot,
        uri: str = "",
        warn: Callable[[str], object] = warnings.warn,
        inspected: Iterable[int] = (),
    ) -> None:
        rr.set_strict_mode(True)
        self.path, self.snapshot = path, snapshot
        self.scope, self._pieces = Scope(), Pieces()
        for cell in inspected:
            if cell < snapshot.regime.size:
                self.scope.admit(cell)
        self._arranged: list[int] = []
        self._warn, self._began = warn, time.time()
        self._history: list[tuple[float, int]] = []
        self._marked: set[int] = set()
        bounded.clean_up()
        self._record = bounded.opened(rr.RecordingStream(APPLICATION, recording_id=snapshot.run_id))
        aside = path.with_name(f".{path.name}.part")
        sinks: list[Any] = [rr.FileSink(aside)]
        self._is_lost = False
        self._is_shown = bool(uri) and answers(uri, ANSWER_S)
        if self._is_shown:
            sinks.append(rr.GrpcSink(uri))  # after the file: sinks are flushed and closed in this order
        elif uri:
            warn(f"the map is not shown live: nothing listens at {uri}")
        self._record.set_sinks(*sinks)
        self._layers = MapLayers(self._record, snapshot)
        self._arrange()
        self._continue_file()
        self._record.log("waveform/help", rr.TextDocument(NO_CELLS, media_type=rr.MediaType.MARKDOWN), static=True)
        self._now(among_samples=True)
        self._layers.say()
        self.map(snapshot)
        self._flush()
        aside.replace(path)  # the sink has the file open and goes on writing

    def _continue_file(self) -> None:
        """Copy the earlier recording of this run; rename the file of another run."""
        if not self.path.exists():
            return
        try:
            with _no_footer_expected():
                reader = RrdReader(self.path)
                if self.snapshot.run_id not in {entry.recording_id for entry in reader.recordings()}:
                    _put_aside(self.path)
                    return
                for chunk in reader.stream():
                    if CONTEXT not in chunk.to_record_batch().schema.names:  # logged above, and never twice
                        self._remember(chunk)
                        self._record.send_chunks(chunk)
        except Exception as error:  # rerun raises any type on a damaged file; the sweep must go on
            self._warn(f"{self.path}: cannot be read to its end, kept as {_put_aside(self.path).name}: {error}")

    def _remember(self, chunk: Chunk) -> None:
        """Take from an earlier chunk when the recording began, and which cells were inspected."""
        head, _, name = str(chunk.entity_path).strip("/").rpartition("/")
        batch = chunk.to_record_batch()
        if head == "waveform" and VALUES in batch.schema.names and "sample" in batch.schema.names:
            self._recall(name, batch)
        if {"sweep", "log_time"} <= set(batch.schema.names) and batch.num_rows:
            elapsed, logged = (batch.column(name).cast("int64")[0].as_py() for name in ("sweep", "log_time"))
            self._began = min(self._began, (logged - elapsed) / 1e9)

    def _recall(self, name: str, batch: Any) -> None:
        """Take note of the samples of a cell that are recorded; NaN stands for a gap."""
        cell = self.scope.recall(name)
        if cell is None:
            return
        values = np.array([value[0] if value else np.nan for value in batch.column(VALUES).to_pylist()], float)
        samples = np.array(batch.column("sample").cast("int64").to_pylist(), np.int64)
        self._pieces.recall(cell, samples[np.isfinite(values)])

    def _now(self, *, among_samples: bool = False) -> None:
        """Set the time of what is logged next; maps are also at sample 0 and test 0: those timelines show them too."""
        self._record.reset_time()
        self._record.set_time("sweep", duration=time.time() - self._began)
        if among_samples:
            for name in SEQUENCES:
                self._record.set_time(name, sequence=0)

    def map(self, snapshot: Snapshot) -> None:
        """Log a map."""
        self.snapshot = snapshot
        self._now(among_samples=True)
        self._layers.show(snapshot)
        self._now()
        self._layers.counts()

    def rate(self, done: int) -> float:
        """Return the cells done per second over the last `RATE_WINDOW_S`."""
        now = time.monotonic()
        self._history = [entry for entry in self._history if now - entry[0] < RATE_WINDOW_S] + [(now, done)]
        (first, before), (last, after) = self._history[0], self._history[-1]
        return (after - before) / (last - first) if last > first else 0.0

    def _arrange(self) -> None:
        self._arranged = list(self.scope.cells)
        send(self._blueprint(), APPLICATION, self._record)

    def _blueprint(self) -> rrb.Blueprint:
        cells = {cell: name_of(self.snapshot, cell) for cell in self.scope.cells}
        return arrange(self._layers.decorations, cells, self._layers.radius > 0, force_range(self.snapshot))

    def waveform(self, cells: Sequence[int], first_sample: int, data: np.ndarray) -> None:
        """Take a chunk of the bridge force of inspected cells; :meth:`draw_waveforms` draws it.

        Parameters
        ----------
        first_sample
            First sample of the chunk, since the start of the gesture.
        data
            (cells, samples) bridge force.
        """
        for cell, force in zip(cells, data, strict=True):
            if self.scope.admit(cell):
                self._pieces.take(cell, first_sample, np.array(force, np.float64))

    def missing(self, samples: int) -> dict[int, list[tuple[int, int]]]:
        """Return the ranges (first, end) that did not come of waveforms of `samples`, by cell."""
        found = {cell: self._pieces.missing(cell, samples) for cell in self.scope.cells}
        return {cell: ranges for cell, ranges in found.items() if ranges}

    def draw_waveforms(self) -> None:
        """Log the pieces that can be drawn, those of a cell together: the chunks of a block come in a burst."""
        self._draw({cell: [(piece, False) for piece in pieces] for cell, pieces in self._pieces.ready().items()})

    def draw_rest(self) -> None:
        """Log all pieces; where samples before one are missing, NaN makes a gap."""
        self.draw_waveforms()
        self._draw(self._pieces.rest())

    def _draw(self, found: dict[int, list[tuple[Piece, bool]]]) -> None:
        for cell, pieces in found.items():
            self._log_trace(cell, pieces)
        if self.scope.cells != self._arranged:  # a new layout brings a viewer back to its first tab
            self._arrange()

    def _log_trace(self, cell: int, pieces: list[tuple[Piece, bool]]) -> None:
        log, path = self._record.log, f"waveform/{trace_name(cell)}"
        trace = self.scope.trace(self.snapshot, cell, pieces[-1][0].force)
        if cell not in self._marked:
            self._marked.add(cell)
            self._now(among_samples=True)
            log(path, rr.SeriesLines(names=trace.label, colors=trace.colour, widths=1.0), static=True)
            thick = rr.Radius.ui_points(1.0)
            frame = rr.LineStrips2D([trace.frame], colors=trace.colour, radii=thick, draw_order=ABOVE + 1)
            log(f"map/inspected/{trace.name}/frame", frame)
            log(f"map/inspected/{trace.name}/number", texts([trace.place], [str(trace.number)]))
            log(f"scope/{trace.name}/caption", texts([trace.corner], [trace.caption]))
        samples, values = [], []
        for piece, after_gap in pieces:
            if after_gap:
                samples.append(np.array([piece.first - 1]))
                values.append(np.array([np.nan]))
            samples.append(np.arange(piece.first, piece.end))
            values.append(piece.force)
        self._record.send_columns(
            path,
            indexes=self._times(np.concatenate(samples)),
            columns=rr.Scalars.columns(scalars=np.concatenate(values)),
        )
        self._now(among_samples=True)
        log(f"scope/{trace.name}/curve", rr.LineStrips2D([trace.curve], colors=trace.colour, radii=THIN))

    def _times(self, samples: np.ndarray) -> list[rr.TimeColumn]:
        """Return the times of samples: their number, and their seconds on the timeline on which the viewer opens."""
        rate = float(self.snapshot.values.get("sample_rate", FIELDS["sample_rate"].default))  # type: ignore[arg-type]
        return [rr.TimeColumn("sample", sequence=samples), rr.TimeColumn("sweep", duration=samples / rate)]

    def status(self, text: str) -> None:
        """Log the status page, Markdown."""
        self._now(among_samples=True)
        self._record.log("account", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))

    def tests(self, result: MapFile) -> None:
        """Log every test of every cell on the timeline `test`, and how sure the regimes are."""
        self._layers.show_tests(at_each_test(result))
        words = confidence_words(result)
        self._now()
        self._record.set_time("sample", sequence=0)
        self._record.set_time("test", sequence=int(result.test_periods[-1]))
        self._layers.say(words)

    def terrain(self, codes: np.ndarray, text: str) -> None:
        """Log the terrain of the map, (ny, nx) codes, and its playability, Markdown."""
        self._now(among_samples=True)
        self._layers.terrain(codes)
        self._record.log("playability", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))

    def reliability(self, shares: np.ndarray) -> None:
        """Log the shares of repeats that end as their cell, (ny, nx)."""
        self._now(among_samples=True)
        self._layers.reliability(shares)

    def flush(self) -> None:
        """Write everything into the file: after a kill it can be read up to here."""
        self.draw_waveforms()
        self._flush()

    def _flush(self) -> None:
        if not self._is_shown:
            bounded.flush(self._record)
            return
        try:
            bounded.flush(self._record, TAKE_IN_S)
        except RuntimeError as error:
            if VIEWER_GONE in str(error):
                self._lose_viewer()
            elif TOO_SLOW not in str(error):
                raise

    def _lose_viewer(self) -> None:
        """Go on with the file alone. The viewer was closed, or has failed."""
        if not self._is_lost:
            self._is_lost = True
            self._warn(f"the viewer is gone; {self.path.name} is written on")

    def finish(self) -> None:
        """Finish the file with its footer, which makes it quick to open. What has shown it keeps the picture."""
        self.draw_waveforms()
        self.close()

    def close(self) -> None:
        """Close a file that may be finished or not; it gets its footer."""
        self._flush()
        self._disconnect()

    def _disconnect(self) -> None:
        """Close the file, and return when the viewer has everything, or takes too long."""
        if not self._is_shown:
            bounded.close(self._record)
        elif not bounded.disconnect(self._record, DELIVER_S):
            self._warn(f"the viewer does not take in what was drawn last; all of it is in {self.path.name}")


@contextmanager
def _no_footer_expected() -> Iterator[None]:
    """Read an unfinished file without the warning that its footer is missing."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RerunWarning)
        yield


def _put_aside(path: Path) -> Path:
    """Rename a file with the next free number, and return its new path."""
    number = 1
    while (other := path.with_name(f"{path.stem}-{number}{path.suffix}")).exists():
        number += 1
    return path.rename(other)
