"""The layout of the views in the rerun viewer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import rerun as rr
import rerun.blueprint as rrb

from bow_sweep.maps.plane import TEST_LAYERS
from bow_sweep.view.decorations import Decorations
from bow_sweep.view.scope import MARGIN, MOST, ROW, WIDTH, trace_name

GROUND = (24, 26, 30)
"""Background of maps: dark in both themes of the viewer, because the labels are light."""

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


def arrange(decorations: Mapping[str, Decorations], cells: Sequence[int]) -> rrb.Blueprint:
    """Return the layout: a tab for the sweep, one for the tests, one for terrain and one for waveforms.

    Parameters
    ----------
    decorations
        Decorations of each map by entity path; a view shows their bounds at first.
    cells
        The inspected cells; `MOST` of them have a row.
    """
    sweep = rrb.Horizontal(
        rrb.Vertical(
            _plane("map", "Transient length: the brighter, the sooner Helmholtz motion", decorations),
            rrb.Horizontal(
                rrb.TimeSeriesView(
                    origin="counts", name="Cells by their regime at the latest test", plot_legend=rrb.Corner2D.RightTop
                ),
                rrb.TimeSeriesView(
                    origin="progress/cells_per_second",
                    name="Cells per second",
                    plot_legend=rrb.PlotLegend(visible=False),
                ),
                column_shares=[3, 2],
            ),
            row_shares=[5, 2],
        ),
        rrb.Vertical(
            rrb.TextDocumentView(origin="account", name="Accounts"),
            _scope(len(cells)),
            row_shares=[3, 2],
        ),
        column_shares=[5, 2],
        name="Sweep",
    )
    tests = rrb.Grid(
        *(_plane(f"tests/{name}", TEST_TITLES[name], decorations, "/tests/pending") for name in TEST_LAYERS),
        _plane("regime", "Regime at the latest test", decorations),
        grid_columns=2,
        name="Tests and regimes",
    )
    terrain = rrb.Horizontal(
        _plane("terrain", "Terrain (section IV.B), when the sweep has ended", decorations),
        rrb.TextDocumentView(origin="playability", name="Playability"),
        column_shares=[5, 2],
        name="Terrain and playability",
    )
    waves: list[rrb.View] = [
        rrb.TimeSeriesView(origin=f"waveform/{trace_name(cell)}", name=f"Bridge force of cell {cell}") for cell in cells
    ]
    waveforms = rrb.Grid(
        *(waves or (rrb.TextDocumentView(origin="waveform/help", name="Bridge force"),)),
        grid_columns=1 if len(cells) < 4 else 2,
        name="Waveforms (choose the timeline “sample” below)",
    )
    return rrb.Blueprint(
        rrb.Tabs(sweep, tests, terrain, waveforms, active_tab=0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="sweep", play_state="following"),
        auto_layout=False,
        auto_views=False,
    )


def _plane(origin: str, name: str, decorations: Mapping[str, Decorations], *also: str) -> rrb.Spatial2DView:
    bounds = None
    if origin in decorations:
        (left, right), (top, bottom) = decorations[origin].bounds
        bounds = rrb.VisualBounds2D(x_range=(left, right), y_range=(top, bottom))
    contents = ["$origin/**", *also]
    return rrb.Spatial2DView(origin=origin, contents=contents, name=name, background=GROUND, visual_bounds=bounds)


def _scope(rows: int) -> rrb.Spatial2DView:
    bounds = rrb.VisualBounds2D(x_range=(-4, WIDTH + MARGIN), y_range=(-2, max(MOST, rows) * ROW + 2))
    return rrb.Spatial2DView(
        origin="scope",
        name="Bridge force of inspected cells, latest five periods",
        background=GROUND,
        visual_bounds=bounds,
    )
