"""The planes of real strings are computed, judged and drawn, two by two cells of each."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bow_sweep.figures.maps import draw_map
from bow_sweep.maps.in_process import compute
from bow_sweep.maps.limits import limits
from bow_sweep.maps.map_file import MapFile
from bow_sweep.plan.sweep import Sweep

PLANES = ["guettler_cello", "guettler_ideal", "schelleng_cello", "schelleng_sustained", "playability", "wolf_plane"]


@pytest.mark.full
@pytest.mark.parametrize("preset", PLANES)
def test_a_plane_is_computed_and_drawn_with_its_limits(preset: str, tmp_path: Path) -> None:
    sweep = Sweep.from_spec(preset, ["x.count=2", "y.count=2", "periods=10"])
    result = MapFile.of(sweep, compute(sweep), "0" * 16)
    assert not np.isnan(result.transient_periods).any()
    assert len(limits(result)) == 2
    draw_map(result, tmp_path / "map.png")
    with Image.open(tmp_path / "map.png") as picture:
        assert picture.width > 1000


def test_the_line_of_a_limit_is_white_within_black_on_the_map() -> None:
    from example_maps import map_file

    from bow_sweep.figures import maps

    plain = map_file(8, 4)
    names = {"x_name": "bow_bridge", "y_name": "f_asym", "x": np.arange(8.0, 16.0), "y": np.geomspace(2, 30, 4)}
    kept = [line for line in plain.settings if not line.startswith(("x.", "y.", "bow_bridge"))]
    result = replace(plain, **names, settings=tuple(kept))

    def shares(drawn: MapFile) -> tuple[float, float]:
        figure = maps.map_figure(drawn, 100)
        figure.canvas.draw()
        box = figure.axes[0].get_window_extent()
        pixels = np.asarray(figure.canvas.buffer_rgba())[..., :3][::-1]
        inside = pixels[round(box.y0) + 4 : round(box.y1) - 4, round(box.x0) + 4 : round(box.x1) - 4]
        return float((inside > 250).all(axis=-1).mean()), float((inside < 5).all(axis=-1).mean())

    white, black = shares(result)
    without = shares(replace(result, settings=()))
    assert white > 0.003 > without[0]
    assert black > without[1]
