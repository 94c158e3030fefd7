"""Settings in SI units are another way to give those of the paper; mixed and missing ones are refused."""

from __future__ import annotations

import numpy as np
import pytest

from bow_sim.physics.cells import cells, paper_lanes
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.instruments import HAIRS, SI, STRINGS, in_si
from bow_sim.physics.parameters import FIELDS, Parameters


def test_si_settings_give_the_papers() -> None:
    p = Parameters.from_mapping(
        {"string": "violin_g", "v_unit": 0.2, "force": 0.7, "speed": 0.1, "bow_acceleration": 3.0, "v_0": 0.05}
    )
    assert p.sample_rate == 139 * 196
    assert (p.z_0, p.stiffness_b) == (0.35, 1.6e-5)
    assert p.f_asym == pytest.approx(0.7 / (2 * 0.35 * 0.2))
    assert p.v_b == 0.5
    assert p.acceleration == pytest.approx(3.0 / (196 * 0.2))
    assert p.v_b - p.v_mid == pytest.approx(0.25)


def test_a_string_takes_the_number_of_samples_that_is_given() -> None:
    assert Parameters.from_mapping({"string": "cello_g_b", "period": 278}).sample_rate == pytest.approx(278 * 98)
    assert Parameters.from_mapping({"string": "cello_g_b", "sample_rate": 30000}).sample_rate == 30000
    assert Parameters.from_mapping({"string": "violin_g", "f_0": 220}).sample_rate == pytest.approx(139 * 220)


def test_a_bow_position_lies_between_samples_or_on_one() -> None:
    between = Parameters.from_mapping({"beta": 0.1234})
    assert (between.bow_bridge, between.bow_offset) == (17, pytest.approx(0.1526))
    assert between.beta == pytest.approx(0.1234)
    on = Parameters.from_mapping({"beta": 15 / 139})
    assert (on.bow_bridge, on.bow_offset) == (15, 0.0)
    assert on == Parameters()


def test_everything_comes_back_from_its_settings() -> None:
    p = Parameters.from_mapping(
        {"string": "cello_g_b", "v_unit": 0.1, "force": 1, "beta": 0.08, "hair": "hair_soft", "friction": "thermal"}
        | {"rosin": "rosin_hard", "body": "stoppani", "bridge": "rigid", "gesture": "guettler", "bow_acceleration": 1}
    )
    assert Parameters.from_settings(p.settings()) == p
    assert (p.mu_s, p.rosin_t_g, p.hair_k, p.bridge_r) == (1.05, 35.0, 1000.0, 1000.0)


def test_thermal_friction_has_the_coefficient_of_its_rosin_unless_another_is_given() -> None:
    given = {"string": "violin_a", "v_unit": 0.1, "friction": "thermal"}
    assert Parameters.from_mapping(given).mu_s == 1.05
    assert Parameters.from_mapping({**given, "mu_s": 0.9}).mu_s == 0.9
    assert Parameters().mu_s == 0.8


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"force": 1}, "force = 1: needs string=NAME, or z_0=NUMBER in kg/s"),
        ({"string": "violin_g", "force": 1}, "force = 1: needs v_unit=NUMBER in m/s"),
        ({"string": "violin_g", "v_unit": 0.1, "force": 1, "f_asym": 5}, "f_asym = 5.0 is given too; give one of them"),
        ({"string": "violin_g", "v_unit": 0.1, "force": -1}, "force = -1: must be a number > 0 in N"),
        ({"speed": "fast", "v_unit": 0.1}, "speed = 'fast': must be a number > 0 in m/s"),
        ({"beta": 0}, "beta = 0: must be a number > 0"),
        ({"beta": 0.1, "bow_distance": 30, "string": "violin_g"}, "beta = 0.1: bow_distance = 30 is given too"),
        ({"bow_distance": 30}, "bow_distance = 30: needs string=NAME, or string_length=NUMBER in m"),
        ({"semitone": -1}, "semitone = -1: must be a number >= 0 in semitones"),
        ({"beta": 1.2}, "beta = 1.2: must be 0.007194 ... 0.9928: the bow is on the string"),
        ({"beta": 0.001}, "beta = 0.001: must be 0.007194 ... 0.9928"),
        ({"string": "ukulele"}, "string = 'ukulele': must be one of violin_g"),
        ({"hair": "hair_soft"}, "hair_r = 3.0: needs SI units, and there is no z_0"),
        ({"hair_r": -3, "z_0": 1}, "hair_r = -3: must be a number >= 0"),
        ({"friction": "thermal"}, "friction = 'thermal': needs SI units, and there is no z_0"),
        ({"friction": "thermal", "z_0": 0.3}, "there is no v_unit: v_unit=NUMBER in m/s"),
        ({"friction": "thermal", "z_0": 0.3, "v_unit": 0.1, "dtype": "float32"}, "thermal friction needs float64"),
        ({"forse": 1}, "did you mean force?"),
    ],
)
def test_wrong_and_mixed_units_are_refused(settings: dict[str, object], text: str) -> None:
    with pytest.raises(ParameterError) as error:
        Parameters.from_mapping(settings)
    assert text in str(error.value)


def test_cells_take_values_in_si_units_each_with_its_own_string() -> None:
    p = Parameters.from_mapping({"string": "violin_g", "v_unit": 0.1})
    force, z_0 = np.array([0.1, 0.5, 1.0]), np.array([0.2, 0.3, 0.4])
    lanes = paper_lanes(p, {"force": force, "z_0": z_0})
    assert lanes["f_asym"] == pytest.approx(force / (2 * z_0 * 0.1))
    assert cells(p, {"force": force}).value("f_asym") == pytest.approx(force / (2 * 0.35 * 0.1))
    beta = cells(p, {"beta": [0.1, 0.2]})
    assert [e.bridge.first for e in beta.ends] == [12, 26]
    with pytest.raises(ParameterError, match=r"lanes.force\[1\] = -1.0: must be a number > 0"):
        cells(p, {"force": [1.0, -1.0]})
    with pytest.raises(ParameterError, match="f_asym is given too"):
        cells(p, {"force": [1.0], "f_asym": [1.0]})
    with pytest.raises(ParameterError, match="needs v_unit=NUMBER"):
        cells(Parameters(), {"speed": [1.0]})


def test_names_do_not_collide() -> None:
    assert not SI.keys() & FIELDS.keys()
    assert {quantity.same for quantity in SI.values()} <= FIELDS.keys()
    assert all(values.keys() - {"f_0"} <= FIELDS.keys() for values in (*STRINGS.values(), *HAIRS.values()))


def test_a_bow_position_in_millimetres_is_a_share_of_the_length() -> None:
    p = Parameters.from_mapping({"string": "violin_d_steel", "bow_distance": 32.5})
    assert (p.string_length, p.beta) == (0.325, pytest.approx(0.1))
    many = cells(Parameters.from_mapping({"string_length": 0.7}), {"bow_distance": [35.0, 70.0]})
    assert many.value("bow_bridge") + many.value("bow_offset") == pytest.approx([0.05 * 139, 0.1 * 139])


def test_a_note_is_higher_and_its_string_shorter_and_the_body_stays() -> None:
    open_string = Parameters.from_mapping({"string": "violin_g", "body": "wolf_83", "body_scale": 0.5})
    octave = open_string.replace(semitone=12)
    assert octave.sample_rate / octave.period == pytest.approx(2 * 196)
    assert octave.string_length == pytest.approx(0.16)
    assert (octave.period, octave.z_0) == (139, 0.35)
    notes = cells(open_string, {"semitone": [0.0, 1.0, 7.0, 12.0]})
    assert notes.value("sample_rate") == pytest.approx(139 * 196 * 2 ** (np.array([0, 1, 7, 12]) / 12))
    assert notes.value("sample_rate")[2] == open_string.replace(semitone=7).sample_rate
    both = Parameters.from_mapping({"string": "violin_g", "semitone": 12, "bow_distance": 16})
    assert both.beta == pytest.approx(0.1)
    modes = cells(Parameters.from_mapping({"string": "violin_g", "body": "signature"}), {"semitone": [0.0, 12.0]})
    assert modes.ends[0].body.modes == modes.ends[1].body.modes  # in Hz
    assert modes.ends[0].body.sample_rate * 2 == pytest.approx(modes.ends[1].body.sample_rate)


def test_values_in_si_units_come_back() -> None:
    given = {"speed": 0.15, "force": 0.7, "bow_acceleration": 2.0, "v_0": 0.05, "f_0": 200.0, "bow_distance": 25.0}
    p = Parameters.from_mapping({"string": "violin_g", "v_unit": 0.2, "gesture": "guettler", **given})
    back = in_si(vars(p))
    assert {name: back[name] for name in given} == pytest.approx(given)
    assert back["beta"] == pytest.approx(p.beta)
    assert in_si(vars(p.replace(gesture="exponential", friction="coulomb"))).keys() == {
        *("f_0", "speed", "force", "beta", "bow_distance")
    }
    assert in_si(vars(Parameters())) == {}
