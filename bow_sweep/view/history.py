"""Every test of every cell, as a rerun recording of a finished map: `python -m bow_sweep.view.history RUN`.

The timeline `periods` steps through the tests: regime, correlation, period and confidence at each. Beside them are four
summaries: transient length, regressions, flattening at the last test, the number in the name of the regime.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from bow_sweep.figures.colours import HEADROOM, regime_legend
from bow_sweep.maps.map_file import MapFile, MapFileError, read_map_npz
from bow_sweep.maps.plane import upright
from bow_sweep.view.blueprint import GROUND

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


def write_history(path: Path, plane: MapFile) -> None:
    """Write the recording of a map.

    Raises
    ------
    MapFileError
        For an older map, which does not have the regime of each test.
    """
    if plane.regimes is None or plane.confidence is None:
        raise MapFileError("the map keeps no regime of each test: it was made before maps had a history")
    record = rr.RecordingStream("bow_history", recording_id=plane.run_id or None)
    record.save(path)
    legend = [(code, label, (*colour, 255)) for code, label, colour in regime_legend(plane.regime_names)]
    record.log("steps/regime", rr.AnnotationContext(legend), static=True)
    flat = plane.flattening
    spread = float(np.nanmax(np.abs(flat), initial=1.0))
    for name, grid, scale in (
        ("transient", plane.transient_periods, (HEADROOM * plane.periods, 0.0)),
        ("regressions", plane.regressions.astype(np.float32), (0.0, float(max(plane.regressions.max(initial=1), 1)))),
        ("flattening", flat, (-spread, spread)),
        ("count", plane.count.astype(np.float32), (0.0, 9.0)),
    ):
        record.log(f"summary/{name}", _layer(grid, scale), static=True)
    nominal = float(plane.values.get("period", 139))
    for test, periods in enumerate(plane.test_periods.tolist()):
        record.set_time("periods", sequence=int(periods))
        record.log("steps/regime", rr.SegmentationImage(upright(plane.regimes[test]), opacity=1.0))
        record.log("steps/correlation", _layer(plane.correlation[test], (0.0, 1.0)))
        record.log("steps/period", _layer(plane.period[test], (0.96 * nominal, 1.05 * nominal)))
        record.log("steps/confidence", _layer(plane.confidence[test], (0.0, 1.0)))
    views = [
        rrb.Spatial2DView(origin=f"{group}/{name}", name=title, background=GROUND)
        for group, titles in (("steps", STEPS), ("summary", SUMMARY))
        for name, title in titles.items()
    ]
    record.send_blueprint(rrb.Blueprint(rrb.Grid(*views, grid_columns=4), auto_layout=False, auto_views=False))
    record.flush()
    record.disconnect()


def _layer(grid: np.ndarray, scale: tuple[float, float]) -> rr.DepthImage:
    """Return a layer of numbers; the viewer shows the value under the cursor."""
    image = upright(np.asarray(grid, np.float32))
    return rr.DepthImage(image, meter=1.0, colormap="viridis", depth_range=scale, magnification_filter="nearest")


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
