"""Cells of runs whose streams are not recorded, or only the last ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import recording

from bow_sweep.cell.run_cells import RunCells
from bow_sweep.cell.waveform import CellError
from bow_sweep.explore.packed import last_periods


@pytest.fixture(scope="module", params=["last", "verdicts"])
def without(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """What is recorded, and the run; not to be changed."""
    sweep = recording.small_sweep(f"record={request.param}")
    run = recording.record(tmp_path_factory.mktemp("without") / "run", sweep)
    return request.param, recording.leave_all(run, sweep)


def test_a_cell_is_computed_again_and_held_against_the_checksums_that_the_verdicts_state(without, complete) -> None:
    record, run = without
    with RunCells(run) as cells, RunCells(complete) as recorded:
        for cell in (0, 11):
            found, right = cells.record(cell), recorded.record(cell)
            assert (found.source, found.checked) == ("computed", True)
            assert f"record={record}, without the waveforms of chunk 0" in found.why
            assert "the recorded checksums of all 4 chunks" in found.why
            assert found.differs_from(right) is None
            assert found.tests.regime.tolist() == right.tests.regime.tolist()


def test_what_asks_for_the_bag_is_told_that_it_was_recorded_without_waveforms(without: tuple[str, Path]) -> None:
    record, run = without
    with RunCells(run) as cells, pytest.raises(CellError, match=f"record={record}, without the waveforms of chunk 0"):
        cells.record(3, "bag")


def test_the_last_periods_come_from_the_bag_if_they_are_recorded(without: tuple[str, Path], complete: Path) -> None:
    record, run = without
    with RunCells(run) as cells, RunCells(complete) as recorded:
        found, right = last_periods(cells, 3), last_periods(recorded, 3)
    assert found.computed == (0 if record == "last" else 12)
    assert ("record=verdicts, without the waveforms of chunk 3" in found.why) == (record == "verdicts")
    for name in ("force", "offset", "onset", "duration"):
        np.testing.assert_array_equal(getattr(found, name), getattr(right, name))
