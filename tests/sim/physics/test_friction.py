"""String and friction curve meet in one point, chosen by the paper's hysteresis rule (sections II.A, III.C)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from bow_sim.physics.friction import (
    LAWS,
    Thermal,
    ambiguous_force,
    coulomb,
    hyperbola,
    sliding_coefficient,
    slipping_limit,
    sticking_limit,
    thermal,
)
from bow_sim.physics.parameters import FRICTIONS

MU_S, MU_D, Y = 0.8, 0.3, 1.617
A = st.floats(0.01, 5.0)  # v_b - v_mid
FORCE = st.floats(0.0, 25.0)
INCIDENT = st.floats(-30.0, 30.0)  # v_h, v_b = 1


def step(a, f_b, v_h, slipping, v_b=1.0):
    """One step: slip speed s, friction force f, state."""
    d = v_b - v_h
    s, slips = hyperbola(a, Y * MU_S, Y * MU_D, d, f_b, slipping)
    return float(s), (d - float(s)) / Y, bool(slips)


def test_every_law_that_can_be_set_is_there():
    assert LAWS.keys() == FRICTIONS.keys()


@given(A, FORCE, INCIDENT, st.booleans())
def test_the_solution_lies_on_the_strings_line_and_on_the_friction_curve(a, f_b, v_h, slipping):
    s, f, slips = step(a, f_b, v_h, slipping)
    v = 1.0 - s
    assert v == pytest.approx(v_h + Y * f, abs=1e-9)
    if slips:
        assert s * math.copysign(1.0, 1.0 - v_h) >= 0  # the force pulls the string towards the bow's speed
        curve = f_b * float(sliding_coefficient(np.float64(abs(s)), MU_S, MU_D, a))
        assert abs(f) == pytest.approx(curve, rel=1e-6, abs=1e-9)
    else:
        assert s == 0.0
        assert abs(f) <= MU_S * f_b * (1 + 1e-12) + 1e-12


@given(A, FORCE, INCIDENT)
def test_sticking_goes_on_until_the_limit_of_friction(a, f_b, v_h):
    _, _, slips = step(a, f_b, v_h, slipping=False)
    assert slips == (abs(1.0 - v_h) > f_b * (Y * MU_S))


@given(A, FORCE, INCIDENT)
def test_slipping_goes_on_as_long_as_the_line_meets_the_curve(a, f_b, v_h):
    d = 1.0 - v_h
    x, s_max, slide = abs(d), Y * f_b * MU_S, Y * f_b * MU_D
    # the greatest of s**2 + s (a + A - x) + a (S - x) = 0, by numpy's own solver
    roots = np.roots([1.0, a + slide - x, a * (s_max - x)])
    real = roots[np.abs(roots.imag) < 1e-12].real
    assume(abs((a + slide - x) ** 2 - 4 * a * (s_max - x)) > 1e-6 and abs(x - s_max) > 1e-6)
    _, _, slips = step(a, f_b, v_h, slipping=True)
    assert slips == bool(np.any(real > 0))


@given(A, FORCE, INCIDENT, st.booleans())
def test_forward_slip_is_the_mirror_image(a, f_b, v_h, slipping):
    s, f, slips = step(a, f_b, v_h, slipping)
    s_back, f_back, slips_back = step(a, f_b, 2.0 - v_h, slipping)
    assert slips == slips_back or math.isclose(abs(1 - v_h), Y * f_b * MU_S, rel_tol=1e-12)
    if slips == slips_back:
        assert s_back == pytest.approx(-s, abs=1e-12)
        assert f_back == pytest.approx(-f, abs=1e-12)


@given(A, st.floats(0.0, 0.999), INCIDENT)
def test_without_an_ambiguous_region_there_is_no_hysteresis(a, share, v_h):
    f_b = share * ambiguous_force(Y, MU_S, MU_D, a)
    assume(abs(abs(1.0 - v_h) - Y * f_b * MU_S) > 1e-9)
    assert step(a, f_b, v_h, slipping=True) == step(a, f_b, v_h, slipping=False)


@given(A, st.floats(1.05, 20.0), st.floats(0.01, 0.99))
def test_in_the_ambiguous_region_the_state_stays_as_it_is(a, times, where):
    f_b = times * ambiguous_force(Y, MU_S, MU_D, a)
    v_1 = sticking_limit(f_b, Y, MU_S, 1.0)
    v_2 = slipping_limit(f_b, Y, MU_S, MU_D, a, 1.0)
    assert v_1 < v_2
    v_h = v_1 + where * (v_2 - v_1)
    assert step(a, f_b, v_h, slipping=True)[2]
    assert not step(a, f_b, v_h, slipping=False)[2]
    assert not step(a, f_b, v_2 + 1e-6, slipping=True)[2]
    assert step(a, f_b, v_1 - 1e-6, slipping=False)[2]


@given(A, FORCE, INCIDENT, st.booleans())
def test_the_force_never_jumps_but_where_the_rule_says(a, f_b, v_h, slipping):
    small = 1e-9
    _, f, slips = step(a, f_b, v_h, slipping)
    _, f_near, slips_near = step(a, f_b, v_h + small, slipping)
    if slips == slips_near:
        assert abs(f - f_near) < 1e-3  # at the end of slipping the slope is infinite, like that of a square root
    else:
        side = math.copysign(1.0, 1.0 - v_h)
        mirrored = 1.0 - side * (1.0 - v_h)
        border = slipping_limit(f_b, Y, MU_S, MU_D, a, 1.0) if slipping else sticking_limit(f_b, Y, MU_S, 1.0)
        assert abs(mirrored - border) < 10 * small


def test_the_friction_curve_passes_through_its_three_points():
    for v_mid in (0.9, 0.2, -2.0):
        a = 1.0 - v_mid
        mu = sliding_coefficient(np.array([0.0, a, 1e9]), MU_S, MU_D, a)
        assert mu == pytest.approx([0.8, 0.55, 0.3], abs=1e-6)


@pytest.mark.parametrize(("v_mid", "force"), [(0.9, 0.124), (0.2, 0.99), (-2.0, 3.71)])
def test_hysteresis_begins_at_the_forces_of_the_three_curves(v_mid, force):
    assert ambiguous_force(Y, MU_S, MU_D, 1.0 - v_mid) == pytest.approx(force, rel=3e-3)


def test_no_force_no_friction():
    s, f, slips = step(0.8, 0.0, 0.25, slipping=False)
    assert (s, f, slips) == (0.75, 0.0, True)


def test_one_formula_serves_numbers_and_arrays():
    d = np.linspace(-3, 3, 101)
    s, slips = hyperbola(0.8, Y * MU_S, Y * MU_D, d, 1.5, np.zeros(101, bool))
    one = [hyperbola(0.8, Y * MU_S, Y * MU_D, float(x), 1.5, slipping=False) for x in d]
    assert s.tolist() == [float(x) for x, _ in one]
    assert slips.tolist() == [bool(x) for _, x in one]


@given(FORCE, INCIDENT)
def test_coulomb_sticks_whenever_it_can(f_b, v_h):
    d = 1.0 - v_h
    s, slips = coulomb(Y * MU_S, Y * MU_D, d, f_b)
    assert slips == (abs(d) > f_b * (Y * MU_S))
    assert s == (0.0 if not slips else pytest.approx(math.copysign(abs(d) - f_b * Y * MU_D, d)))


def rosin(**changes):
    """The thermal law in numbers: a string of 0.2 kg/s at 61160 Hz, speeds in m/s."""
    values = {"y": Y, "mu_s": 1.05, "share": 0.4, "t_g": 25.0, "speed": 1.0, "load": 2 * 0.2 / 0.01}
    values |= {"step": 1 / (61160 * 1e-6), "flow": 0.22, "rest": 1e-4, "temperature": 0.0}
    return Thermal(**(values | changes))


@pytest.mark.parametrize(
    ("speed", "mu", "temperature"), [(0.01, 1.030, 4.5), (0.1, 0.916, 13.0), (0.5, 0.749, 23.9), (1.0, 0.673, 30.5)]
)
def test_steady_sliding_under_one_newton_has_the_published_temperature(speed, mu, temperature):
    f_b = 1 / (2 * 0.2)  # 1 N
    law, now = rosin(), 0.0
    for _ in range(20_000):
        q = (now / 25.0) ** 2
        now_mu = 1.05 * (1 + 0.4 * q) / (1 + q)
        s, slips, now = thermal(law._replace(temperature=now), speed + Y * f_b * now_mu, f_b)
    assert slips
    assert s == pytest.approx(speed, rel=1e-3)
    assert now_mu == pytest.approx(mu, abs=1e-3)
    assert now == pytest.approx(temperature, abs=0.1)


@given(FORCE, INCIDENT, st.floats(0, 100))
def test_thermal_friction_has_one_solution_that_is_on_the_strings_line(f_b, v_h, temperature):
    assume(f_b == 0 or f_b > 1e-9)  # smaller ones overflow on the way, and warn
    d = 1.0 - v_h
    s, slips, after = thermal(rosin(temperature=temperature), d, f_b)
    assert math.isfinite(after) and after >= 0
    assert slips == (s != 0)
    assert s * d >= 0
    assert abs((d - s) / Y) <= 1.05 * f_b * (1 + 1e-9) + 1e-12
    assert abs(s) <= abs(d)


def test_without_a_bow_the_contact_cools():
    s, slips, after = thermal(rosin(temperature=20.0), 0.7, 0.0)
    assert (s, bool(slips)) == (0.7, True)
    assert 19.9 < after < 20.0


def test_laws_are_the_same_for_numbers_and_arrays():
    d, f_b = np.linspace(-3, 3, 41), np.linspace(0, 5, 41)
    together = thermal(rosin(), d, f_b)
    alone = [thermal(rosin(), x, y) for x, y in zip(d.tolist(), f_b.tolist(), strict=True)]
    for k in range(3):
        assert np.array_equal(together[k], [one[k] for one in alone])
