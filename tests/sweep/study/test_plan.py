"""A study: its maps, their names, its file."""

import itertools
import re

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from bow_sim.physics.errors import ParameterError
from bow_sweep.plan.sweep import Sweep
from bow_sweep.run.directory import STUDY, RunError
from bow_sweep.study.over import Over, over_of
from bow_sweep.study.plan import LONGEST, MOST_MAPS, Study, run_name

SMALL = ("x.count=4", "y.count=2", "periods=10")


def study(*overs, preset="fig11d", given=SMALL):
    return Study(preset, given, tuple(map(over_of, overs)))


def test_the_maps_are_the_product_of_the_values_and_the_last_changes_fastest():
    members = study("mu_s=0.8,1.2", "v_mid=-2,0.2,0.9").members
    assert [(each.values["mu_s"], each.values["v_mid"]) for each in members] == list(
        itertools.product(("0.8", "1.2"), ("-2", "0.2", "0.9"))
    )
    assert [each.name for each in members][:2] == ["0_mu_s=0.8_v_mid=-2", "1_mu_s=0.8_v_mid=0.2"]
    assert members[1].sweep == Sweep.from_spec("fig11d", [*SMALL, "mu_s=0.8", "v_mid=0.2"])


def test_a_study_may_go_over_presets_models_and_settings_of_axes():
    assert [each.sweep.preset for each in study("preset=fig11c,fig11d", preset="").members] == ["fig11c", "fig11d"]
    assert {each.sweep.parameters.model for each in study("model=raman,stiff_cremer").members} == {
        "raman",
        "stiff_cremer",
    }
    assert [each.sweep.x.last for each in study("x.last=10,20").members] == [10, 20]
    assert [each.sweep.parameters.period for each in study("period=40,80").members] == [40, 80]


values = st.lists(st.floats(1e-7, 1e-3), min_size=1, max_size=6, unique=True)


@settings(max_examples=8, deadline=None)
@given(values, st.lists(st.floats(0.7, 1.3), min_size=1, max_size=3, unique=True))
def test_names_of_runs_are_unique_sort_in_order_and_are_safe(stiffness, friction):
    members = Study(
        "fig11d",
        SMALL,
        (Over("stiffness_b", tuple(map(repr, stiffness))), Over("mu_s", tuple(map(repr, friction)))),
    ).members
    names = [each.name for each in members]
    assert sorted(names) == names
    assert len(set(names)) == len(stiffness) * len(friction)
    assert all(re.fullmatch(r"[A-Za-z0-9._+=-]+", name) and len(name) <= LONGEST for name in names)


@given(st.text(max_size=300), st.text(max_size=300), st.integers(0, 10**6))
def test_any_name_and_value_make_a_safe_name_that_sorts_by_its_number(name, value, number):
    found = run_name(number, 7, {name: value})
    assert re.fullmatch(r"[A-Za-z0-9._+=-]+", found)
    assert found.startswith(f"{number:07d}")
    assert len(found) <= LONGEST


@settings(max_examples=8, deadline=None)
@given(values)
def test_a_study_is_read_back_from_its_directory(tmp_path_factory, stiffness):
    directory = tmp_path_factory.mktemp("study")
    asked = Study("fig11d", SMALL, (Over("stiffness_b", tuple(map(repr, stiffness)), "log"), over_of("mu_s=0.9,1")))
    asked.begin(directory)
    assert Study.in_directory(directory) == asked


@pytest.mark.parametrize(
    ("asked", "right"),
    [
        (study(), "a study goes over a parameter"),
        (study("nonsense=1,2"), "nonsense"),
        (study("mu_s=1,2", given=(*SMALL, "mu_s=1")), "mu_s.*all maps"),
        (study("mu_s=1,2", "mu_s=3,4"), "twice"),
        (study("f_asym=1,2"), "x axis"),
        (study("preset=fig11c,fig11d"), "preset.*all maps"),
        (study("preset=fig11c,fig99", preset=""), "fig99"),
        (study("mu_s=-1,1"), "mu_s = -1"),
        (study("mu_s=0.7:1.3:50", "stiffness_b=1e-6:1e-4:50"), f"2500 maps.*{MOST_MAPS}"),
    ],
)
def test_a_study_that_cannot_be_is_refused_with_its_reason(asked, right):
    with pytest.raises(ParameterError, match=right):
        _ = asked.members


@pytest.mark.parametrize(
    "change",
    [
        lambda content: None,
        lambda content: [1],
        lambda content: content | {"over": 3},
        lambda content: content | {"over": [{"name": "mu_s", "scale": "steep", "values": ["1"]}]},
        lambda content: {key: value for key, value in content.items() if key != "settings"},
        lambda content: content | {"settings": ["mu_s=-7"]},
        lambda content: content | {"study": 99},
    ],
)
def test_a_damaged_study_is_named(tmp_path, change):
    study("mu_s=0.9,1").begin(tmp_path)
    path = tmp_path / STUDY
    path.write_text(yaml.safe_dump(change(yaml.safe_load(path.read_text()))))
    with pytest.raises(RunError, match=STUDY):
        Study.in_directory(tmp_path)


def test_a_directory_without_a_study_is_refused(tmp_path):
    with pytest.raises(RunError, match="no study was begun"):
        Study.in_directory(tmp_path)
