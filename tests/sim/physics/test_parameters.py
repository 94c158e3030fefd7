"""Parameters are data: their text reads back to the same ones; an error names a parameter that is wrong."""

from __future__ import annotations

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bow_sim.physics.errors import ParameterError
from bow_sim.physics.instruments import BRIDGES
from bow_sim.physics.parameters import FIELDS, MODELS, SWEEPABLE, TYPES, Parameters, coerce


def _values(name):
    """Right values of a field."""
    meta = FIELDS[name].metadata
    if "choices" in meta:
        return st.sampled_from(meta["choices"])
    limits = meta["range"]
    if TYPES[name] is int:
        return st.integers(math.ceil(limits.low), math.floor(limits.high))
    return st.floats(limits.low, limits.high, exclude_min=limits.low_open, exclude_max=limits.high_open)


FREE = sorted(set(FIELDS) - {"periods", "period", "bow_bridge", "mu_s", "mu_d", "v_mid", "v_b"})
FREE = [name for name in FREE if not name.endswith("_function")]
NEEDS_OTHERS = ("friction", "friction_curve", "body", "body_modes", "body_changes", "hair_r", "sustained")
FREE = [name for name in FREE if name not in NEEDS_OTHERS]


@given(st.fixed_dictionaries({}, optional={name: _values(name) for name in FREE}))
def test_parameters_come_back_from_their_settings_bit_for_bit(values):
    p = Parameters(**values)
    back = Parameters.from_settings(p.settings())
    assert back == p
    assert back.settings() == p.settings()
    assert list(p.settings()) == sorted(p.settings())


def test_defaults_are_those_of_the_paper():
    p = Parameters()
    assert (p.period, p.bow_bridge, p.y_t, p.torsion_admittance) == (139, 15, 2.0, 0.617)
    assert (p.torsion_speed, p.torsion_width, p.torsion_gain) == (2.4, 1.4, 0.95)
    assert (p.mu_s, p.mu_d, p.v_b, p.tau_f) == (0.8, 0.3, 1.0, 400.0)
    assert p.beta == 15 / 139
    assert (p.chunk_samples, p.chunks, p.samples) == (695, 20, 13_900)


@pytest.mark.parametrize("name", sorted(FIELDS))
def test_every_parameter_says_what_it_is_and_where_it_comes_from(name):
    meta = FIELDS[name].metadata
    assert meta["doc"] and meta["source"]
    assert coerce(name, FIELDS[name].default) == FIELDS[name].default


def test_a_default_of_every_number_lies_in_its_range():
    for name, field in FIELDS.items():
        if "range" in field.metadata:
            assert field.metadata["range"].holds(field.default), name


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("f_asym", 0),
        ("f_asym", -1.0),
        ("f_asym", math.nan),
        ("f_asym", math.inf),
        ("f_asym", "many"),
        ("f_asym", True),
        ("f_asym", None),
        ("f_asym", [1.0]),
        ("tau_f", 0.0),
        ("v_mid", 1.0),
        ("v_mid", 2),
        ("mu_d", 0.8),
        ("period", 139.5),
        ("period", 10**9),
        ("bow_bridge", 139),
        ("bow_bridge", 0),
        ("periods", 0),
        ("periods", 12),
        ("model", "cremer"),
        ("model", 3),
        ("gesture", "pizzicato"),
        ("dtype", "float16"),
        ("bridge_r", 1.0),
        ("sample_rate", math.nan),
        ("nut_function", "@taps.txt"),
        ("nut_function", 5),
        ("bridge", "oak"),
    ],
)
def test_what_cannot_be_is_refused_with_its_name_and_value(name, value):
    with pytest.raises(ParameterError) as refusal:
        Parameters.from_mapping({name: value}, "fig11d.yaml: ")
    message = str(refusal.value)
    assert message.startswith(f"fig11d.yaml: {name} = ")
    assert str(value).strip("'") in message
    assert "must be" in message


@given(st.floats(allow_nan=False) | st.integers(), st.sampled_from(sorted(SWEEPABLE)))
def test_a_number_is_taken_exactly_if_its_range_holds_it(value, name):
    limits, whole = FIELDS[name].metadata["range"], TYPES[name] is int
    if limits.holds(value) and (not whole or value == math.floor(value)):
        assert coerce(name, value) == value
    else:
        with pytest.raises(ParameterError):
            coerce(name, value)


def test_an_unknown_name_is_refused_and_a_near_one_suggested():
    with pytest.raises(ParameterError, match=r"sweep: f_asim = 1: unknown parameter; did you mean f_asym\?"):
        Parameters.from_mapping({"f_asim": 1}, "sweep: ")
    with pytest.raises(ParameterError, match=r"the parameters are .*v_mid"):
        Parameters().replace(qqqqqq=1)


def test_a_setting_without_a_value_is_refused():
    with pytest.raises(ParameterError, match="'v_mid': must have the form name=value"):
        Parameters.from_settings(["v_mid"])


def test_yaml_numbers_that_arrive_as_text_are_numbers():
    assert Parameters.from_mapping({"stiffness_b": "1e-5", "periods": "40"}) == Parameters(stiffness_b=1e-5, periods=40)


@pytest.mark.parametrize("name", BRIDGES)
def test_a_named_bridge_sets_spring_and_dashpot_and_yields_to_explicit_values(name):
    p = Parameters.from_settings([f"bridge={name}"])
    assert {"bridge_r": p.bridge_r, "bridge_w_c": p.bridge_w_c} == BRIDGES[name]
    assert Parameters.from_settings(["bridge_r=30", f"bridge={name}"]).bridge_r == 30
    assert Parameters.from_settings(p.settings()) == p


def test_a_changed_copy_is_checked_like_a_new_one():
    p = Parameters(v_mid=0.5)
    assert p.replace(v_mid=-2).v_mid == -2.0
    with pytest.raises(ParameterError, match=r"v_mid = 0\.5: must be less than v_b = 0\.4"):
        p.replace(v_b=0.4)
    assert dataclasses.replace(p, model="raman").model == "raman"
    assert set(MODELS) >= {"friedlander", "raman", "rounded_corner", "torsion_absorbed", "delta_cremer", "stiff_cremer"}
