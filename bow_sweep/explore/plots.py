"""The figures of the page: a map, the waveform of a cell with its slips, its spectrum; their colours and legends."""

from __future__ import annotations

import html
from collections.abc import Iterable
from typing import Any

from bokeh.models.annotations import ColorBar
from bokeh.models.mappers import LinearColorMapper
from bokeh.models.ranges import DataRange1d, Range1d
from bokeh.models.renderers import GlyphRenderer
from bokeh.models.sources import ColumnDataSource
from bokeh.models.tickers import FixedTicker
from bokeh.models.tools import BoxZoomTool, CrosshairTool, PanTool, RangeTool, ResetTool, WheelZoomTool
from bokeh.plotting import figure

from bow_sweep.explore.layers import Entry, Layer, hex_colour
from bow_sweep.maps.axes import PLAIN_SYMBOLS, PlotAxis
from bow_sweep.maps.limit_lines import drawn
from bow_sweep.maps.limits import LABELS
from bow_sweep.maps.plane import Plane

BLUE, MUTED, ORANGE, GRID = "#1f4e79", "#777777", "#d55e00", "#e8e8e8"
"""Waveforms, words of second rank, slips and harmonics, grid lines."""

SMALL = ":host { font: 13px/1.35 system-ui, sans-serif; color: #222; }"
"""Style of texts."""

COLUMNS = {
    "wave": ("time", "force"),
    "slips": ("left", "right"),
    "spectrum": ("frequency", "level"),
    "harmonics": ("frequency", "level"),
    "sound": ("samples",),
}
"""Data of a chosen cell: source -> columns."""


def plain_figure(**options: Any) -> Any:
    """Return an empty figure in the style of the page."""
    made: Any = figure(tools="", toolbar_location="above", sizing_mode="stretch_both", min_border=2, **options)
    made.toolbar.logo = None
    made.toolbar.autohide = True
    made.outline_line_color = "#999999"
    made.title.text_font_size = "13px"
    made.title.text_font_style = "normal"
    for axis in (*made.xaxis, *made.yaxis):
        axis.axis_label_text_font_style = "normal"
        axis.axis_label_text_font_size = "12px"
        axis.major_label_text_font_size = "11px"
        axis.axis_label_standoff = 4
    made.grid.grid_line_color = GRID
    return made


def map_figure(
    plane: Plane, shown: ColumnDataSource, marker: ColumnDataSource, colours: LinearColorMapper, short: bool
) -> tuple[Any, GlyphRenderer[Any]]:
    """Return a map with its axes, and the renderer of its cells. Positions are in cells, as in `PlotAxis`.

    `short` is for one of two maps: the title of the y axis is its symbol.
    """
    ny, nx = plane.shape
    made = plain_figure(
        x_range=Range1d(start=0, end=nx, bounds="auto"), y_range=Range1d(start=0, end=ny, bounds="auto"), title=""
    )
    made.min_height = 250 if short else 300
    made.grid.visible = False
    image = made.image("image", source=shown, x=0, y=0, dw=nx, dh=ny, color_mapper=colours)
    for each in drawn(plane):
        for run in each.runs:
            for colour, width in (("black", 3.5), ("white", 1.5)):
                made.line(*run.T, line_color=colour, line_width=width)
        x, y = each.label
        words = {"text_align": "center", "text_baseline": "middle", "text_font_size": "12px", "padding": 3}
        made.text([x], [y], [LABELS[each.limit.name]], text_color="white", background_fill_color="#222222", **words)
    for colour, width in (("black", 4), ("white", 2)):
        made.scatter(
            "x", "y", source=marker, marker="square", size=13, fill_alpha=0, line_color=colour, line_width=width
        )
    for shown_axis, axis in ((made.xaxis[0], plane.axes[0]), (made.yaxis[0], plane.axes[1])):
        _ticks(shown_axis, axis)
        shown_axis.axis_label = axis.title(plane.settings)
    if short:
        made.yaxis.axis_label = PLAIN_SYMBOLS.get(plane.y_name, plane.y_name)
    made.add_tools(PanTool(), WheelZoomTool(), BoxZoomTool(), ResetTool())
    return made, image


def _ticks(shown: Any, axis: PlotAxis) -> None:
    ticks = axis.ticks()
    labelled = [tick for tick in ticks if tick.text]
    minor = [tick.position for tick in ticks if not tick.text]
    shown.ticker = FixedTicker(ticks=[tick.position for tick in labelled], minor_ticks=minor)
    shown.major_label_overrides = {tick.position: tick.text for tick in labelled}


def mapper(layer: Layer) -> LinearColorMapper:
    """Return the colours of a layer."""
    return LinearColorMapper(
        palette=[hex_colour(colour) for colour in layer.palette],
        low=layer.low,
        high=layer.high,
        low_color=hex_colour(layer.below),
        high_color=hex_colour(layer.above),
        nan_color=hex_colour(layer.unknown),
    )


def colour_bar(layer: Layer, colours: LinearColorMapper) -> ColorBar:
    """Return the colour bar of a layer that has a scale."""
    return ColorBar(
        color_mapper=colours,
        ticker=FixedTicker(ticks=list(layer.ticks)),
        title=None,
        width=12,
        padding=4,
        major_label_text_font_size="11px",
        bar_line_color="#999999",
        visible=False,
        name=f"bar_{layer.name}",
    )


def legend_html(entries: Iterable[Entry]) -> str:
    """Return the legend of a layer: a swatch, a name and a share for each entry."""
    box = "display:inline-block;width:11px;height:11px;border:1px solid #888;vertical-align:-1px;margin-right:4px"
    return "".join(
        f'<span style="white-space:nowrap;margin-right:12px"><span style="{box};background:{hex_colour(entry.colour)}">'
        f'</span>{html.escape(entry.label)} <span style="color:{MUTED}">{100 * entry.share:.1f} %</span></span> '
        for entry in entries
    )


def wave_figure(wave: ColumnDataSource, slips: ColumnDataSource, shown: Range1d, periods: float) -> Any:
    """Return the plot of a bridge force, with a bar below it wherever the string slips."""
    made = plain_figure(
        x_range=shown, y_range=DataRange1d(range_padding=0.12), title="bridge force; bars: the string slips"
    )
    made.min_height = 120
    made.extra_y_ranges = {"bars": Range1d(start=0, end=1)}
    made.quad(
        left="left", right="right", bottom=0.0, top=0.045, source=slips, y_range_name="bars", color=ORANGE, line_width=0
    )
    line = made.line("time", "force", source=wave, color=BLUE, line_width=1.2)
    made.y_range.renderers = [line]
    made.xaxis.axis_label = "time (nominal periods)"
    made.yaxis.axis_label = "bridge force"
    made.add_tools(
        PanTool(dimensions="width"), WheelZoomTool(dimensions="width"), BoxZoomTool(dimensions="width"), ResetTool()
    )
    made.add_tools(CrosshairTool(dimensions="height", line_color=MUTED, line_alpha=0.5))
    return made


def overview_figure(wave: ColumnDataSource, shown: Range1d, periods: float) -> Any:
    """Return the whole waveform, with a window on it that can be moved: what :func:`wave_figure` shows."""
    made = plain_figure(x_range=Range1d(start=0, end=periods), y_range=DataRange1d(range_padding=0.05))
    made.sizing_mode = "stretch_width"
    made.height = 34
    made.xaxis.visible = False
    made.toolbar_location = None
    made.line("time", "force", source=wave, color=BLUE, line_width=0.5)
    made.yaxis.visible = False
    made.grid.visible = False
    tool = RangeTool(x_range=shown)
    tool.overlay.fill_color = ORANGE
    tool.overlay.fill_alpha = 0.15
    made.add_tools(tool)
    return made


def hearing_range(sample_rate: float) -> Range1d:
    """Return the range of a spectrum: kHz, to half the sample rate."""
    top = sample_rate / 2000
    return Range1d(start=0, end=min(top, 8.0), bounds=(0, top))


def spectrum_figure(spectrum: ColumnDataSource, harmonics: ColumnDataSource, shown: Range1d) -> Any:
    """Return the plot of a spectrum and its harmonics."""
    made = plain_figure(
        x_range=shown, y_range=DataRange1d(range_padding=0.08), title="spectrum of the last periods; dots: harmonics"
    )
    made.min_height = 110
    made.line("frequency", "level", source=spectrum, color=BLUE, line_width=0.8, line_alpha=0.7)
    made.scatter("frequency", "level", source=harmonics, size=5, color=ORANGE)
    made.xaxis.axis_label = "frequency (kHz)"
    made.yaxis.axis_label = "level (dB)"
    made.add_tools(
        PanTool(dimensions="width"), WheelZoomTool(dimensions="width"), BoxZoomTool(dimensions="width"), ResetTool()
    )
    return made
