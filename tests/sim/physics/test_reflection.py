"""Reflection functions have the areas, lags and losses that the paper and PHYSICS.md give them."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import MODELS, Parameters
from bow_sim.physics.reflection import ABSORBED, HIERARCHY, Reflection, cremer, delta, ends, gaussian, stiff
from bow_sim.physics.reflection_text import check, embed_files, greatest_gain, parse, read

SIDES = ("bridge", "nut", "torsion_bridge", "torsion_nut")
FS = 61160.0
FINITE = st.floats(-2, 2).filter(lambda x: abs(x) > 1e-9)


def area(r):
    """DC gain."""
    return float(r.response(np.array([1.0 + 0j]))[0].real)


def moment(r):
    """First moment of the taps, samples."""
    return sum((r.first + k) * x for k, x in enumerate(r.taps)) / sum(r.taps)


@pytest.mark.parametrize("model", MODELS)
def test_every_model_has_its_reflections_and_says_where_the_paper_has_them(model):
    assert list(HIERARCHY) == list(MODELS)
    said = HIERARCHY[model].__doc__
    assert "section" in said and f"model={model}" in said
    assert "II" in MODELS[model]


@pytest.mark.parametrize("model", MODELS)
def test_velocity_waves_come_back_inverted(model):
    e = ends(Parameters(model=model))
    p = Parameters(model=model)
    want = {"raman": (-p.bridge_gain, -p.nut_gain)}.get(model, (-1.0, -1.0))
    assert (area(e.bridge), area(e.nut)) == pytest.approx(want, abs=1e-12)
    for r in (e.torsion_bridge, e.torsion_nut):
        assert area(r) == pytest.approx(-0.95 if p.has_torsion else 0.0, abs=1e-12)


@pytest.mark.parametrize("model", MODELS)
def test_no_end_gives_back_more_than_it_gets(model):
    e = ends(Parameters(model=model))
    for side in SIDES:
        assert greatest_gain(getattr(e, side))[1] <= 1 + 1e-12, side


def test_cremers_bridge_is_the_recursion_of_physics_md():
    r_, w_c, period, lag = 25.0, 4.0, 139, 15
    k = w_c * 2 * math.pi / period * r_
    rho, p = (r_ - 1) / (r_ + 1), math.exp(-k / (r_ + 1))
    g = (1 - rho) * (1 - p)
    h = cremer(lag, r_, w_c, period).impulse(400)
    want = np.zeros(400)
    want[15] = -rho
    want[16:] -= g * p ** np.arange(400 - 16)
    assert h == pytest.approx(want, abs=1e-15)
    # its first moment adds (1 - rho)/(1 - p) = 0.48 sample
    assert -(h @ np.arange(400)) == pytest.approx(15.48, abs=0.005)


def test_the_stiff_nut_has_thirty_taps_from_lag_102_to_131():
    nut = ends(Parameters(model="stiff_cremer")).nut
    assert (len(nut.taps), nut.first, nut.last) == (30, 102, 131)
    assert math.fsum(nut.taps) == pytest.approx(-1.0, abs=1e-15)


def test_without_stiffness_the_nut_is_a_symmetric_bell_around_its_delay():
    nut = stiff(124, 139, 0.0, 0.55, 4.0)
    assert nut.first + nut.last == 2 * 124
    assert nut.taps == pytest.approx(nut.taps[::-1], abs=1e-12)
    assert min(nut.taps) == nut.taps[len(nut.taps) // 2]


def test_high_waves_arrive_first_on_a_stiff_string():
    soft, hard = stiff(124, 139, 1e-5, 0.55, 4.0), stiff(124, 139, 1e-4, 0.55, 4.0)
    assert hard.first < soft.first < 124


@given(st.floats(1.6, 500.0), st.floats(0.5, 3.0), st.floats(0.0, 1.0))
def test_a_gaussian_has_its_area_and_its_first_moment(delay, width, gain):
    r = gaussian(delay, width, gain, 8)
    assert area(r) == pytest.approx(-gain, abs=1e-12)
    assert r.first >= 1
    if gain > 0.01:
        assert moment(r) == pytest.approx(delay, abs=1e-9)


def test_torsional_reflections_have_the_lags_and_delays_of_the_appendix():
    e = ends(Parameters())
    assert (e.torsion_bridge.first, len(e.torsion_bridge.taps)) == (2, 10)
    assert (e.torsion_nut.first, len(e.torsion_nut.taps)) == (47, 10)
    assert moment(e.torsion_bridge) == pytest.approx(15 / 2.4, abs=1e-12)
    assert moment(e.torsion_nut) == pytest.approx(124 / 2.4, abs=1e-12)


def test_a_torsional_round_trip_too_short_for_the_first_lag_is_refused():
    with pytest.raises(ParameterError, match=r"torsional round trip of 0\.833 samples"):
        ends(Parameters(bow_bridge=2))


def test_a_stiffness_that_would_answer_before_it_is_asked_is_refused():
    with pytest.raises(ParameterError, match=r"stiffness_b = 0\.1"):
        ends(Parameters(stiffness_b=0.1, bow_bridge=120))


def test_admittances_add_at_the_bow_as_the_models_say():
    for model, y in {"friedlander": 1.0, "raman": 1.0, "rounded_corner": 1.0}.items():
        assert ends(Parameters(model=model)).y == y
    for model in ("torsion_absorbed", "delta_cremer", "stiff_cremer"):
        assert ends(Parameters(model=model)).y == pytest.approx(1.617)
    absorbed = ends(Parameters(model="torsion_absorbed"))
    assert absorbed.torsion_bridge is ABSORBED and absorbed.torsion_nut is ABSORBED


# A user's own


@given(
    st.integers(1, 300),
    st.lists(FINITE, min_size=1, max_size=20),
    st.floats(-0.99, 0.99),
    FINITE,
    st.integers(1, 300),
)
def test_a_reflection_function_comes_back_from_its_text_bit_for_bit(first, taps, pole, tail, tail_first):
    for r in (Reflection(tuple(taps), first), Reflection(tuple(taps), first, tail, pole, tail_first)):
        back = parse(r.text())
        assert back.impulse(700).tobytes() == r.impulse(700).tobytes()
        assert back.soonest == r.soonest and back.last == r.last


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("first=15 taps=-1.1", r"gain 1\.1 at 0 Hz: must be at most 1 at every frequency"),
        ("first=15 taps=-0.6,0.6", r"gain 1\.2 at 30580 Hz"),
        ("first=0 taps=-1", r"first = 0: must be 1 \.\.\. 65536 samples"),
        ("first=-3 taps=-1", r"first = -3: must be"),
        ("first=15 taps=-1,nan", r"taps\[1\] = 'nan': must be a finite number"),
        ("first=15 taps=-1,inf", r"taps\[1\] = 'inf'"),
        ("first=15 taps=-0.9 tail=-0.1 pole=1.0", r"pole = 1\.0: must be between -1 and 1"),
        ("first=15 taps=-0.9 tail=-0.1 pole=0.5 tail_first=0", r"tail_first = 0: must be"),
        ("first=15", r"must give at least first=LAG and taps"),
        ("taps=-1", r"must give at least first=LAG"),
        ("first=1.5 taps=-1", r"first = '1\.5': must be a whole number"),
        ("first=15 taps=-1 colour=2", r"'colour=2': must be one of"),
        ("first=15 first=16 taps=-1", r"'first=16': must be one of .*each once"),
        ("nonsense", r"'nonsense': must be one of"),
    ],
)
def test_a_reflection_function_that_no_string_can_have_is_refused(text, what):
    with pytest.raises(ParameterError, match=what) as refusal:
        Parameters(nut_function=text)
    assert str(refusal.value).startswith("nut_function")


def test_a_resonance_between_the_points_of_the_grid_is_found():
    # a sharp peak of gain 1.01 at an arbitrary frequency: two taps at opposite phases of a long comb
    taps = np.zeros(2001)
    taps[::2000] = (-0.505, -0.505)
    w, gain = greatest_gain(Reflection(tuple(taps), 7))
    assert gain == pytest.approx(1.01, abs=1e-9)
    with pytest.raises(ParameterError, match=r"gain 1\.01 at"):
        check(Reflection(tuple(taps), 7), "mine", FS)
    assert w >= 0


def test_a_models_own_functions_can_be_given_as_text_and_change_nothing():
    p = Parameters(model="stiff_cremer")
    e = ends(p)
    same = p.replace(**{f"{side}_function": getattr(e, side).text() for side in SIDES})
    assert ends(same) == e


def test_torsional_functions_are_refused_where_there_is_no_torsion():
    with pytest.raises(ParameterError, match="torsion_nut_function: must be empty: raman has no torsional reflections"):
        Parameters(model="raman", torsion_nut_function="first=40 taps=-0.9")


def test_a_function_is_read_from_json_table_or_text(tmp_path):
    want = Reflection((-0.25, 0.0, -0.5), 120)
    table = tmp_path / "nut.txt"
    table.write_text("# lag  value\n122 -0.5\n120, -0.25  # the first\n\n")
    js = tmp_path / "nut.json"
    js.write_text(json.dumps({"first": 120, "taps": [-0.25, 0, -0.5]}))
    text = tmp_path / "nut"
    text.write_text(want.text())
    for path in (table, js, text):
        assert parse(read(path)) == want
        settings = embed_files(["v_mid=0.2", f"nut_function=@{path}"])
        p = Parameters.from_settings(settings)
        assert ends(p).nut.taps == want.taps
        assert Parameters.from_settings(p.settings()) == p  # the function itself travels, not the file's name


@pytest.mark.parametrize(
    ("content", "what"),
    [
        ("1 2 3\n", "line 1: '1 2 3': must be a lag in samples and a value"),
        ("1 -0.5\n1 -0.5\n", "line 2: lag 1: must be there once only"),
        ("x -0.5\n", "line 1: lag = 'x': must be a whole number"),
        ("5 nan\n", "line 1: value = 'nan': must be a finite number"),
        ("\n", "must have lines of a lag in samples and a value, or be JSON"),
        ("1 0.1\n1000000 0.1\n", "must span at most"),
        ('{"first": 1, "taps": 3}', "taps = 3: must be a list"),
        ('{"first": 1, "tap": [3]}', "tap: unknown key"),
        ('{"first": 1, ', "must be JSON"),
    ],
)
def test_a_file_that_is_no_reflection_function_is_refused_by_name_and_line(tmp_path, content, what):
    path = tmp_path / "mine.txt"
    path.write_text(content)
    with pytest.raises(ParameterError, match=what) as refusal:
        read(path)
    assert str(path) in str(refusal.value)
    with pytest.raises(ParameterError, match="cannot be read"):
        read(tmp_path / "absent")


def test_delta_is_one_tap():
    assert delta(124) == Reflection((-1.0,), 124)
