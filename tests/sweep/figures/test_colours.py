"""Colours of maps."""

import numpy as np
import pytest
from example_maps import basin_map

from bow_sweep.figures import colours as module


def test_the_sooner_the_brighter_and_black_and_grey_are_apart_from_all():
    lengths = np.array([*range(5, 105, 5), 0, np.nan], float)
    colours = module.transient_colours(lengths, 100).astype(int)
    light = colours @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(light[:20]) < 0).all()
    assert tuple(colours[20]) == module.BLACK
    assert tuple(colours[21]) == module.GREY
    assert light[19] > 25  # the latest success is not black


def test_colours_are_those_of_viridis():
    matplotlib = pytest.importorskip("matplotlib")
    share = np.linspace(0, 1, 101)
    theirs = np.array(matplotlib.colormaps["viridis"](share))[:, :3] * 255
    assert abs(module.viridis(share) - theirs).max() < 6


def test_every_regime_has_a_colour_of_its_own():
    names = [*basin_map()["regime_names"], "anomalous_low_frequency", "s_motion"]
    colours = module.regime_colours(names)
    assert len(set(colours)) == len(names)
    assert module.regime_colours(names[::-1][2:]) == colours[:-2][::-1]
    assert len(module.regime_colours([f"regime_{n}" for n in range(255)])) == 255


@pytest.mark.parametrize("kind", [None, "deuteranomaly", "protanomaly", "tritanomaly"])
@pytest.mark.parametrize("palette", ["regimes", "terrain"])
def test_colours_of_names_are_told_apart_by_colour_blind_people(palette, kind):
    from colorspacious import cspace_convert

    of = {"regimes": module.REGIME_COLOURS.values(), "terrain": module.TERRAIN_COLOURS}[palette]
    seen = np.array([*of, module.GREY]) / 255
    if kind:
        seen = cspace_convert(seen, {"name": "sRGB1+CVD", "cvd_type": kind, "severity": 100}, "sRGB1").clip(0, 1)
    places = cspace_convert(seen, "sRGB1", "CAM02-UCS")
    apart = np.linalg.norm(places[:, None] - places[None], axis=-1)[~np.eye(len(places), dtype=bool)]
    assert apart.min() > 9  # a just noticeable difference is about 1


def test_lengths_keep_their_order_of_lightness_for_colour_blind_people():
    from colorspacious import cspace_convert

    lengths = module.transient_colours(np.arange(5, 105, 5.0), 100) / 255
    for kind in ("deuteranomaly", "protanomaly", "tritanomaly"):
        seen = cspace_convert(lengths, {"name": "sRGB1+CVD", "cvd_type": kind, "severity": 100}, "sRGB1").clip(0, 1)
        assert (np.diff(cspace_convert(seen, "sRGB1", "CAM02-UCS")[:, 0]) < 0).all()
