"""The page as a Bokeh document: maps, plots of the chosen cell, widgets, and how they are connected.

What needs no samples happens in the browser (page.js): layers, hovering, the choice of a cell. A served and a saved
page differ only in where the samples of the chosen cell come from.
"""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
from bokeh.document import Document
from bokeh.layouts import column, row
from bokeh.models.callbacks import CustomJS
from bokeh.models.ranges import Range1d
from bokeh.models.sources import ColumnDataSource
from bokeh.models.tools import CustomJSHover, HoverTool
from bokeh.models.ui import UIElement
from bokeh.models.widgets.buttons import Button
from bokeh.models.widgets.inputs import Checkbox, Select
from bokeh.models.widgets.markups import Div
from bokeh.models.widgets.sliders import Slider

from bow_sweep.explore import plots
from bow_sweep.explore.layers import Layer, difference_layer, hex_colour, layers_of, regime_names
from bow_sweep.explore.pairs import differences, nearest_cells, same_plane
from bow_sweep.explore.samples import FLOOR_DB
from bow_sweep.figures.colours import regime_colours
from bow_sweep.maps.axes import PLAIN_SYMBOLS, PlotAxis
from bow_sweep.maps.held_fixed import axis_units
from bow_sweep.maps.map_file import MapFile
from bow_sweep.maps.plane import MODEL_NAMES, terrain_label
from bow_sweep.maps.terrain import TERRAINS

TITLE = "bow explore"

SECONDS = 2.0
"""Length of a sound."""


@dataclass(frozen=True, eq=False)
class Shown:
    """A run as the page shows it.

    Attributes
    ----------
    name
        Of its directory.
    map
        Its map.
    sample_rate, period
        Of the simulation: Hz, and samples of a nominal period.
    """

    name: str
    map: MapFile
    sample_rate: float
    period: int


@dataclass(eq=False)
class Panel:
    """The models of one run in the page.

    Attributes
    ----------
    wave
        Columns `time` (nominal periods) and `force`.
    slips
        Columns `left`, `right`: beginning and end of each slip, nominal periods.
    spectrum, harmonics
        Columns `frequency` (kHz) and `level` (dB).
    sound
        Column `samples`: one float32 array at 48 kHz.
    note
        Where the samples come from.
    play, body
        Plays the sound; whether it goes through a violin's body.
    letter
        "A" and "B" of two runs, "" of one; the names of its models end in it.
    all_tests
        Whether it has the results of all tests, or of the last one only.
    script
        What page.js has to know of the run.
    """

    shown: Shown
    wave: ColumnDataSource
    slips: ColumnDataSource
    spectrum: ColumnDataSource
    harmonics: ColumnDataSource
    sound: ColumnDataSource
    note: Div
    play: Button
    body: Checkbox
    letter: str
    all_tests: bool
    script: dict[str, Any]
    parts: dict[str, UIElement] = field(default_factory=dict)

    def say(self, text: str) -> None:
        """Show a line of plain text below the map."""
        self.note.text = f'<div style="color:#777;padding-top:7px">{html.escape(text)}</div>'


@dataclass(eq=False)
class Page:
    """The page: a panel for each run, the chosen cells, and everything as one layout.

    Attributes
    ----------
    chosen
        Column `cell`: the chosen cell of each run.
    ready
        What the browser does when the page is there.
    """

    panels: list[Panel]
    chosen: ColumnDataSource
    select: Select
    slider: Slider
    layout: UIElement
    ready: CustomJS

    def add_to(self, document: Document) -> None:
        """Add the page to an empty document."""
        document.title = f"{TITLE}: {' and '.join(panel.shown.name for panel in self.panels)}"
        document.template = template()
        document.add_root(self.layout)
        document.js_on_event("document_ready", self.ready)


@cache
def script_text() -> str:
    """Return page.js."""
    return resources.files("bow_sweep.explore").joinpath("page.js").read_text(encoding="utf-8")


@cache
def template() -> Any:
    """Return the template of the page: Bokeh's own with page.js and a style."""
    from bokeh.core.templates import get_env

    style = "html, body { background: white; } body { padding: 0 10px; box-sizing: border-box; }"
    text = "{% extends base %}{% block postamble %}<style>STYLE</style><script>SCRIPT</script>{% endblock %}"
    return get_env().from_string(text.replace("STYLE", style).replace("SCRIPT", script_text()))


def page_of(runs: Sequence[Shown], last_periods: int | None = None, all_tests: bool = True) -> Page:
    """Return the page of one or two runs.

    Parameters
    ----------
    last_periods
        How many periods at the end of a waveform are to be had; None for all, which get an overview.
    all_tests
        Whether the page has the results of all tests, or of the last one only.
    """
    letters = ["A", "B"] if len(runs) > 1 else [""]
    layers = [layers_of(run.map) for run in runs]
    if not all_tests:
        layers = [[layer.at_last_test() for layer in made] for made in layers]
    comparable = len(runs) > 1 and same_plane(runs[0].map, runs[1].map)
    if comparable:
        layers[1].append(difference_layer(runs[0].map, runs[1].map))
    panels = [_panel(run, letter, made) for run, letter, made in zip(runs, letters, layers, strict=True)]
    chosen = ColumnDataSource(name="chosen", data={"cell": first_cells([run.map for run in runs])})
    options: Any = [(layer.name, layer.title) for layer in layers[-1]]
    select = Select(name="layer", value="transient", options=options, width=270, title="Map shows")
    slider = _slider([run.map for run in runs], all_tests)
    for panel, run in zip(panels, runs, strict=True):
        panel.script["nearest"] = [nearest_cells(run.map, other.map) for other in runs]
    show = CustomJS(code="bow.show()")
    select.js_on_change("value", show)
    slider.js_on_change("value", show)
    chosen.js_on_change("data", CustomJS(code="bow.chose()"))
    maps = [panel.script for panel in panels]
    given = {"maps": maps, "chosen": chosen, "select": select, "slider": slider, "floor": FLOOR_DB}
    ready = CustomJS(args=given, code="bow.start({maps, chosen, select, slider, floor})")
    spans = [_periods(run) for run in runs]
    linked = len(set(spans)) == 1
    ranges: list[Range1d] = []
    for number, panel in enumerate(panels):
        figure = panel.parts["map"]
        tap = CustomJS(code=f"bow.tap({number}, cb_obj.x, cb_obj.y)")
        figure.js_on_event("tap", tap)
        figure.js_on_event("doubletap", tap)  # to Bokeh, two quick clicks are one, wherever they are
        if not ranges or not linked:
            begin = max(0.0, spans[number] - min(10, last_periods or 10))
            ranges = [Range1d(start=begin, end=spans[number]), plots.hearing_range(panel.shown.sample_rate)]
        _plot_cell(panel, ranges, spans[number], last_periods is None)
    head = row(_heading(runs, comparable), select, slider, sizing_mode="stretch_width", spacing=16)
    body = _one(panels[0]) if len(panels) == 1 else _two(panels)
    layout = column(head, body, sizing_mode="stretch_both", spacing=4)
    layout.tags = [ready]  # so that the sources that no figure shows belong to the document
    return Page(panels, chosen, select, slider, layout, ready)


def _periods(run: Shown) -> float:
    return float(run.map.periods)


def first_cells(maps: Sequence[MapFile]) -> list[int]:
    """Return the cells that are chosen at first: in the first map the Helmholtz motion nearest to the middle."""
    ny, nx = maps[0].shape
    lengths = np.nan_to_num(maps[0].transient_periods)
    away = np.hypot(*np.ogrid[-1 : 1 : ny * 1j, -1 : 1 : nx * 1j]) if nx > 1 and ny > 1 else np.zeros((ny, nx))
    cell = int(np.argmin(np.where(lengths > 0, away, away + 10)))
    return [cell, *(int(nearest_cells(maps[0], other)[cell]) for other in maps[1:])]


def _slider(maps: Sequence[MapFile], all_tests: bool) -> Slider:
    longest = max((plane.test_periods for plane in maps), key=lambda tests: tests[-1])
    first, last = float(longest[0]), float(longest[-1])
    step = float(longest[1] - longest[0]) if len(longest) > 1 else 1.0
    title = "after periods" if all_tests else "large map: last test only"
    return Slider(name="test", title=title, start=first, end=max(last, first + step), step=step, value=last, width=230)


# ---- one run


def _panel(run: Shown, letter: str, layers: list[Layer]) -> Panel:
    plane = run.map
    legend, details, note = (
        Div(name=f"{name}{letter}", sizing_mode="stretch_width") for name in ("legend", "details", "note")
    )
    for text in (legend, details, note):
        text.stylesheets = [plots.SMALL]
    shown = ColumnDataSource(name=f"shown{letter}", data={"image": [layers[0].values[-1]]})
    marker = ColumnDataSource(name=f"marker{letter}", data={"x": [], "y": []})
    figure, image = plots.map_figure(plane, shown, marker, plots.mapper(layers[0]), short=bool(letter))
    figure.name = f"map{letter}"
    known = {}
    for layer in layers:
        colours = plots.mapper(layer)
        bar = plots.colour_bar(layer, colours) if layer.ticks else None
        if bar is not None:
            figure.add_layout(bar, "right")
        known[layer.name] = {
            "source": ColumnDataSource(name=f"layer_{layer.name}{letter}", data={"values": list(layer.values)}),
            "mapper": colours,
            "bar": bar,
            "title": layer.title,
            "unit": f" ({layer.unit})" if layer.unit else "",
            "legends": [plots.legend_html(entries) for entries in layer.legends],
        }
    units = axis_units(plane)
    script: dict[str, Any] = {
        "layers": known,
        "shown": shown,
        "marker": marker,
        "mapper": image.glyph.color_mapper,
        "title": figure.title,
        "prefix": f"{letter}: " if letter else "",
        "legend": legend,
        "details": details,
        "details_form": _details_form(plane),
        "shape": list(plane.shape),
        "test_periods": [int(periods) for periods in plane.test_periods],
        "x": plane.x,
        "y": plane.y,
        "x_units": units[0],
        "y_units": units[1],
        "predicted": None if plane.simulated is None else (~plane.simulated).astype(np.uint8).ravel(),
        "regime_names": regime_names(plane),
        "regime_colours": [hex_colour(colour) for colour in regime_colours(plane.regime_names)],
        "terrain_names": [terrain_label(kind) for kind in TERRAINS],
    }
    figure.add_tools(_hover(plane, image, number=1 if letter == "B" else 0, difference="difference" in known))
    sources: dict[str, Any] = {
        name: ColumnDataSource(name=f"{name}{letter}", data={column: [] for column in columns})
        for name, columns in plots.COLUMNS.items()
    }
    play = Button(name=f"play{letter}", label="▶ Play", width=84)
    body = Checkbox(name=f"body{letter}", label="violin body", width=96, margin=(11, 5, 5, 5))
    everything = any(layer.by_test for layer in layers)
    panel = Panel(run, **sources, note=note, play=play, body=body, letter=letter, all_tests=everything, script=script)
    script |= sources
    panel.parts |= {"map": figure, "legend": legend, "details": details}
    return panel


def _hover(plane: MapFile, image: Any, number: int, difference: bool) -> HoverTool:
    tell = CustomJSHover(code=f"return bow.hover({number}, format, special_vars.x, special_vars.y)")
    x, y = plane.axes
    lines = [
        (_symbol(x), "@image{x}"),
        (_symbol(y), "@image{y}"),
        ("regime", "@image{regime}"),
        ("confidence", "@image{confidence}"),
        ("transient", "@image{transient}"),
        ("correlation, slips, corners", "@image{test}"),
        ("terrain", "@image{terrain}"),
        *([("transient in B − A", "@image{difference}")] if difference else []),
    ]
    return HoverTool(renderers=[image], tooltips=lines, formatters={"@image": tell})


def _symbol(axis: PlotAxis) -> str:
    return PLAIN_SYMBOLS.get(axis.name, axis.name)


def _details_form(plane: MapFile) -> str:
    x, y = (html.escape(_symbol(axis)) for axis in plane.axes)
    return (
        f"<b>{x}</b> {{x}} &nbsp; <b>{y}</b> {{y}} &nbsp; "
        '<span style="display:inline-block;width:10px;height:10px;background:{colour};border:1px solid #888"></span> '
        "{regime}{transient}{confidence}"
    )


def _plot_cell(panel: Panel, ranges: list[Range1d], periods: float, whole: bool) -> None:
    """Add the plots of the chosen cell."""
    wave = plots.wave_figure(panel.wave, panel.slips, ranges[0], periods)
    wave.name = f"waveform{panel.letter}"
    panel.parts["wave"] = wave
    panel.parts["spectrum"] = plots.spectrum_figure(panel.spectrum, panel.harmonics, ranges[1])
    if whole:
        panel.parts["overview"] = plots.overview_figure(panel.wave, ranges[0], periods)


# ---- layout


def _heading(runs: Sequence[Shown], comparable: bool) -> Div:
    names = [
        f"<b>{'AB'[n] + ': ' if len(runs) > 1 else ''}{html.escape(run.name)}</b> {_described(run)}"
        for n, run in enumerate(runs)
    ]
    lines = [" &nbsp; ".join(names)]
    if len(runs) > 1:
        apart = differences(runs[0].map, runs[1].map)
        words = "; ".join(f"{html.escape(name)} {html.escape(a)} / {html.escape(b)}" for name, a, b in apart[:6])
        words = f"A / B differ in: {words}" if words else "the same settings"
        if len(apart) > 6:
            words += f" and {len(apart) - 6} more"
        if not comparable:
            words += "; the planes are not the same, so there is no map of differences"
        lines.append(words)
    else:
        lines.append("Click a cell, or go to its neighbours with the arrow keys.")
    text = f'<div style="font-size:15px;padding-top:4px">{lines[0]}</div><div style="color:#777">{lines[1]}</div>'
    return Div(name="heading", text=text, sizing_mode="stretch_width", stylesheets=[plots.SMALL])


def _described(run: Shown) -> str:
    given = run.map.values
    ny, nx = run.map.shape
    words = [MODEL_NAMES.get(given.get("model", ""), given.get("model", "")), f"{nx} × {ny} cells"]
    return html.escape(", ".join(filter(None, words)))


def _controls(panel: Panel) -> UIElement:
    return row(panel.play, panel.body, panel.note, sizing_mode="stretch_width", spacing=8)


def _plots(panel: Panel) -> list[UIElement]:
    return [panel.parts[name] for name in ("wave", "overview", "spectrum") if name in panel.parts]


def _one(panel: Panel) -> UIElement:
    left = column(
        panel.parts["map"], panel.parts["legend"], panel.parts["details"], _controls(panel), sizing_mode="stretch_both"
    )
    right = column(*_plots(panel), sizing_mode="stretch_both")
    return row(left, right, sizing_mode="stretch_both", spacing=12)


def _two(panels: Sequence[Panel]) -> UIElement:
    columns = [
        column(
            panel.parts["map"],
            panel.parts["legend"],
            panel.parts["details"],
            _controls(panel),
            *_plots(panel),
            sizing_mode="stretch_both",
        )
        for panel in panels
    ]
    return row(*columns, sizing_mode="stretch_both", spacing=12)
