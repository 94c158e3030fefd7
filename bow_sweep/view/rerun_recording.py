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

from bow_sweep.figures.colours import BLACK, GREY, HEADROOM, TERRAIN_COLOURS, regime_legend
from bow_sweep.maps.plane import (
    CLEAR,
    NEVER,
    NOT_COMPUTED,
    TEST_LAYERS,
    TEST_RANGES,
    Snapshot,
    terrain_label,
    upright,
)
from bow_sweep.maps.terrain import TERRAINS, UNKNOWN
from bow_sweep.view.blueprint import NO_CELLS, arrange, send
from bow_sweep.view.decorations import (
    Decorations,
    layer_decorations,
    regime_decorations,
    terrain_decorations,
    transient_decorations,
)
from bow_sweep.view.scope import Scope, trace_name

APPLICATION = "bow"
LINE_COLOUR, TEXT_COLOUR, PALE = (190, 192, 200), (235, 236, 240), (215, 215, 215)
BEHIND, ABOVE = -20.0, -10.0
"""Draw orders: values below, the mask that makes cells black or grey above."""

THIN = rr.Radius.ui_points(0.75)

RATE_WINDOW_S = 2.0
"""Cells per second are averaged over this time."""


class Board:
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
        self._drawn: tuple[Any, ...] = ()
        self._history: list[tuple[float, int]] = []
        self._marked: set[int] = set()
        self._chunks: dict[int, list[tuple[int, np.ndarray]]] = {}
        self._decorations: dict[str, Decorations] = {}
        rr.bindings.flush_and_cleanup_orphaned_recordings()  # rerun keeps data of deleted recordings until now
        self._record = rr.RecordingStream(APPLICATION, recording_id=snapshot.run_id)
        aside = path.with_name(f".{path.name}.part")
        sinks: list[Any] = [rr.FileSink(aside)]
        if port:
            server = rr.GrpcServerSink(bind_ip="127.0.0.1", port=port, server_memory_limit=server_memory)
            self.uri = server.uri
            sinks.append(server)
        self._record.set_sinks(*sinks)
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
        drawn = (snapshot.shape, snapshot.x_name, snapshot.y_name, snapshot.regime_names)
        if drawn != self._drawn:
            self._drawn = drawn
            self._draw_decorations()
        log = self._record.log
        self._now(among_samples=True)
        mask = snapshot.mask()
        unknown = mask == NOT_COMPUTED
        log("map/transient", _depth(snapshot.transient_periods, (HEADROOM * snapshot.periods, 0.0)))
        log("map/mask", _codes(mask))
        for name in TEST_LAYERS:
            log(f"tests/{name}/values", _depth(getattr(snapshot, name), TEST_RANGES[name]))
        log("tests/pending", _codes(np.where(unknown, NOT_COMPUTED, CLEAR).astype(np.uint8)))
        log("regime/codes", _codes(snapshot.regime))
        self._now()
        for name, count in zip([*snapshot.regime_names, "pending"], snapshot.regime_counts(), strict=True):
            log(f"counts/{name}", rr.Scalars(float(count)))
        log("progress/cells_done", rr.Scalars(float(snapshot.done)))
        log("progress/cells_per_second", rr.Scalars(self.rate(snapshot.done)))

    def rate(self, done: int) -> float:
        """Return the cells done per second over the last `RATE_WINDOW_S`."""
        now = time.monotonic()
        self._history = [entry for entry in self._history if now - entry[0] < RATE_WINDOW_S] + [(now, done)]
        (first, before), (last, after) = self._history[0], self._history[-1]
        return (after - before) / (last - first) if last > first else 0.0

    def _draw_decorations(self) -> None:
        """Log what does not change (axes, scales, names of codes), and the layout of the views."""
        snapshot, log = self.snapshot, self._record.log
        tests = {f"tests/{name}": layer_decorations(snapshot, name) for name in TEST_LAYERS}
        self._decorations = {"map": transient_decorations(snapshot), **tests, "regime": regime_decorations(snapshot)}
        self._decorations["terrain"] = terrain_decorations(snapshot)
        for place, decorations in self._decorations.items():
            self._draw(f"{place}/axes", decorations)
        masks = [(CLEAR, "", (0, 0, 0, 0)), (NEVER, "never", (*BLACK, 255)), (NOT_COMPUTED, "pending", (*GREY, 255))]
        for place in ("map", "tests"):
            log(place, rr.AnnotationContext(masks), static=True)
        legend = regime_legend(snapshot.regime_names)
        regimes = [(code, label, (*colour, 255)) for code, label, colour in legend]
        log("regime", rr.AnnotationContext(regimes), static=True)
        kinds = [
            (code, terrain_label(kind), (*colour, 255))
            for code, (kind, colour) in enumerate(zip(TERRAINS, TERRAIN_COLOURS, strict=True))
        ]
        log("terrain", rr.AnnotationContext([*kinds, (UNKNOWN, "unknown", (*GREY, 255))]), static=True)
        for name, (_, label, colour) in zip([*snapshot.regime_names, "pending"], legend, strict=True):
            visible = colour if max(colour) > 100 else PALE  # the darkest cannot be seen on a dark background
            log(f"counts/{name}", rr.SeriesLines(names=label, colors=visible, widths=2.0), static=True)
        for name in ("cells_done", "cells_per_second"):
            line = rr.SeriesLines(names=name.replace("_", " "), colors=(120, 180, 255), widths=2.0)
            log(f"progress/{name}", line, static=True)
        self._arrange()

    def _arrange(self) -> None:
        send(self._blueprint(), APPLICATION, self._record)

    def _blueprint(self) -> rrb.Blueprint:
        return arrange(self._decorations, self.scope.cells)

    def _draw(self, place: str, decorations: Decorations) -> None:
        log = self._record.log
        log(f"{place}/lines", rr.LineStrips2D(decorations.lines, colors=LINE_COLOUR, radii=THIN), static=True)
        log(f"{place}/labels", _labels(decorations.places, decorations.labels), static=True)
        if decorations.bar is not None:
            where = rr.Transform3D(translation=[*decorations.bar_corner, 0.0], scale=decorations.bar_pixel)
            picture = rr.Image(decorations.bar, opacity=1.0, magnification_filter="nearest", draw_order=BEHIND)
            log(f"{place}/scale", where, picture, static=True)

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
            log(f"map/inspected/{trace.name}/number", _labels([trace.place], [str(trace.number)]))
            log(f"scope/{trace.name}/caption", _labels([trace.corner], [trace.caption]))
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

    def account(self, text: str) -> None:
        """Log the status page, Markdown."""
        self._now(among_samples=True)
        self._record.log("account", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))

    def terrain(self, codes: np.ndarray, text: str) -> None:
        """Log the terrain of the map, (ny, nx) codes, and its playability, Markdown."""
        self._now(among_samples=True)
        self._record.log("terrain/codes", _codes(codes))
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


def _depth(grid: np.ndarray, scale: tuple[float, float]) -> rr.DepthImage:
    """Return a layer of numbers; the viewer shows the value under the cursor."""
    return rr.DepthImage(
        upright(grid),
        meter=1.0,
        colormap="viridis",
        depth_range=scale,
        magnification_filter="nearest",
        draw_order=BEHIND,
    )


def _codes(grid: np.ndarray) -> rr.SegmentationImage:
    """Return a layer of codes, which have names and colours."""
    return rr.SegmentationImage(upright(grid), opacity=1.0, draw_order=ABOVE)


def _labels(places: Sequence[tuple[float, float]], texts: Sequence[str]) -> rr.Points2D:
    """Return texts, without visible points."""
    return rr.Points2D(places, labels=texts, show_labels=True, radii=0.0, colors=TEXT_COLOUR)


def _put_aside(path: Path) -> Path:
    """Rename a file with the next free number, and return its new path."""
    number = 1
    while (other := path.with_name(f"{path.stem}-{number}{path.suffix}")).exists():
        number += 1
    return path.rename(other)
