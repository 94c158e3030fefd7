"""The last periods of every cell, from the bag or computed again, and packed to a stated precision."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import recording

from bow_sweep.cell.run_cells import RunCells
from bow_sweep.explore.packed import last_periods, pack

PERIOD = 139


@pytest.mark.parametrize("periods", [2, 5, 7])
def test_the_last_periods_are_the_ends_of_the_waveforms(first_run: Path, periods: int) -> None:
    done = []
    with RunCells(first_run) as run:
        found = last_periods(run, periods, lambda part, whole: done.append((part, whole)))
        start = 30 * PERIOD - periods * PERIOD
        for cell in range(run.cells):
            record = run.record(cell)
            np.testing.assert_array_equal(found.force[cell], record.bridge_force[start:])
            own = slice(found.offset[cell], found.offset[cell + 1])
            slipping = np.zeros(periods * PERIOD, bool)
            for onset, duration in zip(found.onset[own], found.duration[own], strict=True):
                slipping[onset : onset + duration] = True
            np.testing.assert_array_equal(slipping, record.slipping[start:])
    assert found.computed == 0
    assert done[-1] == (48, 48)


def test_without_a_bag_they_are_computed_and_the_same(first_run: Path, tmp_path: Path) -> None:
    bare = tmp_path / "bare"
    shutil.copytree(first_run, bare, ignore=shutil.ignore_patterns("bag"))
    with RunCells(first_run) as run, RunCells(bare) as again:
        recorded, computed = last_periods(run, 5), last_periods(again, 5)
    np.testing.assert_array_equal(recorded.force, computed.force)
    for name in ("offset", "onset", "duration"):
        np.testing.assert_array_equal(getattr(recorded, name), getattr(computed, name))
    assert (recorded.computed, computed.computed) == (0, 48)
    assert computed.why == "there is no bag"


@pytest.mark.parametrize("bits", [8, 16])
def test_a_packed_sample_is_right_to_half_a_step(bits: int) -> None:
    chance = np.random.default_rng(1)
    force = (chance.normal(size=(5, 400)) * np.array([[1e-6], [1], [30], [0], [1]]) + 7).astype(np.float32)
    force[4] = 3.5  # at rest
    packed = pack(force, bits)
    assert packed.values.dtype == np.dtype(f"int{bits}")
    again = packed.middle[:, None] + packed.step[:, None].astype(float) * packed.values
    bound = packed.step[:, None] * 0.501 + 8 * np.finfo(np.float32).eps * np.abs(force)
    assert (np.abs(again - force) <= bound).all()
    top = 2 ** (bits - 1) - 1
    assert np.abs(packed.values[1]).max() == top  # the whole range is used
    np.testing.assert_array_equal(packed.values[4], 0)


def test_cells_that_the_run_has_given_up_are_left_at_rest(tmp_path: Path) -> None:
    recording.quarantined_run(tmp_path / "run")
    with RunCells(tmp_path / "run") as run:
        found = last_periods(run, 5)
        lost = run.sweep.block(1)
        assert found.given_up == len(lost) > 0
        assert found.computed == 0
        assert not found.force[lost].any()
        assert found.force.any(axis=1).sum() == run.cells - len(lost)
