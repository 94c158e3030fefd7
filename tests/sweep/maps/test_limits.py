"""Limits of theory over a map: closed forms, planes that have them, and what is drawn of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from planes import plane_of

from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection import ends
from bow_sweep.maps import limits as module
from bow_sweep.maps.limit_lines import drawn, limit_lines, limit_note
from bow_sweep.maps.limits import (
    HARMONICS,
    admittance,
    bridge_admittance,
    guettler_bounds,
    limit_arrays,
    limits,
    pressed,
    schelleng_max,
    schelleng_min,
)
from bow_sweep.plan.presets import presets

DASHPOT = Parameters(bridge_w_c=0.0)


def names(plane) -> list[str]:
    return [limit.name for limit in limits(plane)]


@pytest.mark.parametrize("model", ["friedlander", "torsion_absorbed", "delta_cremer"])
def test_the_admittance_at_the_bow_is_that_of_the_model(model):
    p = Parameters(model=model, torsion_admittance=0.4)
    assert admittance(p) == pytest.approx(ends(p).y)


def test_a_dashpot_alone_gives_ramans_minimum():
    force, fall = schelleng_min([DASHPOT])
    r = DASHPOT.bridge_r * 0.5  # Z_0 is 1/2
    assert force[0] == pytest.approx(0.5**2 / (2 * r * DASHPOT.beta**2 * fall[0]))


def test_a_dashpot_with_a_weak_spring_is_near_ramans_minimum():
    # sixty harmonics lack 1 % of the sum of all
    (near,), _ = schelleng_min([DASHPOT.replace(bridge_w_c=1e-6)])
    (raman,), _ = schelleng_min([DASHPOT])
    assert near == pytest.approx(raman, rel=0.01)
    assert near != raman


def test_the_sum_is_the_greatest_of_all_instants():
    p = Parameters.from_mapping({"string": "violin_g", "body": "stoppani", "bridge": "rigid"})
    y, n = bridge_admittance(p), np.arange(1, HARMONICS + 1)
    t = np.linspace(0, 2 * math.pi, 20_001)
    moving = sum((-1) ** (k + 1) * (y[k - 1] * np.exp(1j * k * t)).real / k**2 for k in n.tolist())
    assert pressed(y) == pytest.approx(moving.max() + np.sum(y.real / n**2), rel=1e-4)


def test_a_mode_at_the_note_raises_the_minimum_and_one_far_away_does_not():
    string = {"string": "violin_a", "bridge": "rigid"}
    (none,), _ = schelleng_min([Parameters.from_mapping(string)])
    (at,), _ = schelleng_min([Parameters.from_mapping({**string, "body_modes": "440/30/k0.01"})])
    (far,), _ = schelleng_min([Parameters.from_mapping({**string, "body_modes": "3000/30/k0.001"})])
    assert at > 50 * none
    assert far < 3 * none


def test_the_admittance_of_a_mode_at_its_own_frequency_is_kappa_q():
    p = Parameters(bridge_r=1e6, body_modes="440/30/k0.01")
    assert bridge_admittance(p)[0] == pytest.approx(0.3, rel=1e-4)


def test_without_losses_or_with_a_bridge_of_ones_own_there_is_no_minimum():
    assert schelleng_min([Parameters(model="friedlander")]) is None
    assert bridge_admittance(Parameters(bridge_function="first=15 taps=-1")) is None
    assert schelleng_max([Parameters(model="friedlander")])[0][0] == pytest.approx(139 / 15 / 0.5)


def test_guettlers_bounds_are_those_of_his_formulas():
    p = Parameters(model="friedlander", friction="coulomb", period=320, bow_bridge=40)
    low, high = guettler_bounds(p)
    b = 1 / 8
    assert low == pytest.approx(2 * b * (1 - b) * (2.1 - 2 * math.sqrt(1.28 - 0.24)))
    assert high == pytest.approx(2 * b * (1 - b) * (1.7 - 2 * math.sqrt(0.75 * (1.12 - 0.24))) / 0.75)
    assert 0 < low < high
    assert guettler_bounds(Parameters(bow_bridge=100)) is None


@pytest.mark.parametrize(
    ("preset", "settings", "found"),
    [
        ("fig11d", (), []),  # the time course of the force moves no limit
        ("schelleng", (), ["schelleng_max", "schelleng_min"]),
        ("schelleng_sustained", (), ["schelleng_max", "schelleng_min"]),
        ("schelleng_cello", (), ["schelleng_max", "schelleng_min"]),
        ("playability", (), ["schelleng_max", "schelleng_min"]),
        ("schelleng", ("x.name=v_b", "x.first=0.5", "x.last=2"), ["schelleng_max", "schelleng_min"]),
        ("schelleng", ("model=friedlander",), ["schelleng_max"]),
        ("schelleng", ("gesture=guettler",), []),
        ("guettler", (), ["guettler_low", "guettler_high"]),
        ("guettler_cello", (), ["guettler_low", "guettler_high"]),
        ("guettler_ideal", (), ["guettler_low", "guettler_high"]),
        ("martele", (), []),
    ],
)
def test_planes_have_the_limits_that_are_curves_in_them(preset, settings, found):
    assert names(plane_of(preset, *settings)) == found


def test_a_map_without_settings_has_none():
    from dataclasses import replace

    assert limits(replace(plane_of("schelleng"), settings=())) == ()


def test_a_limit_has_the_values_of_its_formula_at_every_column():
    plane = plane_of("schelleng")
    most, least = limits(plane)
    assert most.x.tolist() == plane.x.tolist()
    assert most.y == pytest.approx(139 / (1.617 * plane.x * 0.5))
    assert (least.y < most.y).all()


def test_a_limit_may_stand_upright():
    plane = plane_of("schelleng", "x.name=f_asym", "x.scale=log", "y.name=bow_bridge", "y.scale=linear",
                     "x.first=0.2", "x.last=50", "x.count=20", "y.first=5", "y.last=36", "y.count=32")  # fmt: skip
    most, _ = limits(plane)
    assert most.y.tolist() == plane.y.tolist()
    assert most.x == pytest.approx(139 / (1.617 * plane.y * 0.5))


def test_limits_in_newton_are_those_of_the_papers_units():
    plane = plane_of("schelleng_cello", "friction=hyperbola")
    most, _ = limits(plane)
    unit = 2 * 1.059 * 0.1
    assert most.y / unit == pytest.approx(1 / (1.3 * plane.x * 0.5))


def test_bounds_are_lines_through_0_in_both_systems():
    ideal = limits(plane_of("guettler_ideal"))
    assert np.ptp([each.y / each.x for each in ideal], axis=1) == pytest.approx([0, 0], abs=1e-12)
    cello = limits(plane_of("guettler_cello"))
    low, _ = guettler_bounds(Parameters.from_mapping(
        {"string": "cello_g_b", "period": 278, "beta": 5.5 / 70, "mu_s": 0.9, "mu_d": 0.3}
    ))  # fmt: skip
    # a T/V = low F/(2 Z_0 V), with V the unit of speed
    assert cello[0].y / cello[0].x == pytest.approx(2 * 1.117 / (low * 98))


@pytest.mark.parametrize("preset", sorted(presets()))
def test_what_is_drawn_lies_within_the_map_and_its_labels_apart(preset):
    plane = plane_of(preset)
    ny, nx = plane.shape
    found = drawn(plane)
    for each in found:
        points = np.concatenate([*each.runs, [each.label]])
        assert (points >= 0).all()
        assert (points <= (nx, ny)).all()
    for one in found:
        for other in found:
            apart = np.abs(np.array(one.label) - other.label) / (nx, ny)
            assert one is other or apart[0] > 0.1 or apart[1] > 0.08


def test_a_line_is_where_the_axes_have_its_values():
    plane = plane_of("schelleng")
    most = drawn(plane)[0]
    (run,) = most.runs
    x, y = plane.axes
    expected = [(x.position(a), y.position(b)) for a, b in zip(most.limit.x, most.limit.y, strict=True)]
    for point in expected:
        assert np.abs(run - point).max(axis=1).min() < 1e-9


def test_a_limit_outside_of_the_axes_is_not_drawn_and_the_caption_says_so():
    plane = plane_of("schelleng", "y.first=5", "y.last=20")
    assert [each.limit.name for each in drawn(plane)] == ["schelleng_max"]
    said = " ".join(limit_lines(plane, 100))
    assert "Schelleng's minimum lies outside of the axes: F_min" in said
    assert "maximum lies outside" not in said


def test_a_plane_without_guettlers_bounds_says_why():
    warm = plane_of("guettler_cello", "friction=thermal")
    assert limit_lines(warm, 100) == limit_note(warm, "above")
    assert limit_note(warm, "above") == [
        "no bounds of Guettler's: they need mu_d, which friction=thermal does not have"
    ]
    assert "near the bridge" in " ".join(limit_lines(plane_of("guettler_cello", "beta=0.6"), 100))
    assert "no bounds" not in " ".join(limit_lines(plane_of("guettler_cello"), 100))
    assert limit_note(plane_of("fig11d"), "above") == []


def test_the_caption_has_formula_and_inputs():
    said = " ".join(" ".join(limit_lines(plane_of("playability"), 100)).split())
    assert "F_max = v_b/(Y beta dmu), Y = 1.617, dmu = mu_s-mu = 0.5" in said
    assert "R = 1000 Z_0, 76 modes of the body stoppani" in said
    assert max(map(len, limit_lines(plane_of("playability"), 100))) <= 100
    assert limit_lines(plane_of("fig11d"), 100) == []
    raman = plane_of("schelleng", "model=raman")
    assert "F_min = v_b Z_0^2/(2 R beta^2 dmu)" in " ".join(limit_lines(raman, 100))


def test_the_arrays_of_a_map_have_the_curves():
    arrays = limit_arrays(plane_of("guettler_ideal"))
    assert set(arrays) == {f"limit_guettler_{name}_{axis}" for name in ("low", "high") for axis in "xy"}
    assert limit_arrays(plane_of("fig11d")) == {}


def test_a_very_long_axis_has_a_curve_of_some_of_its_values(monkeypatch):
    monkeypatch.setattr(module, "MOST_POINTS", 5)
    module._limits.cache_clear()
    most = limits(plane_of("schelleng"))[0]
    module._limits.cache_clear()
    assert most.x[[0, -1]].tolist() == [5, 36]
    assert len(most.x) == 5
