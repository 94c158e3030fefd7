"""A campaign is a study over presets; directories of campaigns from before there were studies are still read."""

import json

import pytest

from bow_sim.physics.errors import ParameterError
from bow_sweep.plan.sweep import Sweep
from bow_sweep.run.directory import CAMPAIGN, RunError
from bow_sweep.study.campaigns import campaign, campaigns, study_in


@pytest.mark.parametrize("name", campaigns())
def test_every_campaign_is_made_of_sweeps_that_there_are(name):
    study = campaign(name)
    assert study.title
    presets = study.overs[0].values
    assert len(set(presets)) == len(presets) > 1
    assert {each.name: each.sweep for each in study.members} == {preset: Sweep.from_spec(preset) for preset in presets}


def test_settings_hold_for_every_sweep_of_a_campaign():
    sweeps = [each.sweep for each in campaign("fig11", ["x.count=4", "periods=10"]).members]
    assert {(sweep.x.count, sweep.parameters.periods) for sweep in sweeps} == {(4, 10)}
    assert len({sweep.sweep_id for sweep in sweeps}) == 6


def test_a_campaign_is_read_back_from_its_directory(tmp_path):
    study = campaign("fig11", ["x.count=4"])
    study.begin(tmp_path)
    assert study_in(tmp_path) == study


def test_the_directory_of_a_campaign_of_before_is_read_as_a_study(tmp_path):
    (tmp_path / CAMPAIGN).write_text(json.dumps({"campaign": "fig11", "settings": ["x.count=4"]}))
    assert study_in(tmp_path) == campaign("fig11", ["x.count=4"])


@pytest.mark.parametrize(
    "content", ["", "[]", "{}", '{"campaign": "../fig11", "settings": []}', '{"campaign": "fig11"}']
)
def test_a_damaged_campaign_is_named(tmp_path, content):
    (tmp_path / CAMPAIGN).write_text(content)
    with pytest.raises(RunError, match=CAMPAIGN):
        study_in(tmp_path)


def test_a_campaign_that_there_is_not_is_refused():
    with pytest.raises(ParameterError, match=r"fig99.*fig11"):
        campaign("fig99")
