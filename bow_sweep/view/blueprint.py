"""The layout of the views in the rerun viewer."""

from __future__ import annotations

from collections.abc import Mapping

import rerun as rr
import rerun.blueprint as rrb

from bow_sweep.maps.plane import TEST_LAYERS
from bow_sweep.view.decorations import LEGEND_HEIGHT, LEGEND_WIDTH, Decorations
from bow_sweep.view.scope import ROW, WIDTH, trace_name

GROUND = (24, 26, 30)
"""Background of maps: dark in both themes of the viewer, because the labels are light."""

UNSEEN = rrb.PlotLegend(visible=False)
"""A legend of the viewer covers the lines that it names; titles and a view beside the plot name them instead."""

FEWEST = 2
"""Rows that the view of inspected cells has at least."""

TEST_TITLES = {
    "correlation": "Test 1: correlation of successive periods",
    "slips": "Test 2: significant slips in five periods",
    "corners": "Test 3: travelling corners in five periods",
}

NO_CELLS = """No cell is under inspection.

Simulators publish the bridge force of the cells named by their parameter `inspect`:

    ros2 run bow simulator --ros-args -p inspect:=[4160,4200]
"""


def send(blueprint: rrb.Blueprint, application: str, record: rr.RecordingStream) -> None:
    """Send a layout to a recording, and free its memory.

    ``send_blueprint`` of rerun 0.41 makes a recording in memory that refers to itself, so that 2 MB and two threads
    remain after each call.
    """
    native = rr.bindings.new_blueprint(application, make_default=False, make_thread_default=False)
    stream = rr.RecordingStream._from_native(native)
    stream.set_time("blueprint", sequence=0)
    blueprint.to_blueprint()._log_to_stream(stream)
    storage = stream.memory_recording().storage
    rr.bindings.send_blueprint(storage, True, True, recording=record.to_native())
    stream.disconnect()


def arrange(
    decorations: Mapping[str, Decorations],
    cells: Mapping[int, str],
    pointed: bool = True,
    force: tuple[float, float] | None = None,
) -> rrb.Blueprint:
    """Return the layout: tabs for the sweep, the tests, terrain, reliability where there are repeats, and waveforms.

    Parameters
    ----------
    decorations
        Decorations of each map by entity path; a view shows their bounds at first.
    cells
        The inspected cells that have a row, and what they are called.
    pointed
        Whether maps have cells that the mouse can point at; else it points at the pixels of the picture.
    force
        Range of the bridge force that its views show at first: what the viewer chooses may be that of a few periods.
    """

    def plane(origin: str, name: str) -> rrb.Spatial2DView:
        return plane_view(origin, name, decorations[origin], pointed)

    sweep = rrb.Horizontal(
        rrb.Vertical(
            plane("map", "Transient length: the brighter, the sooner Helmholtz motion"),
            rrb.Horizontal(
                rrb.TimeSeriesView(
                    origin="counts", name="Cells by their regime at the latest test", plot_legend=UNSEEN
                ),
                _scene("legend", "Regimes", (0.0, LEGEND_WIDTH), (0.0, LEGEND_HEIGHT)),
                rrb.BarChartView(origin="lengths", name="Cells by transient length, periods", plot_legend=UNSEEN),
                column_shares=[4, 3, 3],
            ),
            row_shares=[5, 2],
        ),
        rrb.Vertical(
            rrb.TextDocumentView(origin="account", name="Accounts"),
            _scene(
                "scope",
                "Bridge force of inspected cells, latest five periods",
                (-4.0, WIDTH + 4),
                (-2.0, max(len(cells), FEWEST) * ROW + 2),
            ),
            row_shares=[3, 2],
        ),
        column_shares=[5, 2],
        name="Sweep",
    )
    tests = rrb.Grid(
        *(plane(f"tests/{name}", TEST_TITLES[name]) for name in TEST_LAYERS),
        plane("regime", "Regime at the latest test"),
        grid_columns=2,
        name="Tests and regimes",
    )
    terrain = rrb.Horizontal(
        plane("terrain", "Terrain (section IV.B), when the sweep has ended"),
        rrb.TextDocumentView(origin="playability", name="Playability"),
        column_shares=[5, 2],
        name="Terrain and playability",
    )
    sure = (
        [
            rrb.Vertical(
                plane("reliability", "Share of the repeats that end as the cell, when the sweep has ended"),
                name="Reliability",
            )
        ]
        if "reliability" in decorations
        else []
    )
    waves: list[rrb.View] = [
        rrb.TimeSeriesView(
            origin=f"waveform/{trace_name(cell)}",
            name=f"Bridge force of {name}",
            plot_legend=UNSEEN,
            axis_y=None if force is None else rrb.ScalarAxis(range=force),
        )
        for cell, name in cells.items()
    ]
    waveforms = rrb.Grid(
        *(waves or (rrb.TextDocumentView(origin="waveform/help", name="Bridge force"),)),
        grid_columns=1 if len(cells) < 4 else 2,
        name="Waveforms",
    )
    return rrb.Blueprint(
        rrb.Tabs(sweep, tests, terrain, *sure, waveforms, active_tab=0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="sweep", play_state="following"),
        auto_layout=False,
        auto_views=False,
    )


def plane_view(origin: str, name: str, decorations: Decorations, pointed: bool) -> rrb.Spatial2DView:
    """Return the view of a map with its axes; with `pointed`, its cells are what the cursor chooses."""
    (left, right), (top, bottom) = decorations.bounds
    still = rrb.EntityBehavior(interactive=False)
    return rrb.Spatial2DView(
        origin=origin,
        name=name,
        background=GROUND,
        visual_bounds=rrb.VisualBounds2D(x_range=(left, right), y_range=(top, bottom)),
        overrides={f"{origin}/{part}": still for part in ("axes", "inspected", *(["picture"] if pointed else []))},
    )


def _scene(origin: str, name: str, x: tuple[float, float], y: tuple[float, float]) -> rrb.Spatial2DView:
    bounds = rrb.VisualBounds2D(x_range=x, y_range=y)
    return rrb.Spatial2DView(
        origin=origin,
        name=name,
        background=GROUND,
        visual_bounds=bounds,
        overrides={origin: rrb.EntityBehavior(interactive=False)},
    )
