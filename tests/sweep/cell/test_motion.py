"""Under the bow: the friction force lies on the law's curve, and the motion is that of the record."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bow_sim.kernel.block import transient
from bow_sweep.cell.cell_record import CellRecord
from bow_sweep.cell.motion import CellMotion, motion
from bow_sweep.cell.run_cells import RunCells


@pytest.fixture(scope="module")
def record(recorded: Path) -> CellRecord:
    with RunCells(recorded) as cells:
        return cells.record(6)


@pytest.fixture(scope="module")
def moving(record: CellRecord) -> CellMotion:
    return motion(record)


def test_it_is_the_motion_of_the_record(record: CellRecord, moving: CellMotion) -> None:
    assert moving.same
    assert np.array_equal(moving.slipping, record.slipping)
    alone = transient(record.parameters)
    for name in ("v", "v_h", "v_centre", "friction_force"):
        assert np.array_equal(getattr(moving, name), alone[name]), name


def test_another_bridge_force_is_noticed(record: CellRecord) -> None:
    other = record.bridge_force.copy()
    other[-1] = np.nextafter(other[-1], np.float32(9))
    assert not motion(replace(record, bridge_force=other)).same


def test_every_sample_lies_on_the_friction_curve_at_its_bow_force(moving: CellMotion) -> None:
    p = moving.parameters
    np.testing.assert_allclose(moving.v, moving.v_h + moving.y * moving.friction_force, atol=1e-12)
    # this law has one curve for each bow force: take samples from the transient and from the end
    for sample in [*np.flatnonzero(moving.slipping)[:5], *np.flatnonzero(moving.slipping)[-5:]]:
        curve = moving.curve(float(moving.bow_force[sample]))
        assert curve is not None
        assert curve.v[0] == p.v_b
        on_curve = np.interp(-moving.v[sample], -curve.v, curve.f)
        if moving.v[sample] < p.v_b:
            assert moving.friction_force[sample] == pytest.approx(on_curve, rel=1e-3)


def test_sticking_samples_lie_on_the_strings_line_below_the_limit(moving: CellMotion) -> None:
    sticks = ~moving.slipping
    sticks[0] = False
    at_end = np.flatnonzero(sticks)[-50:]
    curve = moving.curve()
    assert curve is not None
    (v_0, f_0), (v_1, f_1) = curve.stick
    line = f_0 + (moving.v_h[at_end] - v_0) * (f_1 - f_0) / (v_1 - v_0)
    np.testing.assert_allclose(moving.friction_force[at_end], line, atol=1e-12)
    assert (moving.friction_force[at_end] <= f_1).all()
    assert curve.v_1 == v_1 <= curve.v_2


def test_the_curve_joins_the_sticking_line_at_the_largest_force(moving: CellMotion) -> None:
    curve = moving.curve()
    assert curve is not None
    assert (curve.v_h[0], curve.f[0]) == pytest.approx(curve.stick[1])
