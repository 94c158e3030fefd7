"""Every test of every cell: what is known after how many periods, and from which file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from example_maps import APERIODIC, HELMHOLTZ, SLIP, map_file

from bow_sim.protocol.verdict_fields import PENDING
from bow_sweep.maps.map_file import MAP, MapFile, write_map_npz
from bow_sweep.maps.plane import Plane
from bow_sweep.view import tests_over_time
from bow_sweep.view.tests_over_time import LEDGER, at_each_test, confidence_words, finished_map


def with_history(computed: int | None = None) -> MapFile:
    """A map whose cells are aperiodic, then have Helmholtz motion; those of row 1 slip twice."""
    result = map_file(computed=computed)
    regimes = np.where(result.helmholtz, HELMHOLTZ, APERIODIC).astype(np.uint8)
    regimes[:, 1] = SLIP
    regimes[:, np.isnan(result.transient_periods)] = PENDING
    confidence = np.where(regimes == PENDING, np.nan, 0.937).astype(np.float32)
    return replace(result, regimes=regimes, confidence=confidence)


def test_a_cell_has_no_transient_length_before_it_came():
    result = with_history()
    shown = dict(at_each_test(result))
    assert list(shown) == [0, *range(5, 105, 5)]
    assert np.isnan(shown[0].transient_periods).all()
    assert shown[20].transient_periods[0].tolist() == [5, 10, 15, 20, 0, 0, 0, 0]
    assert shown[20].regime[0].tolist() == [HELMHOLTZ] * 4 + [APERIODIC] * 4
    assert set(shown[45].transient_periods[2].tolist()) == {0}
    assert set(shown[50].transient_periods[2].tolist()) == {50}
    assert set(shown[100].regime[1].tolist()) == {SLIP}
    assert shown[100].tests.min() == 20


def test_a_cell_that_was_not_computed_is_pending_at_every_test():
    for _, shown in at_each_test(with_history(computed=20)):
        assert np.isnan(shown.transient_periods[3]).all()
        assert (shown.regime[3] == PENDING).all()
        assert (shown.tests[3] == 0).all()


def test_what_an_adaptive_sweep_predicted_is_in_the_last_map_only():
    result = with_history(computed=24)
    predicted = result.transient_periods.copy()
    predicted[3] = 30
    *before, (_, last) = at_each_test(replace(result, transient_periods=predicted))
    assert all(np.isnan(shown.transient_periods[3]).all() for _, shown in before)
    assert (last.transient_periods[3] == 30).all()


def test_how_sure_a_regime_is():
    words = confidence_words(with_history(computed=20))
    assert words[:8] == ["; confidence 0.94"] * 8
    assert words[24:] == [""] * 8


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    (tmp_path / LEDGER).touch()
    return tmp_path


def test_the_map_is_waited_for_until_it_is_there(directory):
    result, waits = with_history(), []

    def sleep(seconds: float) -> None:
        waits.append(seconds)
        if len(waits) == 3:
            write_map_npz(directory / MAP, result)

    found = finished_map(directory, result, sleep)
    assert found is not None
    np.testing.assert_array_equal(found.regimes, result.regimes)
    assert len(waits) == 3


@pytest.mark.parametrize("why", ["less of the same run", "another run", "an older file", "rubbish"])
def test_an_older_map_is_not_taken_and_not_waited_for_for_ever(directory, monkeypatch, why):
    monkeypatch.setattr(tests_over_time, "MAP_S", 0.5)
    shown: Plane = with_history()
    old = {
        "less of the same run": with_history(computed=20),
        "another run": replace(with_history(), run_id="f" * 16),
        "an older file": replace(with_history(), regimes=None, confidence=None),
    }
    if why in old:
        write_map_npz(directory / MAP, old[why])
    else:
        (directory / MAP).write_bytes(b"rubbish")
    waits: list[float] = []
    assert finished_map(directory, shown, waits.append) is None
    assert sum(waits) == pytest.approx(0.5)


def test_a_directory_of_no_run_is_not_waited_for(tmp_path):
    assert finished_map(tmp_path, with_history(), pytest.fail) is None
