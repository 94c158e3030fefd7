"""The string without the bow: mode frequencies, Q factors and impulse responses (section III.A, Figs 2-4)."""

from __future__ import annotations

import numpy as np
import pytest

from bow_sim.physics.modes import (
    cremer_q,
    gaussian_q,
    impulse_response,
    modes,
    torsional_modes,
    torsional_response,
    transverse_modes,
    transverse_response,
)
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection import delta, ends

DELTA, STIFF = Parameters(model="delta_cremer"), Parameters(model="stiff_cremer")
PAPER_TORSIONAL_Q = (25, 43, 45, 45, 40, 37, 33, 29)


def by_equation_5(one, other, admittance, samples):
    """The series itself, convolution by convolution, until every term begins after the window."""
    h_1, h_2 = one.impulse(samples), other.impulse(samples)
    g = np.zeros(samples)
    g[0] = 1.0

    def after(term, h):
        return np.convolve(term, h)[:samples]

    a, b = h_1, h_2  # ... h_1*h_2*h_1 and h_2*h_1*h_2 ... , by their last factor
    for turn in range(samples):
        if not (np.any(a) or np.any(b)):
            break
        g += a + b
        a, b = after(a, h_2 if turn % 2 == 0 else h_1), after(b, h_1 if turn % 2 == 0 else h_2)
    return g * admittance / 2


@pytest.mark.parametrize("p", [DELTA, STIFF], ids=lambda p: p.model)
def test_the_impulse_response_is_the_series_of_equation_5(p):
    e, samples = ends(p), 1200
    assert transverse_response(p, samples) == pytest.approx(by_equation_5(e.bridge, e.nut, 2.0, samples), abs=1e-12)
    torsion = by_equation_5(e.torsion_bridge, e.torsion_nut, e.y_r, samples)
    assert torsional_response(p, samples) == pytest.approx(torsion, abs=1e-12)


def test_an_ideal_string_rings_for_ever_in_exact_harmonics():
    m = modes(delta(15), delta(124), 61160.0, 60)
    assert m.number.tolist() == list(range(1, 61))
    assert m.frequency == pytest.approx(440.0 * m.number, rel=1e-12)
    assert np.all(np.isinf(m.q))
    g = impulse_response(delta(15), delta(124), 2.0, 3 * 139)
    assert np.array_equal(g[139:278], g[278:])  # the impulse returns every period


def test_the_discrete_loop_of_the_delta_cremer_model_has_the_q_of_physics_md():
    m = transverse_modes(DELTA)
    assert m.q[[0, 3, 6, 12]] == pytest.approx([617, 288, 333, 510], abs=0.5)
    assert cremer_q(m.number, DELTA)[[0, 3, 6, 12]] == pytest.approx([667, 314, 364, 558], rel=2e-3)


def test_mode_frequencies_of_delta_cremer_are_flat_and_those_of_stiff_cremer_rise_with_n_squared():
    delta_f, stiff_f = (transverse_modes(p) for p in (DELTA, STIFF))
    flat = delta_f.frequency / delta_f.number
    assert flat[[0, 29]] == pytest.approx([438.57, 439.98], abs=0.01)
    assert np.ptp(flat) / 440 < 0.0033
    excess = stiff_f.frequency / stiff_f.number - flat
    assert np.all(np.diff(excess) > 0)
    # f_n = n f_1 sqrt(1 + B n**2) on 124/139 of the string
    want = 440 * (np.sqrt(1 + STIFF.stiffness_b * stiff_f.number**2) - 1) * 124 / 139
    assert excess == pytest.approx(want, rel=0.05, abs=0.02)


def test_low_modes_ring_alike_in_both_models_and_high_ones_less_on_a_stiff_string():
    delta_q, stiff_q = transverse_modes(DELTA).q, transverse_modes(STIFF).q
    assert stiff_q[:6] == pytest.approx(delta_q[:6], rel=0.05)
    assert np.all(stiff_q[12:] < 0.8 * delta_q[12:])
    assert np.all((stiff_q > 50) & (stiff_q < 1000))


def test_torsional_modes_are_those_of_the_paper():
    m = torsional_modes(DELTA)
    assert m.frequency == pytest.approx(1056.0 * m.number, rel=0.005)
    assert m.q == pytest.approx(PAPER_TORSIONAL_Q, rel=0.12)
    assert m.q == pytest.approx([27.5, 42.2, 45.7, 43.8, 40.2, 36.4, 32.9, 29.9], rel=0.02)
    assert m.q == pytest.approx(gaussian_q(m.number, DELTA), rel=0.02)


def test_a_users_reflection_function_has_modes_like_any_other():
    p = Parameters(model="friedlander", nut_function="first=124 taps=-0.9")
    m = transverse_modes(p, 5)
    assert m.frequency == pytest.approx(440.0 * m.number, rel=1e-9)
    assert m.q == pytest.approx(np.pi * m.number / -np.log(0.9), rel=1e-9)


def test_a_mode_found_as_a_root_is_one_that_decays_at_its_q():
    m = torsional_modes(DELTA, 1)
    g = torsional_response(DELTA, 2500)
    w = 2 * np.pi * m.frequency[0] / DELTA.sample_rate
    t = np.arange(len(g))
    # projected on the first mode, period by period of it: the higher ones have decayed after a thousand samples
    envelope = [abs(np.sum((g * np.exp(-1j * w * t))[a : a + 579])) for a in (1000, 1579)]
    assert np.log(envelope[0] / envelope[1]) == pytest.approx(w * 579 / (2 * m.q[0]), rel=0.02)
