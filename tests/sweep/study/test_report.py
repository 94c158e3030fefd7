"""study.json, its table and its picture, from runs of which the numbers are known."""

import itertools
import json

import numpy as np
import pytest
from example_maps import map_file

from bow_sweep.maps.playability import MEASURES
from bow_sweep.run.directory import REPORT, RunError
from bow_sweep.study.over import over_of
from bow_sweep.study.picture import study_figure
from bow_sweep.study.plan import Study
from bow_sweep.study.report import STUDY_REPORT, contents, legend, measured, neighbours, report, significant, table

STUDY = Study("fig11d", ("x.count=16", "y.count=16", "periods=10"), (over_of("mu_s=0.8,1.0,1.2"),))


def run(value, error=0.01):
    """The report of a run whose measures all have this value and error."""
    entry = {"value": value, "error": error, "half_grid": None if error is None else value}
    return {
        "run_id": "a" * 16,
        "cells": {"planned": 4, "done": 3, "quarantined": 1, "outstanding": 0},
        "samples": 10,
        "wall_seconds": 0.5,
        "helmholtz_fraction": value,
        "playability": {measure.name: entry for measure in MEASURES},
    }


def content_of(values, study=STUDY):
    return contents(study, {each.name: run(*value) for each, value in zip(study.members, values, strict=True)})


def test_the_report_adds_up_the_runs_and_is_written(tmp_path):
    for member, value in zip(STUDY.members, (0.3, 0.3, 0.6), strict=True):
        (tmp_path / member.name).mkdir()
        (tmp_path / member.name / REPORT).write_text(json.dumps(run(value)))
    found = report(tmp_path, STUDY)
    assert found["cells"] == {"planned": 12, "done": 9, "quarantined": 3, "outstanding": 0}
    assert (found["samples"], found["wall_seconds"]) == (30, 1.5)
    assert [each["values"] for each in found["maps"]] == [{"mu_s": 0.8}, {"mu_s": 1.0}, {"mu_s": 1.2}]
    assert json.loads((tmp_path / STUDY_REPORT).read_text()) == found


def test_a_study_with_a_run_that_is_not_finished_has_no_report(tmp_path):
    with pytest.raises(RunError, match=r"0_mu_s=0.8.*resume"):
        report(tmp_path, STUDY)


def test_significant_differences_are_marked_and_others_are_not():
    found = content_of([(0.3,), (0.305,), (0.6,)])
    rows = table(found, ["helmholtz"])
    assert [row[1].split("  ")[0].rstrip(" *+") for row in rows[1:]] == ["30.0 ± 1.0", "30.5 ± 1.0", "60.0 ± 1.0"]
    assert ["*" in row[1] for row in rows[1:]] == [False, False, True]
    assert ["+" in row[1] for row in rows[1:]] == [False, False, True]
    assert significant(found, "first", STUDY.members[2].name)["helmholtz"].value == pytest.approx(0.3)
    assert any("Welch" in line for line in legend(found))


def test_maps_too_small_for_errors_say_so_and_have_no_marks():
    found = content_of([(0.3, None), (0.5, None), (0.9, None)])
    assert [row[1].strip() for row in table(found, ["helmholtz"])[1:]] == ["30.0", "50.0", "90.0"]
    assert "too small" in legend(found)[0]


def test_grids_that_agree_on_another_value_than_the_map_say_nothing_about_it():
    entry = {"smooth": {"value": 0.2, "error": 0.0, "half_grid": 0.0}}
    assert measured(entry, "smooth") == (0.2, None, None)


def test_neighbours_along_a_parameter_differ_in_it_alone_by_a_step():
    shape = (2, 3, 2)
    places = list(itertools.product(*map(range, shape)))
    for axis in range(3):
        pairs = neighbours(shape, axis)
        assert len(pairs) == 12 - 12 // shape[axis]
        for a, b in pairs:
            assert np.subtract(places[b], places[a]).tolist() == [int(axis == k) for k in range(3)]


@pytest.mark.full
@pytest.mark.parametrize(
    ("overs", "axes"),
    [(["mu_s=0.8,1.0,1.2"], 6 + 3 + 1), (["stiffness_b=1e-6:1e-4:2:log", "v_mid=-2,0.2,0.9"], 6 + 6 + 1)],
)
def test_the_picture_has_a_panel_for_each_measure_and_a_small_map_for_each_map(overs, axes):
    study = Study("fig11d", STUDY.settings, tuple(map(over_of, overs)))
    found = content_of([(0.3 + 0.1 * n, 0.01) for n in range(len(study.members))], study)
    figure = study_figure(study, found, [map_file() for _ in study.members])
    assert len(figure.axes) == axes
    figure.draw_without_rendering()
