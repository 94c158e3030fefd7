"""The setting `record`: which streams are recorded."""

import pytest

from bow_sim.physics.errors import ParameterError
from bow_sim.protocol.recording import RECORD, judged_at_source, recorded_chunks
from bow_sweep.plan.sweep import Sweep


def test_verdicts_record_no_streams_and_last_those_of_the_last_chunk() -> None:
    assert {record: list(recorded_chunks(record, 3)) for record in RECORD} == {
        "all": [0, 1, 2],
        "last": [2],
        "verdicts": [],
    }
    assert all(len(recorded_chunks(record, 1)) == (record != "verdicts") for record in RECORD)


def test_simulators_judge_their_chunks_where_no_streams_are_recorded() -> None:
    assert all(judged_at_source(record) == (not recorded_chunks(record, 3)) for record in RECORD)


def test_what_is_recorded_is_a_setting_of_the_run_and_no_part_of_the_identity_of_its_cells() -> None:
    plain = Sweep.from_spec("fig11d", ["x.count=4", "y.count=2"])
    sweep = Sweep.from_spec("fig11d", ["x.count=4", "y.count=2", "record=verdicts"])
    assert set(sweep.settings()) - set(plain.settings()) == {"record=verdicts"}
    assert sweep.sweep_id == plain.sweep_id
    assert Sweep.from_spec("", sweep.settings()).recorded_chunks == range(0)


def test_by_default_the_settings_are_those_of_before() -> None:
    plain = Sweep.from_spec("fig11d")
    assert Sweep.from_spec("fig11d", ["record=all"]).settings() == plain.settings()
    assert not [line for line in plain.settings() if line.startswith("record")]


def test_another_value_is_refused_with_those_that_there_are() -> None:
    with pytest.raises(ParameterError, match="record = 'none': should be one of all, last, verdicts"):
        Sweep.from_spec("fig11d", ["record=none"])
