"""A search: what it is, its file, what the optimiser asks, what is best."""

import json
import math

import numpy as np
import pytest
import yaml

from bow_sim.physics.errors import ParameterError
from bow_sweep.run.directory import SEARCH, RunError
from bow_sweep.study.over import range_of
from bow_sweep.study.report import aligned
from bow_sweep.study.search import (
    HIGHEST,
    LOWEST,
    SEARCH_REPORT,
    Optimiser,
    Search,
    Trial,
    as_good,
    best,
    write_report,
)
from bow_sweep.study.statistics import Measured

SMALL = ("x.count=4", "y.count=2", "periods=10")


def search(*overs, given=SMALL, measure="helmholtz", goal=HIGHEST, trials=30, seed=0):
    ranges = overs or ("mu_s=0.6:1.2", "stiffness_b=1e-6:3e-4:log")
    return Search("fig11d", given, tuple(map(range_of, ranges)), measure, goal, trials, seed)


def peak(values):
    """A measure with its highest value at mu_s = 1, stiffness_b = 1e-5."""
    return 0.5 - (float(values["mu_s"]) - 1) ** 2 - 0.05 * math.log10(float(values["stiffness_b"]) / 1e-5) ** 2


def answered(asked, told, many):
    """What an optimiser asks in `many` trials, and is told."""
    optimiser = Optimiser(asked)
    values = []
    for _ in range(many):
        values.append(optimiser.ask())
        optimiser.tell(told(values[-1]))
    return values


def test_a_search_comes_near_the_highest_value_and_nearer_than_chance():
    values = answered(search(trials=40), peak, 40)
    found = np.array([peak(each) for each in values])
    assert found.max() > 0.49
    assert found[20:].mean() > found[:10].mean()


def test_a_search_for_the_lowest_goes_the_other_way():
    asked = search(goal=LOWEST, trials=40)
    found = np.array([-peak(each) for each in answered(asked, lambda each: -peak(each), 40)])
    assert found.min() < -0.49


def test_a_search_asks_the_same_again_and_another_with_another_seed():
    first = answered(search(), peak, 15)
    assert answered(search(), peak, 15) == first
    assert answered(search(seed=1), peak, 15)[0] != first[0]


def test_what_is_asked_is_in_the_ranges_and_whole_where_it_must_be():
    asked = search("period=40:80", "mu_s=0.6:1.2")
    for values in answered(asked, lambda each: float(each["mu_s"]), 12):
        assert 40 <= int(values["period"]) <= 80
        assert 0.6 <= float(values["mu_s"]) <= 1.2


def test_a_map_that_cannot_be_computed_is_no_obstacle():
    values = answered(search(), lambda each: math.inf if float(each["mu_s"]) < 0.9 else peak(each), 15)
    assert len(values) == 15


def test_a_search_is_read_back_from_its_directory(tmp_path):
    asked = search(measure="median_transient", goal=LOWEST, seed=7)
    asked.begin(tmp_path)
    assert Search.in_directory(tmp_path) == asked


@pytest.mark.parametrize(
    "change",
    [
        lambda content: None,
        lambda content: content | {"trials": "many"},
        lambda content: content | {"over": [{"name": "mu_s"}]},
        lambda content: content | {"measure": "joy"},
        lambda content: content | {"optimise": 99},
    ],
)
def test_a_damaged_search_is_named(tmp_path, change):
    search().begin(tmp_path)
    path = tmp_path / SEARCH
    path.write_text(yaml.safe_dump(change(yaml.safe_load(path.read_text()))))
    with pytest.raises(RunError, match=SEARCH):
        Search.in_directory(tmp_path)


@pytest.mark.parametrize(
    ("asked", "right"),
    [
        (Search("fig11d", SMALL, (), "helmholtz", HIGHEST), "a search changes a parameter"),
        (search("mu_s=0.6:1.2", "mu_s=1:2"), "twice"),
        (search("mu_s=0.6:1.2", given=(*SMALL, "mu_s=1")), "all maps"),
        (search(measure="joy"), "joy.*helmholtz"),
        (search(trials=0), "--trials 0"),
        (search(seed=-1), "--seed -1"),
        (search("mu_s=-1:1.2"), r"at mu_s = -1"),
        (search("nonsense=1:2"), "nonsense"),
    ],
)
def test_a_search_that_cannot_be_is_refused_with_its_reason(asked, right):
    with pytest.raises(ParameterError, match=right):
        asked.check()


def test_the_best_trial_and_those_not_known_to_be_worse():
    trials = [
        Trial("a", {}, Measured(0.30, 0.01, 0.30)),
        Trial("b", {}, Measured(0.50, 0.01, 0.50)),
        Trial("c", {}, Measured(0.49, 0.01, 0.49)),
        Trial("d", {}, Measured(None, None, None)),
    ]
    assert best(search(), trials) == 1
    assert best(search(goal=LOWEST), trials) == 0
    assert as_good(trials, 1) == [2]
    assert best(search(), trials[3:]) is None


def test_the_report_of_a_search_has_every_trial(tmp_path):
    trials = [Trial("0_mu_s=1", {"mu_s": "1.0"}, Measured(0.5, None, None))]
    write_report(tmp_path, search(), trials)
    content = json.loads((tmp_path / SEARCH_REPORT).read_text())
    assert content["best"] == "0_mu_s=1"
    assert content["trials"] == [{"run": "0_mu_s=1", "values": {"mu_s": "1.0"}, "value": 0.5, "error": None}]


def test_tables_have_their_columns_to_the_right():
    assert aligned([["a", "long"], ["12", "3"]]) == ["   a  long", "  12     3"]
