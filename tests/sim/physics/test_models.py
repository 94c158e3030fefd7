"""Each model of section II.B has the property that the paper claims for it."""

from __future__ import annotations

import numpy as np
import pytest

from bow_sim.kernel.block import transient
from bow_sim.physics.friction import sliding_coefficient
from bow_sim.physics.modes import torsional_modes, transverse_modes
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection import ends

N = 139


def divergence(p, periods=60):
    """Greatest difference in each period of motions that begin 1e-10 apart, and whether they slip at the same times."""
    p = p.replace(periods=periods)
    one, other = transient(p), transient(p.replace(f_init_ratio=p.f_init_ratio + 1e-10))
    alike = np.array_equal(one["slipping"], other["slipping"])
    return np.abs(one["v"] - other["v"]).reshape(periods, N).max(axis=1), alike


def flyback_width(p):
    """Samples that the flyback of a Helmholtz motion takes: the sawtooth's height over its greatest slope."""
    waves = transient(p)
    slips = np.flatnonzero(np.diff(waves["slipping"][-10 * N :].astype(int)) > 0)
    assert len(slips) in {9, 10, 11} and np.ptp(np.diff(slips)) < 5, "one slip a period"
    x = waves["bridge_force"][-10 * N :]
    return float(np.ptp(x) / np.max(np.abs(np.diff(x))))


@pytest.mark.parametrize("f_asym", [0.6, 1.2])
def test_motions_of_friedlanders_string_are_unstable_where_the_friction_curve_falls(f_asym):
    growing, alike = divergence(Parameters(model="friedlander", f_asym=f_asym))
    assert alike  # they slip at the same samples: the difference grows by the slope of the friction curve
    assert growing[-1] > 1e3 * growing[2]


@pytest.mark.parametrize("f_asym", [0.6, 1.2])
def test_friedlanders_string_is_not_unstable_where_the_friction_curve_is_flat(f_asym):
    flat, _ = divergence(Parameters(model="friedlander", f_asym=f_asym, v_mid=-1e5))
    assert flat[-1] < 10 * flat[2]


@pytest.mark.parametrize("f_asym", [0.6, 1.2])
def test_ramans_loss_keeps_a_small_perturbation_small(f_asym):
    shrinking, alike = divergence(Parameters(model="raman", f_asym=f_asym))
    assert alike
    assert shrinking[-1] <= shrinking[2]


def test_waveforms_of_ramans_string_are_piecewise_constant():
    # with the bow at 1/7 every wave begins and ends at multiples of 20 samples
    p = Parameters(model="raman", period=140, bow_bridge=20, f_asym=1.5, periods=20)
    waves = transient(p)
    for name in ("v", "friction_force", "bridge_force"):
        steps = waves[name].reshape(-1, 20)
        assert np.all(steps == steps[:, :1]), name
        assert len(np.unique(steps[:, 0].round(9))) > 20, name  # and the motion is not trivial
    rounded = transient(p.replace(model="rounded_corner"))["v"].reshape(-1, 20)
    assert not np.all(rounded == rounded[:, :1])


def test_rounded_corners_are_sharper_at_higher_force():
    p = Parameters(model="rounded_corner", v_mid=-2.0, periods=200)
    widths = [flyback_width(p.replace(f_asym=f)) for f in (1.0, 2.0, 4.0, 8.0)]
    assert np.all(np.diff(widths) < -0.5)


def test_corners_of_the_stiff_string_are_sharper_at_higher_force_too():
    p = Parameters(model="stiff_cremer", v_mid=0.2, periods=200)
    widths = [flyback_width(p.replace(f_asym=f)) for f in (1.5, 3.0, 6.0, 10.0)]
    assert np.all(np.diff(widths) < -0.3)


def test_absorbed_torsion_is_a_linear_shear_of_the_friction_curve():
    p = Parameters(model="torsion_absorbed", f_asym=1.2, v_mid=-2.0, periods=40)
    w = transient(p)
    f, v_c, slips = w["friction_force"], w["v_centre"], w["slipping"]
    y_r = ends(p).y_r
    # torsion enters only by v = v_c + Y_R/2 f: the string sticks and slips on the curve drawn over v_c + Y_R/2 f
    v = v_c + y_r / 2 * f
    assert w["v"] == pytest.approx(v, abs=1e-12)
    assert slips.any() and not slips.all()
    assert v[~slips] == pytest.approx(1.0, abs=1e-12)
    assert f[slips] == pytest.approx(1.2 * sliding_coefficient(1.0 - v[slips], 0.8, 0.3, 3.0), abs=1e-12)
    # and only transverse waves return
    assert w["v_h"] == pytest.approx(w["v_centre"] - f, abs=1e-12)


def test_torsion_is_the_dominant_loss():
    for model in ("delta_cremer", "stiff_cremer"):
        p = Parameters(model=model)
        assert transverse_modes(p, 8).q.min() > 5 * torsional_modes(p, 8).q.max()
        assert torsional_modes(p, 8).q.max() < 50


def test_reflected_torsion_makes_the_surface_move_differently_from_the_centre():
    w = transient(Parameters(model="delta_cremer", v_mid=0.7, f_asym=5.5))
    late = slice(-3 * N, None)  # Fig 6 (a) and (b)
    assert np.max(np.abs(w["v"] - w["v_centre"])[late]) > 0.2
    sticking = ~w["slipping"][late]
    assert np.all(w["v"][late][sticking] == 1.0)
    assert np.ptp(w["v_centre"][late][sticking]) > 0.1


def test_the_bridge_force_of_helmholtz_motion_is_a_sawtooth_with_one_flyback_a_period():
    x = transient(Parameters(model="delta_cremer", v_mid=0.7, f_asym=5.5))["bridge_force"][-6 * N :]
    y = x[15:] - x[:-15]  # slope averaged over one Schelleng ripple
    corner = np.abs(y) > 0.4 * N / 15
    onsets = np.flatnonzero(corner[1:] & ~corner[:-1])
    assert np.diff(onsets) == pytest.approx(N, abs=1)
    assert len(onsets) in {5, 6}
