"""What a recording shows of a map: its axes, the names and colours of its codes, its pictures, its cells, its counts.

The caller sets the time before each call. Names and colours of codes (an ``AnnotationContext``) are logged once by a
dashboard, before its first picture.

Pictures are colours, not codes: of an image of codes the viewer shows wrong colours when its largest code changes. And
of any image it says only the position of a pixel. So each picture has a second entity, its cells: a short thick line
for each, on top of the picture and in the same colours, so that it is not seen. What is under the cursor is then a
cell, and the viewer shows its parameters and the meaning of its code. It does so for two values and no more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
import pyarrow as pa
import rerun as rr

from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sweep.figures.colours import regime_legend
from bow_sweep.maps.held_fixed import cell_names
from bow_sweep.maps.limit_lines import drawn
from bow_sweep.maps.limits import LABELS
from bow_sweep.maps.plane import NOT_COMPUTED, TEST_LAYERS, Plane, Snapshot, upright
from bow_sweep.view.codes import (
    Meaning,
    Motion,
    layer_codes,
    layer_meanings,
    reliability_codes,
    reliability_meanings,
    terrain_meanings,
)
from bow_sweep.view.decorations import (
    HEIGHT,
    LEGEND_STROKE,
    LINE,
    PIXEL,
    Decorations,
    cell_centres,
    cell_size,
    layer_decorations,
    legend,
    regime_decorations,
    reliability_decorations,
    terrain_decorations,
    transient_decorations,
)

LINE_COLOUR, TEXT_COLOUR, PALE, BAR_COLOUR = (190, 192, 200), (235, 236, 240), (215, 215, 215), (120, 180, 255)
BEHIND, BETWEEN, ABOVE = -20.0, -15.0, -10.0
"""Draw orders: pictures below, cells on them, what marks a cell above."""

THIN = rr.Radius.ui_points(0.75)

RGB, U8 = rr.ColorModel.RGB, rr.ChannelDatatype.U8

MOST_CELLS = 40_000
"""Larger maps have no cells to point at: each takes 100 bytes, and the viewer must draw them all."""

SPOKEN = ("map", "regime")
"""Pictures whose cells say more than their parameters when the sweep has ended."""

COVERED = 0.97
"""Share of a cell that its line covers, so that it does not touch the next one."""

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
        Axes and scales by entity path of the picture they belong to.
    radius
        Of the lines that stand for cells, units; 0 where the map has too many cells.
    """

    def __init__(self, record: rr.RecordingStream, plane: Snapshot) -> None:
        self._record, self._log, self._plane = record, record.log, plane
        self._motion = Motion(plane.regime_names, plane.periods, real=plane.values.get("gesture") == "guettler")
        tests = {f"tests/{name}": layer_decorations(plane, name) for name in TEST_LAYERS}
        self.decorations: dict[str, Decorations] = {
            "map": transient_decorations(plane),
            **tests,
            "regime": regime_decorations(plane),
            "terrain": terrain_decorations(plane),
        }
        if "repeats" in plane.values:
            self.decorations["reliability"] = reliability_decorations(plane)
        meanings = {
            "map": self._motion.meanings(by_regime=False),
            **{f"tests/{name}": layer_meanings(name) for name in TEST_LAYERS},
            "regime": self._motion.meanings(by_regime=True),
            "terrain": terrain_meanings(),
            **({"reliability": reliability_meanings()} if "reliability" in self.decorations else {}),
        }
        self._name_codes(meanings)
        self._paint = {place: _palette(known) for place, known in meanings.items()}
        self._packed = {place: _packed(palette) for place, palette in self._paint.items()}
        self._name_lines()
        for place, decorations in self.decorations.items():
            draw(self._log, f"{place}/axes", decorations)
            draw_limits(self._log, f"{place}/axes/limits", plane)
        self._place_cells()

    def _name_codes(self, meanings: Mapping[str, Sequence[Meaning]]) -> None:
        """Log names and colours of the codes of every picture: as static data, and at the start of all timelines.

        Rerun 0.41 needs both. A viewer that receives static ones a second time, from a dashboard that was started
        again, does not use them any more; a viewer that opens a file does not use those of a timeline. Where it uses
        none, it paints all codes in colours of its own.
        """
        self._record.reset_time()
        self._record.set_time("sweep", duration=0.0)
        for name in SEQUENCES:
            self._record.set_time(name, sequence=0)
        for place, known in meanings.items():
            names = context(known)
            self._log(place, names, static=True)
            self._log(place, names)
        self._record.reset_time()

    def _name_lines(self) -> None:
        """Log names and colours of the lines that are drawn over time, and their legend."""
        known = regime_legend(self._plane.regime_names)
        # the darkest cannot be seen on a dark background
        colours = [colour if max(colour) > 100 else PALE for _, _, colour in known]
        labels = [label for _, label, _ in known]
        self._log("counts", rr.SeriesLines(names=labels, colors=colours, widths=[2.0] * len(labels)), static=True)
        strokes, boxes = legend(labels)
        self._log("legend/colours", rr.LineStrips2D(strokes, colors=colours, radii=LEGEND_STROKE / 2), static=True)
        places = [((left + right) / 2, top) for left, top, right, _ in boxes]
        self._log("legend/names", texts(places, labels), static=True)

    def _place_cells(self) -> None:
        """Log the size of the pictures, and the places and names of the cells."""
        width, height = cell_size(self._plane)
        look = rr.Image.from_fields(opacity=1.0, draw_order=BEHIND, magnification_filter="nearest")
        for place in self.decorations:
            self._log(f"{place}/picture", rr.Transform3D(scale=[width, height, 1.0]), look, static=True)
        self.radius = 0.0
        if self._plane.regime.size > MOST_CELLS:
            return
        self.radius = COVERED * min(width, height) / 2
        reach = np.array([max(width - height, 0.02 * width), 0.0] if width >= height else [0.0, height - width]) / 2
        centres = cell_centres(self._plane)
        lines = strips(np.stack([centres - reach, centres + reach], axis=1))
        self._names = cell_names(self._plane)
        drawn_cells = rr.LineStrips2D(lines, radii=self.radius, show_labels=False, draw_order=BETWEEN)
        names = rr.AnyValues(cell=self._names)
        for place in self.decorations:
            self._log(f"{place}/cells", drawn_cells, *([] if place in SPOKEN else [names]), static=True)

    def show(self, snapshot: Snapshot) -> None:
        """Log the pictures of a map, and how many cells have each transient length."""
        for place, codes in self._all_codes(snapshot).items():
            self._show(place, codes)
        self._log("lengths", _bars(snapshot))

    def counts(self) -> None:
        """Log how many cells of the latest map are in each regime: lines over time, on one timeline only."""
        self._log("counts", rr.Scalars(self._motion.of_regimes(self._last).astype(float)))

    def show_tests(self, tests: Iterable[tuple[int, Snapshot]]) -> None:
        """Log what :meth:`show` and :meth:`counts` do, on the timeline `test`; it sets the time itself.

        Parameters
        ----------
        tests
            Numbers of periods, and the map after them.
        """
        send = self._record.send_columns
        times: list[int] = []
        codes: dict[str, list[np.ndarray]] = {}
        counts = []
        for periods, snapshot in tests:
            times.append(periods)
            for place, made in self._all_codes(snapshot).items():
                codes.setdefault(place, []).append(made)
            counts.append(self._motion.of_regimes(self._last).astype(float))
            self._record.reset_time()
            self._record.set_time("test", sequence=periods)
            self._log("lengths", _bars(snapshot))
        at = [rr.TimeColumn("test", sequence=times)]
        for place, series in codes.items():
            height, width = series[0].shape
            form = rr.components.ImageFormat(width=width, height=height, color_model=RGB, channel_datatype=U8)
            pixels = [self._paint[place].take(upright(made), axis=0).tobytes() for made in series]
            send(f"{place}/picture", at, rr.Image.columns(buffer=pixels, format=[form] * len(times)))
            if self.radius:
                flat = np.concatenate([made.ravel() for made in series])
                cells = rr.LineStrips2D.columns(class_ids=flat, colors=self._packed[place].take(flat))
                send(f"{place}/cells", at, cells.partition([series[0].size] * len(times)))
        send("counts", at, rr.Scalars.columns(scalars=np.concatenate(counts)).partition([len(counts[0])] * len(times)))

    def _all_codes(self, snapshot: Snapshot) -> dict[str, np.ndarray]:
        """Return the codes of every picture of a map by its place, (ny, nx) uint16."""
        motion = self._motion.codes(snapshot.transient_periods, snapshot.regime, snapshot.regime_names)
        self._last = motion
        missing = snapshot.mask() == NOT_COMPUTED
        tests = {f"tests/{name}": layer_codes(name, getattr(snapshot, name), missing) for name in TEST_LAYERS}
        return {"map": motion, "regime": motion, **tests}

    def say(self, words: Sequence[str] = ()) -> None:
        """Log the names of the cells and what else is said of each, in their order, for the two main pictures."""
        if self.radius:
            said = [f"{name}{what}" for name, what in zip(self._names, words, strict=True)] if words else self._names
            names = rr.AnyValues(cell=said)
            for place in SPOKEN:
                self._log(f"{place}/cells", names)

    def terrain(self, codes: np.ndarray) -> None:
        """Log the terrain of the map, (ny, nx) codes."""
        self._show("terrain", codes.astype(np.uint16))

    def reliability(self, shares: np.ndarray) -> None:
        """Log the shares of repeats that end as their cell, (ny, nx); only of a sweep with repeats."""
        self._show("reliability", reliability_codes(shares))

    def _show(self, place: str, codes: np.ndarray) -> None:
        """Log a picture and the same codes of its cells, (ny, nx)."""
        self._log(f"{place}/picture", rr.Image(self._paint[place].take(upright(codes), axis=0), color_model=RGB))
        if self.radius:
            flat = codes.ravel()
            colours = self._packed[place].take(flat)
            self._log(f"{place}/cells", rr.LineStrips2D.from_fields(class_ids=flat, colors=colours))


def _bars(plane: Plane) -> rr.BarChart:
    """Return how many cells have each transient length."""
    ends = np.arange(CHUNK_PERIODS, plane.periods + 1, CHUNK_PERIODS)
    found = plane.transient_periods[np.nan_to_num(plane.transient_periods) > 0]
    counts = np.bincount(np.ceil(found / CHUNK_PERIODS).astype(int), minlength=len(ends) + 1)[1 : len(ends) + 1]
    widths = np.full(len(ends), 0.9 * CHUNK_PERIODS)
    return rr.BarChart(tensor(counts), abscissa=tensor(ends), widths=widths, color=BAR_COLOUR)


def tensor(values: np.ndarray) -> pa.Array:
    """Return whole numbers, (n,) int64, as rerun wants a tensor: as Arrow, which rerun makes by pyarrow.compute.

    To import that takes 30 ms of CPU.
    """
    kind = rr.components.TensorDataBatch._ARROW_DATATYPE
    buffer = kind.field("buffer").type  # a union: a list of numbers of one of the types
    names = [field.name for field in buffer]
    chosen = np.array([buffer.type_codes[names.index("I64")]], np.int8)
    lists = [pa.array([values] if field.name == "I64" else [], field.type) for field in buffer]
    where = [None, pa.py_buffer(chosen), pa.py_buffer(np.zeros(1, np.int32))]
    union = pa.Array.from_buffers(buffer, 1, where, children=lists)
    shape = pa.array([values.shape], kind.field("shape").type)
    return pa.StructArray.from_arrays([shape, pa.nulls(1, kind.field("names").type), union], fields=list(kind))


def _palette(meanings: Sequence[Meaning]) -> np.ndarray:
    """Return the colour of each code, (codes, 3) uint8."""
    table = np.zeros((max(each.code for each in meanings) + 1, 3), np.uint8)
    table[[each.code for each in meanings]] = [each.colour for each in meanings]
    return table


def _packed(colours: np.ndarray) -> np.ndarray:
    """Return opaque colours, (n, 3) uint8, as rerun packs them: (n,) uint32.

    Cells have colours of their own beside their codes: a viewer that was connected to another dashboard of the run
    before may use colours of its own for codes.
    """
    red, green, blue = colours.astype(np.uint32).T
    return red << 24 | green << 16 | blue << 8 | 255


def context(meanings: Sequence[Meaning]) -> rr.AnnotationContext:
    """Return names and colours as rerun wants them: as Arrow, fifty times quicker than from its own classes."""
    known = [
        {
            "class_id": code,
            "class_description": {
                "info": {"id": code, "label": label, "color": int.from_bytes([*colour, 255], "big")},
                "keypoint_annotations": [],
                "keypoint_connections": [],
            },
        }
        for code, label, colour in meanings
    ]
    return rr.AnnotationContext(pa.array([known], rr.components.AnnotationContextBatch._ARROW_DATATYPE))


def draw(log: Callable[..., object], place: str, decorations: Decorations) -> None:
    """Log the axes and the scale of a picture, with a recording's `log`."""
    log(f"{place}/lines", rr.LineStrips2D(strips(decorations.lines), colors=LINE_COLOUR, radii=THIN), static=True)
    log(f"{place}/labels", texts(decorations.places, decorations.labels), static=True)
    if decorations.bar is not None:
        where = rr.Transform3D(translation=[*decorations.bar_corner, 0.0], scale=PIXEL)
        picture = rr.Image(decorations.bar, opacity=1.0, magnification_filter="nearest", draw_order=BEHIND)
        log(f"{place}/scale", where, picture, static=True)


def draw_limits(log: Callable[..., object], place: str, plane: Plane) -> None:
    """Log the limits of theory over a picture: white lines within black, with their names."""
    found = drawn(plane)
    if not found:
        return
    unit = np.array(cell_size(plane))
    lines = strips([at * unit * (1, -1) + (0, HEIGHT) for each in found for at in each.runs])
    for name, colour, wide, order in (("under", (0, 0, 0), 4.0, ABOVE), ("lines", (255, 255, 255), 1.8, ABOVE + 1)):
        radii = rr.Radius.ui_points(wide / 2)
        log(f"{place}/{name}", rr.LineStrips2D(lines, colors=colour, radii=radii, draw_order=order), static=True)
    places = [(x * unit[0], HEIGHT - y * unit[1] - LINE / 2) for x, y in (each.label for each in found)]
    log(f"{place}/names", texts(places, [LABELS[each.limit.name] for each in found]), static=True)


def strips(lines: Sequence[np.ndarray] | np.ndarray) -> pa.Array:
    """Return lines, each (points, 2), as rerun wants them: as Arrow, many times quicker than one by one."""
    ends = np.cumsum([0, *map(len, lines)], dtype=np.int32)
    form = rr.components.LineStrip2DBatch._ARROW_DATATYPE
    points = pa.FixedSizeListArray.from_arrays(np.concatenate(lines).astype(np.float32).ravel(), type=form.value_type)
    return pa.ListArray.from_arrays(ends, points, type=form)


def texts(places: Sequence[tuple[float, float]], words: Sequence[str]) -> rr.Points2D:
    """Return texts, without visible points."""
    return rr.Points2D(places, labels=words, show_labels=True, radii=0.0, colors=TEXT_COLOUR)
