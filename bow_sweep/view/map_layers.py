"""What a recording shows of a map: its axes, the names and colours of its codes, its pictures and its counts.

The caller sets the time before each call. Names and colours of codes (an ``AnnotationContext``) are logged once by a
dashboard, before its first picture.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr

from bow_sim.protocol.verdict_fields import PENDING
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
from bow_sweep.view.decorations import (
    Decorations,
    layer_decorations,
    regime_decorations,
    terrain_decorations,
    transient_decorations,
)

LINE_COLOUR, TEXT_COLOUR, PALE = (190, 192, 200), (235, 236, 240), (215, 215, 215)
BEHIND, ABOVE = -20.0, -10.0
"""Draw orders: values below, the mask that makes cells black or grey above."""

THIN = rr.Radius.ui_points(0.75)

FOREIGN = 254
"""Code, in the picture, of a regime that was not among the names at the beginning."""

FOREIGN_LABEL, FOREIGN_COLOUR = "a regime unknown here", (128, 0, 64)

SEQUENCES = ("sample", "test")
"""Timelines beside `sweep`, on which numbers count."""

CONTEXT = "AnnotationContext:context"
"""Column of the names and colours of codes in a recording."""


class MapLayers:
    """The pictures of one map in a recording.

    Parameters
    ----------
    record
        The recording.
    plane
        The map as planned. Its axes, settings and regime names are those of all pictures.

    Attributes
    ----------
    decorations
        Axes and scales by entity path of the map they belong to.
    """

    def __init__(self, record: rr.RecordingStream, plane: Snapshot) -> None:
        self._record, self._log, self._plane = record, record.log, plane
        tests = {f"tests/{name}": layer_decorations(plane, name) for name in TEST_LAYERS}
        self.decorations: dict[str, Decorations] = {
            "map": transient_decorations(plane),
            **tests,
            "regime": regime_decorations(plane),
            "terrain": terrain_decorations(plane),
        }
        self._codes_by_names: dict[tuple[str, ...], np.ndarray] = {}
        self._name_codes()
        self._name_lines()
        for place, decorations in self.decorations.items():
            self._draw(f"{place}/axes", decorations)

    def _name_codes(self) -> None:
        """Log names and colours of the codes of every picture: as static data, and at the start of all timelines.

        Rerun 0.41 needs both. A viewer that receives static ones a second time, from a dashboard that was started
        again, does not use them any more; a viewer that opens a file does not use those of a timeline. Where it uses
        none, it paints all codes in colours of its own.
        """
        self._record.reset_time()
        self._record.set_time("sweep", duration=0.0)
        for name in SEQUENCES:
            self._record.set_time(name, sequence=0)
        masks = [(CLEAR, "", (0, 0, 0, 0)), (NEVER, "never", (*BLACK, 255)), (NOT_COMPUTED, "pending", (*GREY, 255))]
        regimes = [(code, label, (*colour, 255)) for code, label, colour in regime_legend(self._plane.regime_names)]
        kinds = [
            (code, terrain_label(kind), (*colour, 255))
            for code, (kind, colour) in enumerate(zip(TERRAINS, TERRAIN_COLOURS, strict=True))
        ]
        for place, classes in {
            "map": masks,
            "tests": masks,
            "regime": [*regimes, (FOREIGN, FOREIGN_LABEL, (*FOREIGN_COLOUR, 255))],
            "terrain": [*kinds, (UNKNOWN, "unknown", (*GREY, 255))],
        }.items():
            self._log(place, rr.AnnotationContext(classes), static=True)
            self._log(place, rr.AnnotationContext(classes))
        self._record.reset_time()

    def _name_lines(self) -> None:
        """Log names and colours of the lines that are drawn over time."""
        for name, (_, label, colour) in zip(
            [*self._plane.regime_names, "pending"], regime_legend(self._plane.regime_names), strict=True
        ):
            visible = colour if max(colour) > 100 else PALE  # the darkest cannot be seen on a dark background
            self._log(f"counts/{name}", rr.SeriesLines(names=label, colors=visible, widths=2.0), static=True)
        for name in ("cells_done", "cells_per_second"):
            line = rr.SeriesLines(names=name.replace("_", " "), colors=(120, 180, 255), widths=2.0)
            self._log(f"progress/{name}", line, static=True)

    def _draw(self, place: str, decorations: Decorations) -> None:
        log = self._log
        log(f"{place}/lines", rr.LineStrips2D(decorations.lines, colors=LINE_COLOUR, radii=THIN), static=True)
        log(f"{place}/labels", texts(decorations.places, decorations.labels), static=True)
        if decorations.bar is not None:
            where = rr.Transform3D(translation=[*decorations.bar_corner, 0.0], scale=decorations.bar_pixel)
            picture = rr.Image(decorations.bar, opacity=1.0, magnification_filter="nearest", draw_order=BEHIND)
            log(f"{place}/scale", where, picture, static=True)

    def pictures(self, snapshot: Snapshot) -> None:
        """Log the pictures of a map."""
        log, mask = self._log, snapshot.mask()
        log("map/transient", _depth(snapshot.transient_periods, (HEADROOM * snapshot.periods, 0.0)))
        log("map/mask", _codes(mask))
        for name in TEST_LAYERS:
            log(f"tests/{name}/values", _depth(getattr(snapshot, name), TEST_RANGES[name]))
        log("tests/pending", _codes(np.where(mask == NOT_COMPUTED, NOT_COMPUTED, CLEAR).astype(np.uint8)))
        log("regime/codes", _codes(self._own_codes(snapshot.regime_names)[snapshot.regime]))

    def counts(self, snapshot: Snapshot, rate: float) -> None:
        """Log how many cells are in each regime, and how many are done; `rate` is cells per second."""
        counts = np.bincount(self._own_codes(snapshot.regime_names)[snapshot.regime].ravel(), minlength=PENDING + 1)
        for code, name in enumerate(self._plane.regime_names):
            self._log(f"counts/{name}", rr.Scalars(float(counts[code])))
        self._log("counts/pending", rr.Scalars(float(counts[PENDING])))
        self._log("progress/cells_done", rr.Scalars(float(snapshot.done)))
        self._log("progress/cells_per_second", rr.Scalars(rate))

    def terrain(self, codes: np.ndarray) -> None:
        """Log the terrain of the map, (ny, nx) codes."""
        self._log("terrain/codes", _codes(codes))

    def _own_codes(self, names: tuple[str, ...]) -> np.ndarray:
        """Return a table, (256,) uint8, from the codes of a map with these regime names to those of the pictures."""
        if names not in self._codes_by_names:
            table = np.full(PENDING + 1, FOREIGN, np.uint8)
            table[PENDING] = PENDING
            own = {name: code for code, name in enumerate(self._plane.regime_names)}
            for code, name in enumerate(names):
                table[code] = own.get(name, FOREIGN)
            self._codes_by_names[names] = table
        return self._codes_by_names[names]


def texts(places: Sequence[tuple[float, float]], words: Sequence[str]) -> rr.Points2D:
    """Return texts, without visible points."""
    return rr.Points2D(places, labels=words, show_labels=True, radii=0.0, colors=TEXT_COLOUR)


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
