"""Gestures begin and end as players make them (sections II.A, III.C)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bow_sim.physics import exact
from bow_sim.physics.cells import cells
from bow_sim.physics.gesture import force_and_speed, shapes, shapes_of_cells
from bow_sim.physics.parameters import GESTURES, Parameters

P = Parameters(f_asym=4.0, f_init_ratio=1.5, tau_f=400.0, tau_v=300.0, acceleration=0.25)


@pytest.mark.parametrize("gesture", [gesture for gesture in GESTURES if gesture != "guettler"])
def test_every_gesture_ends_at_the_asymptotic_force_and_the_final_speed(gesture):
    f, v = force_and_speed(P.replace(gesture=gesture), 40_000, 1)
    assert (f[0], v[0]) == pytest.approx((4.0, 1.0))


def test_guettlers_bow_is_accelerated_without_end():
    f, v = force_and_speed(P.replace(gesture="guettler"), 0, 40_000)
    assert v == pytest.approx(0.25 / 139 * np.arange(40_000))
    to_a_speed = force_and_speed(P.replace(gesture="accelerate_to"), 0, 40_000)
    assert np.array_equal(to_a_speed[0], f)
    assert np.array_equal(to_a_speed[1], np.minimum(v, 1.0))
    assert Parameters.from_mapping({"gesture": "constant_acceleration"}).gesture == "accelerate_to"  # its old name


def test_an_exponential_transient_falls_from_f_init_while_the_bow_moves_steadily():
    f, v = force_and_speed(P, 0, 2000)
    t = np.arange(2000)
    assert f == pytest.approx(4.0 + 2.0 * np.exp(-t / 400.0), abs=1e-12)
    assert np.all(v == 1.0)


def test_a_martele_starts_with_a_hard_bow_at_rest():
    f, v = force_and_speed(P.replace(gesture="martele"), 0, 2000)
    assert (f[0], v[0]) == (6.0, 0.0)
    assert np.all(np.diff(f) < 0) and np.all(np.diff(v) > 0)


def test_a_string_crossing_starts_with_a_moving_bow_without_force():
    f, v = force_and_speed(P.replace(gesture="string_crossing"), 0, 2000)
    assert f[0] == 0.0 and np.all(np.diff(f) > 0)
    assert np.all(v == 1.0)


def test_accelerate_to_reaches_the_final_speed_after_its_periods_and_stays():
    _, v = force_and_speed(P.replace(gesture="accelerate_to"), 0, 2000)
    assert v[:4] == pytest.approx(0.25 * np.arange(4) / 139)
    assert v[4 * 139 - 1] < 1.0 and np.all(v[4 * 139 :] == 1.0)


@given(st.sampled_from(sorted(GESTURES)), st.integers(0, 20_000), st.integers(1, 50))
def test_a_shape_does_not_depend_on_where_its_table_is_cut(gesture, start, samples):
    p = P.replace(gesture=gesture)
    whole = shapes(p, start, samples + 7)
    for part, same in zip(shapes(p, start + 3, samples), whole, strict=True):
        assert part.tolist() == same[3 : 3 + samples].tolist()


@given(st.floats(1.0, 1e5), st.integers(0, 20_000))
def test_a_decay_is_the_exponential_of_the_c_library_at_every_place(tau_f, t):
    # array exponentials may round differently with the place in the array, but the result must not depend on it
    shape, _ = shapes(P.replace(tau_f=tau_f), t, 9)
    assert shape.tolist() == [exact.exp(-(t + i) / tau_f) for i in range(9)]


def test_cells_with_time_constants_of_their_own_have_the_shapes_of_single_ones():
    p = P.replace(gesture="martele")
    tau_f, tau_v = np.array([10.0, 400.0, 3000.0]), np.array([200.0, 300.0, 1.5])
    force, speed = shapes_of_cells(cells(p, {"tau_f": tau_f, "tau_v": tau_v}), 139, 50)
    for i in range(3):
        f, v = shapes(p.replace(tau_f=tau_f[i], tau_v=tau_v[i]), 139, 50)
        assert force[i].tolist() == f.tolist() and speed[i].tolist() == v.tolist()
