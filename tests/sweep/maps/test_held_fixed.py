"""What the captions of a map say."""

from dataclasses import replace

import numpy as np
import pytest
from example_maps import map_file

from bow_sweep.maps.held_fixed import caption, cell_name, cell_names, held_fixed
from bow_sweep.maps.plane import Plane
from bow_sweep.plan.presets import presets
from bow_sweep.plan.sweep import Sweep


def plane_of(preset: str, *settings: str) -> Plane:
    sweep = Sweep.from_spec(preset, settings)
    shape = (sweep.y.count, sweep.x.count)
    return Plane(
        run_id="",
        sweep_id="",
        x_name=sweep.x.name,
        y_name=sweep.y.name,
        x=sweep.x.values(),
        y=sweep.y.values(),
        transient_periods=np.zeros(shape, np.float32),
        regime=np.zeros(shape, np.uint8),
        regime_names=("no_oscillation",),
        settings=sweep.settings(),
        preset=preset,
    )


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
    assert "f_asym = 5.5 v_b/Y_T" in said
    assert not [line for line in said if line.startswith("v_mid")]


def test_an_axis_in_si_units_takes_the_place_of_the_papers_parameter():
    plane = plane_of("fig11d", "string=violin_a", "v_unit=0.1", "x.name=force", "x.first=0.2", "x.last=4")
    assert not [line for line in lines(plane) if line.startswith("f_asym")]
    assert cell_names(plane)[0].startswith("force 0.2 N (f_asym 4.926 v_b/Y_T), ")


@pytest.mark.parametrize("preset", sorted(presets()))
def test_no_axis_is_held_fixed_and_no_line_is_too_long(preset):
    plane = plane_of(preset)
    assert not {plane.x_name, plane.y_name} & {held.name for held in held_fixed(plane)}
    assert max(map(len, caption(plane, 100))) <= 100


def test_a_cell_is_named_by_its_parameters_with_units():
    plane = plane_of("fig11d")
    names = cell_names(plane)
    assert names[0] == "f_asym 0.5 v_b/Y_T, f_init/f_asym 0"
    assert names[-1] == "f_asym 20 v_b/Y_T, f_init/f_asym 2"
    assert [cell_name(plane, cell) for cell in range(len(names))] == names


def test_a_map_without_settings_has_a_caption_of_its_length():
    assert caption(replace(map_file(), settings=()), 100) == ["Map of the bowed string  \u00b7  100 periods"]
