"""What the captions of a map say."""

from dataclasses import replace

import pytest
from example_maps import map_file
from planes import plane_of

from bow_sweep.maps.held_fixed import caption, cell_name, cell_names, common_in_si, held_fixed
from bow_sweep.maps.plane import Plane
from bow_sweep.plan.presets import presets
from bow_sweep.plan.sweep import Sweep


def lines(plane: Plane) -> list[str]:
    return [held.line() for held in held_fixed(plane)]


def test_the_papers_map_holds_all_but_the_force_fixed():
    expected = [
        "tau_f = 400 samples",
        "v_mid = 0.2 v_b",
        "beta = 15/139",
        "mu_s = 0.8",
        "mu_d = 0.3",
        "v_b = 1",
        "Y_T = 2",
    ]
    assert lines(plane_of("fig11d")) == expected


def test_a_force_that_does_not_change_has_no_time_constant():
    said = lines(plane_of("schelleng"))
    assert "f_init / f_asym = 1" in said
    assert not [line for line in said if line.startswith(("tau_f", "beta", "f_asym ="))]


@pytest.mark.parametrize(
    ("preset", "wanted"),
    [
        ("guettler", {"f_init / f_asym = 1"}),
        ("martele", {"tau_f = 400 samples", "tau_v = 400 samples"}),
        ("string_crossing", set()),
    ],
)
def test_the_settings_of_each_gesture_are_named(preset, wanted):
    plane = plane_of(preset)
    assert wanted <= set(lines(plane))
    assert plane.values["gesture"].replace("_", " ") in caption(plane, 100)[0]


def test_what_differs_from_its_default_is_named_with_its_unit():
    said = lines(plane_of("fig11d", "bridge_r=63.5", "x.name=v_mid", "x.first=-1", "x.last=0.5", "x.scale=linear"))
    assert "bridge_r = 63.5 1/y_t" in said
    assert "f_asym = 5.5 2 Z_0 v_b" in said
    assert not [line for line in said if line.startswith("v_mid")]


def test_an_axis_in_si_units_takes_the_place_of_the_papers_parameter():
    plane = plane_of("fig11d", "string=violin_a", "v_unit=0.1", "x.name=force", "x.first=0.2", "x.last=4")
    assert not [line for line in lines(plane) if line.startswith("f_asym")]
    assert cell_names(plane)[0].startswith("force 0.2 N (f_asym 4.926 2 Z_0 v_b), ")


@pytest.mark.parametrize("preset", sorted(presets()))
def test_no_axis_is_held_fixed_and_no_line_is_too_long(preset):
    plane = plane_of(preset)
    assert not {plane.x_name, plane.y_name} & {held.name for held in held_fixed(plane)}
    assert max(map(len, caption(plane, 100))) <= 100


def test_a_cell_is_named_by_its_parameters_with_units():
    plane = plane_of("fig11d")
    names = cell_names(plane)
    assert names[0] == "f_asym 0.5 2 Z_0 v_b, f_init/f_asym 0"
    assert names[-1] == "f_asym 20 2 Z_0 v_b, f_init/f_asym 2"
    assert [cell_name(plane, cell) for cell in range(len(names))] == names


def test_a_map_without_settings_has_a_caption_of_its_length():
    assert caption(replace(map_file(), settings=()), 100) == ["Map of the bowed string  \u00b7  100 periods"]


@pytest.mark.parametrize(
    ("preset", "words"),
    [
        ("schelleng_cello", "beta 0.02 (14 mm), force 0.08 N (f_asym 0.3777 2 Z_0 v_b)"),
        ("guettler_cello", "bow_acceleration 0.15 m/s^2 (acceleration 0.01531 v_b/period), force 0.1 N (f_asym 0.4476"),
        ("playability", "semitone 0 semitones (196 Hz), force 0.01 N"),
    ],
)
def test_a_cell_of_a_real_string_is_named_in_both_systems_of_units(preset, words):
    assert cell_names(plane_of(preset))[0].startswith(words)


def test_what_is_held_fixed_stands_in_both_systems_of_units():
    said = lines(plane_of("schelleng_cello"))
    assert "v_b = 1 (0.1 m/s)" in said
    assert not [line for line in said if line.startswith(("mu_d", "v_mid"))]  # warm rosin has neither
    cello = lines(plane_of("guettler_cello"))
    assert "beta = 21.8429/278 (55 mm)" in cello
    assert "v_mid = 0 v_b (0.1 m/s)" in cello


def test_a_value_that_differs_from_cell_to_cell_in_the_other_system_is_left_out():
    plane = plane_of("schelleng_cello", "x.name=z_0", "x.first=0.5", "x.last=2")
    assert cell_names(plane)[0] == "z_0 0.5 kg/s, force 0.08 N"
    assert "v_b = 1 (0.1 m/s)" not in lines(plane)


def test_a_sustained_force_takes_the_place_of_the_initial_one():
    said = lines(plane_of("schelleng_sustained"))
    assert said[:2] == ["sustained = 0.6 F_max", "tau_f = 1500 samples"]
    assert not [line for line in said if line.startswith("f_init")]


def test_a_report_has_what_all_cells_share_in_si_units():
    sweep = Sweep.from_spec("schelleng_cello")
    shared = common_in_si(vars(sweep.parameters), ("beta", "force"))
    assert shared["speed"] == {"value": pytest.approx(0.1), "unit": "m/s"}
    assert shared["f_0"]["value"] == pytest.approx(98)
    assert set(shared) == {"f_0", "speed"}
    notes = Sweep.from_spec("playability")
    assert set(common_in_si(vars(notes.parameters), ("semitone", "force"))) == {"speed", "v_0", "beta"}
    assert "beta = 15/139" in lines(plane_of("playability"))  # but each note has its own distance in mm
    assert common_in_si(vars(Sweep.from_spec("fig11d").parameters), ("f_asym", "f_init_ratio")) == {}
