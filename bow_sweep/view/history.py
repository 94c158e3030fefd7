"""Every test of every cell, as a rerun recording of a finished map: `python -m bow_sweep.view.history RUN`.

The timeline `periods` steps through the tests: regime, correlation, period and confidence at each. Beside them are four
summaries: transient length, regressions, flattening at the last test, the number in the name of the regime.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sweep.figures.colours import BLACK, GREY, regime_legend, transient_colours
from bow_sweep.maps.map_file import MapFile, MapFileError, read_map_npz
from bow_sweep.maps.plane import upright
from bow_sweep.view import bounded
from bow_sweep.view.blueprint import plane_view
from bow_sweep.view.decorations import (
    Decorations,
    cell_size,
    number_decorations,
    regime_decorations,
    transient_decorations,
)
from bow_sweep.view.map_layers import ABOVE, BEHIND, draw

FILE = "history.rrd"

SUMMARY = {
    "transient": "Transient length, periods",
    "regressions": "Regressions: tests that failed after one that passed",
    "flattening": "Flattening of Helmholtz motion at the last test, cents",
    "count": "Number that belongs to the regime: slips, corners or order",
}
STEPS = {
    "regime": "Regime at each test",
    "correlation": "Correlation",
    "period": "Period, samples",
    "confidence": "Confidence",
}

MOST_LENGTHS = 120
"""Number of transient lengths with a colour of their own; longer simulations have several lengths in one."""

NONE, GIVEN = 1, 2
"""Codes of cells without a number, and with one. The second is in every picture: rerun 0.41 paints an image of codes in
wrong colours when the largest of them is another one than before."""

NO_NUMBER = "none"
"""Name of cells that have no number in a picture."""


def write_history(path: Path, plane: MapFile) -> None:
    """Write the recording of a map.

    Raises
    ------
    MapFileError
        For an older map, which does not have the regime of each test.
    """
    if plane.regimes is None or plane.confidence is None:
        raise MapFileError("the map keeps no regime of each test: it was made before maps had a history")
    path.touch()  # raises OSError with a reason, which rerun does not give
    record = rr.RecordingStream("bow_history", recording_id=plane.run_id or None)
    record.save(path)
    spread = float(np.nanmax(np.abs(plane.flattening), initial=1.0))
    most = float(max(plane.regressions.max(initial=1), 1))
    nominal = float(plane.values.get("period", 139))
    limits = {
        "steps/correlation": (0.0, 1.0),
        "steps/period": (0.96 * nominal, 1.05 * nominal),
        "steps/confidence": (0.0, 1.0),
        "summary/regressions": (0.0, most),
        "summary/flattening": (-spread, spread),
        "summary/count": (0.0, 9.0),
    }
    titles = {f"steps/{name}": title for name, title in STEPS.items()}
    titles |= {f"summary/{name}": title for name, title in SUMMARY.items()}
    decorations = {"steps/regime": regime_decorations(plane), "summary/transient": transient_decorations(plane)}
    for place, ends in limits.items():
        decorations[place] = number_decorations(plane, place.rpartition("/")[2], ends, [(NO_NUMBER, GREY)])
    _place(record, plane, decorations)
    names = regime_legend(plane.regime_names)
    paint = np.array([colour for _, _, colour in names], np.uint8)
    levels, meanings = _levels(plane)
    record.log("summary/transient", rr.AnnotationContext(meanings), static=True)
    for place in limits:
        classes = [(NONE, NO_NUMBER, (*GREY, 255)), (GIVEN, "", (0, 0, 0, 0))]
        record.log(place, rr.AnnotationContext(classes), static=True)
    record.log("summary/transient/picture", _codes(levels), static=True)
    for name in ("regressions", "flattening", "count"):
        _numbers(record, f"summary/{name}", getattr(plane, name), limits[f"summary/{name}"], static=True)
    for test, periods in enumerate(plane.test_periods.tolist()):
        record.set_time("periods", sequence=int(periods))
        codes = np.minimum(plane.regimes[test], len(names) - 1)  # the last is "pending"
        colours = rr.Image(upright(paint[codes]), magnification_filter="nearest", draw_order=BEHIND)
        record.log("steps/regime/picture", colours)  # no codes, see NONE
        for name in ("correlation", "period", "confidence"):
            _numbers(record, f"steps/{name}", getattr(plane, name)[test], limits[f"steps/{name}"])
    tabs = [
        rrb.Grid(
            *(
                plane_view(place, titles[place], decorations[place], pointed=False)
                for place in titles
                if group in place
            ),
            grid_columns=2,
            name=name,
        )
        for group, name in (("steps", "At each test (move the timeline)"), ("summary", "Of the whole run"))
    ]
    blueprint = rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="periods"),
        auto_layout=False,
        auto_views=False,
    )
    record.send_blueprint(blueprint)
    bounded.finish(record)


def _place(record: rr.RecordingStream, plane: MapFile, decorations: Mapping[str, Decorations]) -> None:
    """Log axes and scales, and the size of the pictures."""
    width, height = cell_size(plane)
    for place, made in decorations.items():
        draw(record.log, f"{place}/axes", made)
        for picture in ("picture", "missing"):
            record.log(f"{place}/{picture}", rr.Transform3D(scale=[width, height, 1.0]), static=True)


def _levels(plane: MapFile) -> tuple[np.ndarray, list[tuple[int, str, tuple[int, int, int]]]]:
    """Return the transient lengths as codes, (ny, nx) uint8, with their names and colours.

    All are below 128: for images of larger codes rerun has used the colours of their neighbours (its issue 12939).
    """
    step = CHUNK_PERIODS * math.ceil(plane.periods / CHUNK_PERIODS / MOST_LENGTHS)
    lengths = np.minimum(step * np.arange(1, math.ceil(plane.periods / step) + 1), plane.periods)
    colours = [tuple(colour) for colour in transient_colours(lengths, plane.periods).tolist()]
    known = np.ceil(np.nan_to_num(plane.transient_periods) / step)
    levels = np.minimum(known, len(lengths)).astype(np.uint8)
    levels[np.isnan(plane.transient_periods)] = len(lengths) + 1
    words = ["never", *(f"{length:g} periods" for length in lengths.tolist()), "pending"]
    return levels, list(zip(range(len(words)), words, [BLACK, *colours, GREY], strict=True))


def _codes(grid: np.ndarray) -> rr.SegmentationImage:
    return rr.SegmentationImage(upright(grid), opacity=1.0, draw_order=BEHIND)


def _numbers(
    record: rr.RecordingStream, place: str, grid: np.ndarray, scale: tuple[float, float], static: bool = False
) -> None:
    """Log a picture of numbers, and above it where there are none; the viewer shows the value under the cursor."""
    image = upright(np.asarray(grid, np.float32))
    picture = rr.DepthImage(
        np.nan_to_num(image),
        meter=1.0,
        colormap="viridis",
        depth_range=scale,
        magnification_filter="nearest",
        draw_order=BEHIND,
    )
    record.log(f"{place}/picture", picture, static=static)
    missing = np.where(np.isnan(image), NONE, GIVEN).astype(np.uint8)
    record.log(f"{place}/missing", rr.SegmentationImage(missing, opacity=1.0, draw_order=ABOVE), static=static)


def main() -> None:
    """Write history.rrd into a run directory."""
    if len(sys.argv) != 2:
        raise SystemExit(f"usage: python -m bow_sweep.view.history RUN: writes RUN/{FILE}, to be opened with rerun")
    run = Path(sys.argv[1])
    try:
        write_history(run / FILE, read_map_npz(run / "map.npz"))
    except MapFileError as error:
        raise SystemExit(f"{run}: {error}") from None
    except (OSError, RuntimeError) as error:  # rerun raises its own RuntimeError
        raise SystemExit(f"{run / FILE}: cannot be written: {error}") from None
    print(run / FILE)


if __name__ == "__main__":
    main()
