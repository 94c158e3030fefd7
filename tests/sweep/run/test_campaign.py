"""A campaign: several sweeps with one report."""

import json

import pytest

from bow_sim.physics.errors import ParameterError
from bow_sweep.plan.sweep import Sweep
from bow_sweep.run.campaign import FILE, Campaign, campaigns, report
from bow_sweep.run.directory import REPORT, RunError


@pytest.mark.parametrize("name", campaigns())
def test_every_campaign_is_made_of_sweeps_that_there_are(name):
    campaign = Campaign.of(name)
    assert campaign.title
    assert len(set(campaign.presets)) == len(campaign.presets) > 1
    assert campaign.sweeps() == {preset: Sweep.from_spec(preset) for preset in campaign.presets}


def test_settings_hold_for_every_sweep_of_a_campaign():
    sweeps = Campaign.of("fig11", ["x.count=4", "periods=10"]).sweeps()
    assert {(sweep.x.count, sweep.parameters.periods) for sweep in sweeps.values()} == {(4, 10)}
    assert len({sweep.sweep_id for sweep in sweeps.values()}) == 6


def test_a_campaign_is_read_back_from_its_directory(tmp_path):
    campaign = Campaign.of("fig11", ["x.count=4"])
    campaign.begin(tmp_path)
    assert Campaign.in_directory(tmp_path) == campaign


@pytest.mark.parametrize(
    "content", ["", "[]", "{}", '{"campaign": "../fig11", "settings": []}', '{"campaign": "fig11"}']
)
def test_a_damaged_campaign_is_named(tmp_path, content):
    (tmp_path / FILE).write_text(content)
    with pytest.raises(RunError, match=FILE):
        Campaign.in_directory(tmp_path)


def test_a_campaign_that_there_is_not_is_refused():
    with pytest.raises(ParameterError, match=r"fig99.*fig11"):
        Campaign.of("fig99")


def test_the_report_adds_up_the_runs(tmp_path):
    campaign = Campaign("two", "Two sweeps", ("one", "other"))
    for preset, done in (("one", 3), ("other", 4)):
        cells = {"planned": 4, "done": done, "quarantined": 4 - done, "outstanding": 0}
        (tmp_path / preset).mkdir()
        (tmp_path / preset / REPORT).write_text(
            json.dumps({"cells": cells, "samples": 10 * done, "wall_seconds": 0.5, "helmholtz_fraction": 0.25})
        )
    found = report(tmp_path, campaign)
    assert found["cells"] == {"planned": 8, "done": 7, "quarantined": 1, "outstanding": 0}
    assert (found["samples"], found["wall_seconds"]) == (70, 1.0)
    assert found["runs"]["other"]["helmholtz_fraction"] == 0.25
    assert json.loads((tmp_path / REPORT).read_text()) == found
