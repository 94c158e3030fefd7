from __future__ import annotations

import pytest
from outlines import outline

from bow_classifier.task import Task
from bow_sim.physics.errors import ParameterError
from bow_sweep.plan.sweep import Sweep

RUN, SWEEP = "0123456789abcdef", "fedcba9876543210"


def test_a_task_has_the_thresholds_that_the_plan_announces():
    sweep = Sweep.from_spec("fig11d", ["classifier.correlation=0.9"])
    assert Task.of(outline(RUN, SWEEP, sweep.settings())).thresholds == sweep.thresholds


def test_thresholds_that_cannot_be_are_refused():
    with pytest.raises(ParameterError, match=r"classifier\.correlation"):
        Task.of(outline(RUN, SWEEP, [*Sweep.from_spec("fig11d").settings(), "classifier.correlation=2"]))
