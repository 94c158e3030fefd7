"""A sweep as a rerun recording: the growing map, its tests, counts, waveforms and status.

There are two timelines. On `sweep`, seconds since the recording began, the map grows. On `sample` the waveforms are
drawn and the map does not change. A view shows only data on the active timeline.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import Chunk, RrdReader
from rerun.error_utils import RerunWarning

from bow_sweep.maps.plane import Snapshot
from bow_sweep.view.blueprint import NO_CELLS, arrange, send
from bow_sweep.view.map_layers import ABOVE, CONTEXT, THIN, MapLayers, texts
from bow_sweep.view.scope import Scope, trace_name

APPLICATION = "bow"

RATE_WINDOW_S = 2.0
"""Cells per second are averaged over this time."""


class RunRecording:
    """A recording that is being written: its file, and a server for viewers if wanted.

    An earlier recording of the same run is continued: its contents are copied into the new file first, which then
    replaces it, so that the file at `path` never becomes shorter. The file of another run is renamed with a number.

    Parameters
    ----------
    path
        Of the ``.rrd`` file.
    snapshot
        The map as planned; its `run_id` becomes the identity of the recording.
    port
        Of a gRPC server on 127.0.0.1; 0 = no server.
    server_memory
        Largest memory of the server for viewers that connect late, such as "256MiB".
    warn
        Called with a line for people where something failed.

    Attributes
    ----------
    snapshot
        The latest map.
    uri
        Address that viewers connect to; "" without a server.
    """

    def __init__(
        self,
        path: Path,
        snapshot: Snapshot,
        port: int = 0,
        server_memory: str = "256MiB",
        warn: Callable[[str], object] = warnings.warn,
    ) -> None:
        rr.set_strict_mode(True)
        self.path, self.snapshot, self.uri = path, snapshot, ""
        self.scope = Scope()
        self._warn, self._began = warn, time.time()
        self._history: list[tuple[float, int]] = []
        self._marked: set[int] = set()
        self._chunks: dict[int, list[tuple[int, np.ndarray]]] = {}
        rr.bindings.flush_and_cleanup_orphaned_recordings()  # rerun keeps data of deleted recordings until now
        self._record = rr.RecordingStream(APPLICATION, recording_id=snapshot.run_id)
        aside = path.with_name(f".{path.name}.part")
        sinks: list[Any] = [rr.FileSink(aside)]
        if port:
            server = rr.GrpcServerSink(bind_ip="127.0.0.1", port=port, server_memory_limit=server_memory)
            self.uri = server.uri
            sinks.append(server)
        self._record.set_sinks(*sinks)
        self._layers = MapLayers(self._record, snapshot)
        self._arrange()
        self._continue_file()
        self._record.log("waveform/help", rr.TextDocument(NO_CELLS, media_type=rr.MediaType.MARKDOWN), static=True)
        self.map(snapshot)
        self._record.flush()
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
        if head == "waveform" and "sample" in batch.schema.names:
            self.scope.recall(name, max(batch.column("sample").cast("int64").to_pylist()) + 1)
        if {"sweep", "log_time"} <= set(batch.schema.names) and batch.num_rows:
            elapsed, logged = (batch.column(name).cast("int64")[0].as_py() for name in ("sweep", "log_time"))
            self._began = min(self._began, (logged - elapsed) / 1e9)

    def _now(self, *, among_samples: bool = False) -> None:
        """Set the time of what is logged next; maps are also at sample 0, so that the timeline `sample` shows them."""
        self._record.reset_time()
        self._record.set_time("sweep", duration=time.time() - self._began)
        if among_samples:
            self._record.set_time("sample", sequence=0)

    def map(self, snapshot: Snapshot) -> None:
        """Log a map."""
        self.snapshot = snapshot
        self._now(among_samples=True)
        self._layers.pictures(snapshot)
        self._now()
        self._layers.counts(snapshot, self.rate(snapshot.done))

    def rate(self, done: int) -> float:
        """Return the cells done per second over the last `RATE_WINDOW_S`."""
        now = time.monotonic()
        self._history = [entry for entry in self._history if now - entry[0] < RATE_WINDOW_S] + [(now, done)]
        (first, before), (last, after) = self._history[0], self._history[-1]
        return (after - before) / (last - first) if last > first else 0.0

    def _arrange(self) -> None:
        send(self._blueprint(), APPLICATION, self._record)

    def _blueprint(self) -> rrb.Blueprint:
        return arrange(self._layers.decorations, self.scope.cells)

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
            if self.scope.admit(cell) and self.scope.is_new(cell, first_sample):
                self._chunks.setdefault(cell, []).append((first_sample, np.array(force, np.float64)))

    def draw_waveforms(self) -> None:
        """Log the chunks since the last call, those of a cell together: the chunks of a block come in a burst."""
        chunks, self._chunks = self._chunks, {}
        new = [cell for cell in chunks if cell not in self._marked]
        for cell, pieces in chunks.items():
            self._log_trace(cell, pieces)
        if new:
            self._arrange()

    def _log_trace(self, cell: int, pieces: list[tuple[int, np.ndarray]]) -> None:
        log, path = self._record.log, f"waveform/{trace_name(cell)}"
        trace = self.scope.trace(self.snapshot, cell, pieces[-1][1])
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
        for first, force in pieces:
            if not self.scope.continues(cell, first, len(force)):  # NaN makes a gap where samples are missing
                samples.append(np.array([first - 1]))
                values.append(np.array([np.nan]))
            samples.append(np.arange(first, first + len(force)))
            values.append(force)
        self._record.send_columns(
            path,
            indexes=[rr.TimeColumn("sample", sequence=np.concatenate(samples))],
            columns=rr.Scalars.columns(scalars=np.concatenate(values)),
        )
        self._now(among_samples=True)
        log(f"scope/{trace.name}/curve", rr.LineStrips2D([trace.curve], colors=trace.colour, radii=THIN))

    def status(self, text: str) -> None:
        """Log the status page, Markdown."""
        self._now(among_samples=True)
        self._record.log("account", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))

    def terrain(self, codes: np.ndarray, text: str) -> None:
        """Log the terrain of the map, (ny, nx) codes, and its playability, Markdown."""
        self._now(among_samples=True)
        self._layers.terrain(codes)
        self._record.log("playability", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))

    def flush(self) -> None:
        """Write everything into the file: after a kill it can be read up to here."""
        self.draw_waveforms()
        self._record.flush()

    def finish(self) -> None:
        """Finish the file with its footer, which makes it quick to open; a server goes on."""
        self.flush()
        if not self.uri:
            self._record.disconnect()
            return
        # rerun writes the footer when a recording closes all its sinks, and the server is one: finish a copy instead.
        aside = self.path.with_name(f".{self.path.name}.part")
        copy = rr.RecordingStream(APPLICATION, recording_id=self.snapshot.run_id)
        copy.set_sinks(rr.FileSink(aside))
        with _no_footer_expected():
            copy.send_chunks(RrdReader(self.path).stream())
        send(self._blueprint(), APPLICATION, copy)
        copy.flush()
        copy.disconnect()
        aside.replace(self.path)

    def close(self) -> None:
        """Close file and server; an unfinished file gets its footer."""
        self._record.flush()
        self._record.disconnect()


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
