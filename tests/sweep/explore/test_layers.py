"""What a map of the page can show: the colours of map.png, legends that add up, differences, nearest cells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from example_maps import REGIMES, map_file

from bow_sim.protocol.verdict_fields import PENDING
from bow_sweep.explore.layers import Layer, difference_layer, layers_of
from bow_sweep.explore.pairs import differences, nearest_cells, same_plane
from bow_sweep.figures.colours import BLACK, GREY, transient_colours
from bow_sweep.figures.maps import layer_colours, regime_picture
from bow_sweep.figures.terrain import terrain_colours
from bow_sweep.maps.map_file import MapFile
from bow_sweep.maps.terrain import terrain

NX, NY = 8, 4


def by_name(plane: MapFile) -> dict[str, Layer]:
    return {layer.name: layer for layer in layers_of(plane)}


def partly() -> MapFile:
    """A map whose last ten cells are not computed, with a history of regimes."""
    plane = map_file(NX, NY, computed=NX * NY - 10)
    regimes = np.broadcast_to(plane.regime, (20, NY, NX)).copy()
    regimes[0] = np.where(plane.regime == PENDING, PENDING, REGIMES.index("aperiodic"))
    confidence = np.where(regimes == PENDING, np.nan, 0.7).astype(np.float32)
    return replace(plane, regimes=regimes, confidence=confidence)


def test_the_colours_are_those_of_the_pictures() -> None:
    plane = partly()
    layers = by_name(plane)
    assert list(layers) == [
        *("transient", "regime", "correlation", "slips", "corners", "helmholtz", "confidence", "terrain")
    ]
    wanted = transient_colours(plane.transient_periods, plane.periods)
    np.testing.assert_array_equal(layers["transient"].colours(), wanted)
    np.testing.assert_array_equal(layers["regime"].colours(), regime_picture(plane))
    np.testing.assert_array_equal(layers["terrain"].colours(), terrain_colours(terrain(plane.transient_periods)))
    known = ~np.isnan(plane.transient_periods)
    for name in ("slips", "corners", "correlation"):
        wanted = np.where(known[..., None], layer_colours(name, getattr(plane, name)[-1]), GREY)
        apart = np.abs(layers[name].colours().astype(int) - wanted)
        assert apart.max() <= (2 if name == "correlation" else 0)  # 256 colours in place of a continuous scale
    passed = layers["helmholtz"].colours()
    assert (passed[0] == 255).all() and (passed[1] == 0).all() and (passed[-1, -1] == GREY).all()


def test_a_layer_by_test_has_what_every_cell_was_at_that_test() -> None:
    layer = by_name(partly())["regime"]
    assert layer.by_test
    assert len(layer.values) == len(layer.legends) == 20
    assert [entry.label for entry in layer.legends[0]] == ["aperiodic", "not computed"]
    assert not np.array_equal(layer.colours(0), layer.colours(19))
    assert not layer.at_last_test().by_test
    np.testing.assert_array_equal(layer.at_last_test().colours(), layer.colours(19))


def test_a_legend_has_the_shares_of_the_map() -> None:
    plane = partly()
    for layer in layers_of(plane):
        colours = layer.colours()
        for entry in layer.legends[-1]:
            assert (colours == entry.colour).all(axis=2).mean() == pytest.approx(entry.share), (layer.name, entry)
        if not layer.ticks:
            assert sum(entry.share for entry in layer.legends[-1]) == pytest.approx(1)


def test_an_older_map_has_no_confidence_and_the_latest_regimes_only() -> None:
    layers = by_name(map_file(NX, NY))
    assert "confidence" not in layers
    assert not layers["regime"].by_test


def changed(plane: MapFile, lengths: np.ndarray) -> MapFile:
    return replace(plane, transient_periods=lengths.astype(np.float32))


def test_a_difference_says_where_only_one_has_helmholtz_motion() -> None:
    plane = map_file(4, 2)
    one = changed(plane, np.array([[10, 20, 0, 0], [50, 50, np.nan, 5]]))
    two = changed(plane, np.array([[30, 10, 40, 0], [0, 50, 10, 5]]))
    layer = difference_layer(one, two)
    colours = layer.colours()
    shares = {entry.label: entry for entry in layer.legends[0]}
    assert set(shares) == {"Helmholtz motion in A only", "in B only", "in neither", "not computed"}
    assert tuple(colours[1, 0]) == shares["Helmholtz motion in A only"].colour
    assert tuple(colours[0, 2]) == shares["in B only"].colour
    red, blue, middle = colours[0, 0], colours[0, 1], colours[1, 1]
    assert red[0] > red[2] and blue[2] > blue[0]  # later, sooner
    np.testing.assert_array_equal(middle, colours[1, 3])
    assert layer.values[0][0, 0] == 20
    assert tuple(colours[0, 3]) == BLACK
    assert tuple(colours[1, 2]) == GREY


def test_the_nearest_cell_has_the_same_values_of_the_parameters() -> None:
    small, large = map_file(8, 4), map_file(32, 16)
    cells = nearest_cells(small, large)
    iy, ix = np.divmod(cells, 32)
    for cell in range(8 * 4):
        own_y, own_x = divmod(cell, 8)
        best = np.argmin(np.abs(np.log(large.x / small.x[own_x]))), np.argmin(np.abs(large.y - small.y[own_y]))
        assert (ix[cell], iy[cell]) == best
    np.testing.assert_array_equal(nearest_cells(small, small), np.arange(32))


def test_another_plane_takes_the_settings_for_its_axes() -> None:
    force = map_file(8, 4)  # f_asym, f_init_ratio; v_mid 0.2
    other = replace(force, y_name="v_mid", y=np.array([-1.0, 0.0, 0.25, 0.9]))
    cells = nearest_cells(force, other)
    np.testing.assert_array_equal(cells, 2 * 8 + np.arange(32) % 8)
    assert not same_plane(force, other)
    assert same_plane(force, map_file(8, 4))
    assert not same_plane(force, map_file(8, 5))


def test_settings_that_differ_are_named() -> None:
    one = map_file()
    two = replace(one, settings=tuple(s.replace("v_mid=0.2", "v_mid=0.7") for s in one.settings))
    assert differences(one, two) == [("v_mid", "0.2", "0.7")]
    assert differences(one, map_file(16, 8)) == []
